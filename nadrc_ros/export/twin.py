"""A controller behind the calls that the exported C has: what that must give, to the bit."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.limiter import clamp
from nadrc_ros.adrc.settings import ControllerSettings


class Twin:
    """
    The controller that ``init``, ``step``, ``no_sample`` and ``enable`` of the C drive.

    ``period`` [s] is that of a fixed rate.
    """

    def __init__(self, settings: ControllerSettings, period: float = nan) -> None:
        self._settings = settings
        self._period = period
        self.init(nan, settings.safe_command)

    def init(self, y: float, u: float) -> None:
        """Begin anew: ``u`` acts now, and ``y``, if it can be a measurement, is the first one."""
        self.controller = controller = Controller(self._settings)
        controller.command = clamp(controller.design, u)
        if controller.design.measurement_min <= y <= controller.design.measurement_max:
            controller.policy = controller.policy._replace(good=1, last=y)
        self._waited = 0.0

    def step(
        self,
        y: float,
        reference: Sequence[float] | None = None,
        applied: float = nan,
        dt: float = nan,
    ) -> float:
        """Take a sample, good or bad, after ``dt`` [s] where the rate is not fixed."""
        elapsed = self._elapsed(dt)
        waited, self._waited = self._waited, 0.0
        return self.controller.tick(
            y, waited + elapsed, elapsed=elapsed, reference=reference, applied=applied
        )

    def no_sample(self, dt: float = nan) -> float:
        """Let a tick pass without one."""
        elapsed = self._elapsed(dt)
        self._waited += elapsed
        return self.controller.tick(elapsed=elapsed)

    def enable(self, on: bool) -> None:
        """Let the law act, or not."""
        self.controller.enabled = on

    def _elapsed(self, dt: float) -> float:
        elapsed = self._period if dt != dt else dt
        return elapsed if elapsed > 0.0 else 0.0
