"""The reference of a controller as it comes on its topics, with the times it was sent at."""

from __future__ import annotations

from collections.abc import Callable

from nadrc_ros.ros.stamps import SampleTimes
from nadrc_ros.ros.topics import Info


class ReferenceInput:
    """
    Keeps what came of r and its derivatives, ``count`` of them, since it was last taken.

    Attributes
    ----------
    span
        Time from when the reference before was sent to when the one was that was taken last [s];
        0 where nothing came, or where the times are not known.

    """

    def __init__(self, count: int) -> None:
        self.span = 0.0
        self._values: list[float | None] = [None] * count
        self._seen: tuple[Info, int] | None = None
        self._times: SampleTimes | None = None
        self._now: Callable[[], int] = lambda: 0

    def time_by(self, times: SampleTimes, now: Callable[[], int]) -> None:
        """Let ``times`` tell the span, with ``now`` as the clock of receipts [ns]."""
        self._times, self._now = times, now

    def receive(self, index: int, value: float, info: Info) -> None:
        """Keep the derivative of that order."""
        self._values[index] = value
        if index == 0 and self._times is not None:
            if self._seen is not None:
                self._times.saw(self._seen[0], info)
            self._seen = info, self._now()

    def take(self) -> list[float | None] | None:
        """Return a reference that came since the last time, None for derivatives that did not."""
        self.span = 0.0
        if self._values[0] is None:
            return None
        if self._times is not None and self._seen is not None:
            self.span = self._times.span(*self._seen)
            self._seen = None
        taken, self._values = self._values, [None] * len(self._values)
        return taken
