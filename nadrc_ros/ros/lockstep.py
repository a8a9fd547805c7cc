"""Lockstep: synchronous dataflow over topics; the graph gives the bits of the simulation."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from threading import RLock
import time

from nadrc_ros.ros.graph import missing_readers
from nadrc_ros.ros.pacing import PacingSettings, steady_timer
from nadrc_ros.ros.topics import (
    Info,
    LOCKSTEP_RECEIVE,
    LOCKSTEP_SEND,
    receive,
    Sender,
)
from rclpy.node import Node

# rclpy has RCLError only in its extension module; every error of a publisher is a RuntimeError.
_PublishError = RuntimeError
# Readers of a run that broke off are likely gone, which the middleware notices much later [s].
_BROKEN_OFF_WAIT = 0.1
# Readers and samples that are due are looked after so often [s].
_LOOK = 0.02


class LockstepSender(Sender):
    """A sender that waits for a reader whose history is full, and fails its node in the end."""

    def __init__(self, node: Node, topic: str, timeout: float) -> None:
        super().__init__(node, topic, LOCKSTEP_SEND)
        self._node = node
        self._timeout = timeout

    def send(self, value: float, stamp: int = 0) -> None:
        """Publish ``value``; a node that is told to stop tries once, for its last command."""
        end = time.monotonic() + self._timeout
        while True:
            try:
                super().send(value, stamp)
                return
            except _PublishError as error:
                if self._node.told_to_stop:
                    said = f'{self.topic}: the last sample could not be sent ({error})'
                    self._node.get_logger().warning(said)
                    return
                if not self._node.context.ok():
                    self._node.fail(f'{self.topic}: the context was shut down')
                    return
                if time.monotonic() > end:
                    self._node.fail(f'{self.topic}: a reader does not keep up ({error})')
                    return
                time.sleep(0.001)


class Lockstep:
    """
    Fires its node once per complete set of input samples.

    It calls ``start`` when every expected reader of its outputs is there, and from then on
    ``fire`` with one value per input, in the order of the inputs. The node fails when a sample is
    missing or does not come in time: no queue is ever skipped, so that equal inputs give equal
    bits. ``fired`` counts; ``on_fired`` is called after each, for who watches in the process.
    """

    def __init__(
        self,
        node: Node,
        pacing: PacingSettings,
        fire: Callable[[list[float]], None],
        start: Callable[[], None],
    ) -> None:
        self.fired = 0
        self.on_fired: Callable[[], None] = lambda: None
        # Who lets it go on is not always the thread of the executor.
        self._lock = RLock()
        self._until = pacing.steps
        self._node = node
        self._pacing = pacing
        self._fire = fire
        self._start = start
        self.started = False
        self._began = time.monotonic()
        self._last = self._began
        self._topics: list[str] = []
        self._queues: list[deque[float]] = []
        self._numbers: list[int] = []
        self._senders: list[Sender] = []
        steady_timer(node, _LOOK, self._watch)

    def add_input(self, topic: str) -> None:
        """Add an input; samples are taken in the order in which inputs were added."""
        take = partial(self._take, len(self._queues))
        self._queues.append(deque())
        self._numbers.append(0)
        self._topics.append(receive(self._node, topic, take, LOCKSTEP_RECEIVE).topic)

    def add_output(self, topic: str) -> Sender:
        """Add an output."""
        sender = LockstepSender(self._node, topic, self._pacing.lockstep_timeout)
        self._senders.append(sender)
        return sender

    @property
    def complete(self) -> bool:
        """Tell whether the run has its full length."""
        return self.fired >= self._pacing.steps

    def go_on(self, until: int | None = None) -> None:
        """Wait for samples from now on anew, and then fire until there were ``until`` in all."""
        self._last = time.monotonic()
        if until is not None:
            self._until = until
        self._drain()

    def flush(self) -> None:
        """Wait until every reader has what was sent; hardly at all for a run that broke off."""
        wait = self._pacing.lockstep_timeout if self.complete else _BROKEN_OFF_WAIT
        end = time.monotonic() + wait
        for sender in self._senders:
            sender.await_delivery(max(0.0, end - time.monotonic()))

    def _take(self, index: int, value: float, info: Info) -> None:
        number = info['publication_sequence_number']
        expected = self._numbers[index] + 1
        if number is not None and number != expected:
            self._node.fail(f'{self._topics[index]}: sample {expected} is missing, {number} came')
            return
        self._numbers[index] = expected
        self._queues[index].append(value)
        self._drain()

    def _drain(self) -> None:
        with self._lock:
            while self._may_fire and all(self._queues):
                self._last = time.monotonic()
                values = [queue.popleft() for queue in self._queues]
                self.fired += 1
                self._fire(values)
                if self.complete:
                    self._node.finished = True
                self.on_fired()

    @property
    def _may_fire(self) -> bool:
        return self.started and not self._node.finished and self.fired < self._until

    def _watch(self) -> None:
        if self._node.finished:
            return
        now = time.monotonic()
        if self.started:
            if now - self._last > self._pacing.lockstep_timeout:
                empty = [t for t, queue in zip(self._topics, self._queues) if not queue]
                self._node.fail(
                    f'{", ".join(empty)}: no sample {self.fired + 1} for '
                    f'{self._pacing.lockstep_timeout:g} s'
                )
            return
        missing = missing_readers(
            self._node,
            self._node.get_namespace(),
            {
                self._node.resolve_topic_name(topic): names
                for topic, names in self._pacing.expected_readers().items()
            },
        )
        if not missing:
            self.started = True
            self._last = now
            self._start()
            self._drain()
        elif now - self._began > self._pacing.start_timeout:
            self._node.fail(
                'no start: '
                + '; '.join(f'{topic} has no reader {name}' for topic, name in missing)
            )
