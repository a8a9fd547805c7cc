"""What a controller node publishes beside its command."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.records.recording import ESTIMATES
from nadrc_ros.ros.topics import Sender

_TOPICS = tuple(f'~/{topic}' for topic in ESTIMATES.values())


def loop_values(controller: Controller) -> dict[str, object]:
    """Return what /diagnostics has of the law and its fault policy."""
    values: dict[str, object] = {
        'structure': controller.settings.structure,
        'enabled': controller.enabled,
        'mode': controller.mode.name.lower(),
        'cause': controller.cause.name.lower(),
        'measurement_age': controller.policy.measurement_age,
        'reference_age': controller.policy.reference_age,
    }
    if len(controller.settings.b0_table) > 1:
        values['b0'] = controller.b0
    if controller.settings.applied_timeout > 0.0:
        values['applied'] = 'reported' if controller.sample.applied_age >= 0.0 else 'own'
    if controller.settings.feed_forward_timeout > 0.0:
        values['feed_forward'] = controller.sample.feed_forward
    if controller.settings.error_deadband > 0.0:
        values['resting'] = controller.resting
    return values | {f'steps_{s.name.lower()}': n for s, n in controller.counts.items() if n}


class Estimates:
    """
    Publishes the estimates that somebody reads, or in lockstep ``always`` all of them.

    There is a topic for each of so many ``levels``; a retune may add some, and none goes away.
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
        if len(self._senders) < len(_TOPICS) + levels:
            self._add(levels)
        if not self._read:
            return
        values = [controller.tracking, controller.output_estimate, controller.total_disturbance]
        values += controller.disturbances
        for i in self._read:
            if i < len(values) and isfinite(values[i]):
                self._senders[i].send(values[i])

    def _add(self, levels: int) -> None:
        topics = [*_TOPICS, *(f'~/level_{k + 1}/disturbance' for k in range(levels))]
        self._senders += [self._make_sender(topic) for topic in topics[len(self._senders) :]]
        self.look()
