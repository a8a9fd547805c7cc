"""What the controller believes, on topics of its own: for recorders and plotters."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.records.recording import ESTIMATES
from nadrc_ros.ros.topics import Sender

TOPICS = tuple(f'~/{topic}' for topic in ESTIMATES.values())


class Estimates:
    """
    Publishes the estimates that somebody reads; none of its topics goes away while the node runs.

    Parameters
    ----------
    make_sender
        Makes the sender of a topic.
    levels
        How many levels there are at the start; a retune may add some.
    always
        Whether all are sent, also those that nobody reads, as in lockstep.

    """

    def __init__(self, make_sender: Callable[[str], Sender], levels: int, *, always: bool) -> None:
        self._make_sender = make_sender
        self._always = always
        self._senders: list[Sender] = []
        self._read: list[int] = []
        self._add(levels)

    def look(self) -> None:
        """Find out which topics have readers: asked at every step, it would double its time."""
        self._read = [i for i, s in enumerate(self._senders) if self._always or s.has_readers]

    def send(self, controller: Controller) -> None:
        """Publish the estimates of the last step."""
        levels = controller.design.levels
        if len(self._senders) < len(TOPICS) + levels:
            self._add(levels)
        if not self._read:
            return
        values = [controller.tracking, controller.output_estimate, controller.total_disturbance]
        values += controller.disturbances
        for i in self._read:
            if i < len(values) and isfinite(values[i]):
                self._senders[i].send(values[i])

    def _add(self, levels: int) -> None:
        topics = [*TOPICS, *(f'~/level_{k + 1}/disturbance' for k in range(levels))]
        self._senders += [self._make_sender(topic) for topic in topics[len(self._senders) :]]
        self.look()
