"""Whether somebody sets the wall clock of this machine while a node runs."""

from __future__ import annotations

from collections.abc import Callable
import time

from nadrc_ros.ros.diagnostics import Remarks, WARN

# What is less [s] is a clock that is slewed. A look that takes longer than that is void.
_STEP, _LOOK = 0.5, 0.05


class WallClock:
    """
    Says when the wall clock was set.

    Nothing here is timed by it, but stamps are, and waits inside rclpy, which a step back stalls.
    """

    def __init__(
        self,
        remarks: Remarks,
        wall: Callable[[], float] = time.time,
        steady: Callable[[], float] = time.monotonic,
    ) -> None:
        self._remarks = remarks
        self._wall, self._steady = wall, steady
        self._offset: float | None = None

    def look(self) -> None:
        """Look at both clocks; to be called once per second."""
        before, wall, after = self._steady(), self._wall(), self._steady()
        if after - before > _LOOK:
            return
        offset = wall - before
        step = 0.0 if self._offset is None else offset - self._offset
        self._offset = offset
        if abs(step) > _STEP and self._remarks.due('wall clock'):
            way, harm = 'forward', ''
            if step < 0.0:
                way, harm = 'back', ', and waits in nodes of Python may stall: start them again'
            text = f'the wall clock was set {way} by {abs(step):.3g} s: stamps jump{harm}'
            self._remarks.log(text, WARN)
