"""Hold to run: a heartbeat of the page that, while it is fresh, keeps the controller enabled."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

# A lease lasts so long [s]; a beat later than the quickest one by more than that is not fresh.
LEASE, _LATE = 0.3, 0.15
# So far the clocks of a page and of this machine drift apart at most.
_DRIFT = 1e-3


class Heartbeat:
    """
    Tells whether beats of one page are fresh: numbered upwards, and no later than others.

    Each has the time of the page. The one that was under way for the shortest time tells how far
    the two clocks are apart; so what waited in a queue, of a page or a network that stood still,
    is known to be old.
    """

    def __init__(self) -> None:
        self._number: float = -inf
        self._least = self._last = inf

    def is_fresh(self, number: float, sent: float, now: float) -> bool:
        """Take a beat with its number, ``sent`` [s] by the clock of the page, ``now`` [s]."""
        if number <= self._number:
            return False
        self._number = number
        if self._last < inf:
            self._least += _DRIFT * (now - self._last)
        self._last = now
        self._least = min(self._least, now - sent)
        return now - sent - self._least <= _LATE


class Hold:
    """
    The lease that one page holds while a loop runs by its heartbeat.

    Parameters
    ----------
    keep
        Sends a lease [s].
    stop
        Stops the loop.
    now
        The time [s].

    """

    def __init__(
        self, keep: Callable[[float], None], stop: Callable[[], object], now: Callable[[], float]
    ) -> None:
        self._keep, self._stop, self._now = keep, stop, now
        self._beat = -inf
        self._heartbeat = Heartbeat()
        self.holding = False

    @property
    def beats(self) -> bool:
        """Tell whether a fresh beat came so recently that it may begin to run."""
        return self._now() - self._beat < _LATE

    @property
    def left(self) -> float | None:
        """Return how long the lease lasts without another beat [s], None without one."""
        return max(0.0, self._beat + LEASE - self._now()) if self.holding else None

    def beat(self, number: float, sent: float, idle: bool = False) -> None:
        """
        Take a beat, and renew the lease if it is fresh and the lease has not run out.

        An ``idle`` one only tells how far the clocks are apart.
        """
        now = self._now()
        if not self._heartbeat.is_fresh(number, sent, now) or idle:
            return
        self.look()
        self._beat = now
        if self.holding:
            self._keep(LEASE)

    def begin(self) -> None:
        """Give the first lease, before the loop is enabled."""
        self.holding = True
        self._keep(LEASE)

    def look(self) -> bool:
        """Stop the loop if the lease ran out, and tell whether it did."""
        if not self.holding or self._now() - self._beat <= LEASE:
            return False
        self.end()
        return True

    def end(self) -> None:
        """Stop the loop, if it runs by this lease."""
        if self.holding:
            self.holding = False
            self._stop()
