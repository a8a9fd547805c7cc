"""What a controller is told about its command: what really acts, and what to add to it."""

from __future__ import annotations

from math import copysign, inf, nan

from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST, LOWEST


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
        if reported is None and self._applied_age == inf:
            return sent, nan
        timeout = self._applied_timeout
        if reported is not None and LOWEST <= reported <= HIGHEST:
            self._applied, self._applied_age = reported, age if age > 0.0 else 0.0
            counts = timeout == 0.0 or self._applied_age <= timeout
        else:
            self._applied_age += elapsed
            counts = self._applied_age <= timeout
        return (self._applied, self._applied_age) if counts else (sent, nan)

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
