"""Hold to run: a loop that stays enabled only while somebody goes on saying so."""

from __future__ import annotations

from collections.abc import Callable
from math import isnan
import time
from typing import Any

from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.pacing import steady_timer
from nadrc_ros.ros.stamps import Departures, Offset
from nadrc_ros.ros.topics import Info, LATEST, receive

TOPIC = '~/keep'
# A lease lasts at least and at most so long [s].
SHORTEST, LONGEST = 0.05, 2.0
STOPPED = f"the operator's heartbeat ({TOPIC}) stopped"


class Lease:
    """
    How long a loop may stay enabled without another message on ``~/keep``.

    A message is a lease of so many seconds, from 0.05 to 2 and counted from when it was sent: one
    that waited in a queue for longer is void. Once there was a lease, ``ended`` is called when it
    runs out, even if this process stood still meanwhile and finds a newer message in its queue. 0
    gives the lease back, and NaN is ignored. Time is that of the steady clock, whatever paces the
    loop. In lockstep there is no such topic.
    """

    def __init__(self, node: LiveNode, ended: Callable[[], None]) -> None:
        self._ended = ended
        self._offset = Offset()
        self._departures = Departures(self._offset)
        self._until: int | None = None
        self._lost: int | None = None  # when one ran out, until that was told
        self._timer: Any = None
        if node.lockstep is None:
            self._timer = steady_timer(node, LONGEST, self._look)
            self._timer.cancel()
            self.heard = receive(node, TOPIC, self._take, LATEST, fixed=True)

    @property
    def left(self) -> float:
        """Return how long it still lasts [s], 0 where there is none."""
        if self._until is None:
            return 0.0
        return max(0.0, (self._until - time.monotonic_ns()) * 1e-9)

    def said(self) -> str:
        """Return what to say of it when the loop is enabled, nothing where none was given."""
        if self.left:
            return f' for as long as {TOPIC} goes on'
        lost, self._lost = self._lost, None
        if lost is None:
            return ''
        ago = (time.monotonic_ns() - lost) * 1e-9
        return f', without a lease: the last one on {TOPIC} ran out {ago:.1f} s ago'

    def _take(self, seconds: float, info: Info) -> None:
        now = time.monotonic_ns()
        until = self._departures.of(info, now - self._waited(info, now))
        if self._until is not None and now >= self._until:
            self._run_out(self._until)
        if seconds == 0.0:
            self._until = self._lost = None
            self._timer.cancel()
        elif not isnan(seconds):
            until += round(1e9 * min(max(seconds, SHORTEST), LONGEST))
            if until > now:
                self._until, self._lost = until, None
                self._wait(until - now)

    def _waited(self, info: Info, now: int) -> int:
        """Return how long ago a message came [ns]; who sent it may have another clock."""
        received: int = info['received_timestamp']
        return max(0, now + self._offset() - received) if received else 0

    def _wait(self, nanoseconds: int) -> None:
        self._timer.timer_period_ns = nanoseconds
        self._timer.reset()

    def _look(self) -> None:
        self._timer.cancel()
        if self._until is None:
            return
        left = self._until - time.monotonic_ns()
        if left > 0:
            self._wait(left)
        else:
            self._run_out(self._until)

    def _run_out(self, when: int) -> None:
        self._until, self._lost = None, when
        self._ended()
