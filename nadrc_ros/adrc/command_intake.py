"""What a controller is told about its command: what really acts, and what to add to it."""

from __future__ import annotations

from collections import deque
from math import copysign, inf, nan

from nadrc_ros.adrc.sample import same
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST, LOWEST

# Changes of our own command that a report may lag.
_KEPT = 1000
# Of a sum of times of ticks.
_ROUNDING = 1.0 + 1e-9


class CommandIntake:
    """
    Takes reports of the applied command, and feed-forward, and knows how old the last ones are.

    Attributes
    ----------
    unfed
        For how long no feed-forward came [s].

    """

    def __init__(self, settings: ControllerSettings) -> None:
        self.unfed = inf
        self._applied, self._applied_age = nan, inf
        self._ours: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._applied_timeout = settings.applied_timeout
        self._feed_forward_timeout = settings.feed_forward_timeout

    def applied(
        self, reported: float | None, age: float, elapsed: float, sent: float
    ) -> tuple[float, float]:
        """
        Return the applied command, and how long ago it was by a report.

        That of the last report while it is younger than ``applied_timeout``, one that just came in
        any case where that is 0; else our own, ``sent``, and nan.
        """
        timeout = self._applied_timeout
        if timeout > 0.0:
            self._ours.append((sent, elapsed))
        if reported is None and self._applied_age == inf:
            return sent, nan
        if reported is not None and LOWEST <= reported <= HIGHEST:
            self._applied, self._applied_age = reported, age if age > 0.0 else 0.0
            counts = timeout == 0.0 or self._applied_age <= timeout
        else:
            self._applied_age += elapsed
            counts = self._applied_age <= timeout
        return (self._applied, self._applied_age) if counts else (sent, nan)

    def compare(self, applied: float, age: float, sent: float) -> tuple[float, bool]:
        """
        Return the command nearest to ``sent`` that may be acting by now, and if another one acted.

        A report is of a command that is older than our last one, by its ``age`` [s]. What we sent
        meanwhile spans a range: where the report is within, nothing but us is known to act, and
        where it is beyond, what acts may have moved as far as we did. It is of another's command
        if we sent none that is equal, as a number of single precision; but for rounding the last
        one is then what was reported.
        """
        if same(sent, applied):
            return applied, False
        low = high = sent
        since = 0.0
        for command, time in reversed(self._ours):  # the first one is ``sent``
            if since > age * _ROUNDING:
                break
            if same(command, applied):
                return sent, False
            low, high = min(low, command), max(high, command)
            since += time
        if applied < low:
            return applied + (sent - low), True
        if applied > high:
            return applied - (high - sent), True
        return sent, True

    def feed_forward(
        self, given: float | None, before: float, rate_limit: float, elapsed: float
    ) -> float:
        """
        Return what is added to the command; ``before`` is what was.

        The last one for ``feed_forward_timeout``, then what the ``rate_limit`` leaves of it.
        """
        if given is not None and LOWEST <= given <= HIGHEST:
            self.unfed = 0.0
            return given
        self.unfed += elapsed
        if self.unfed <= self._feed_forward_timeout:
            return before
        change = rate_limit * elapsed
        if rate_limit == 0.0 or abs(before) <= change:
            return 0.0
        return before - copysign(change, before)
