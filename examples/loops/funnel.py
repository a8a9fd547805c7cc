"""A funnel that a pump fills: the higher the level, the wider it is and the less it moves."""

from __future__ import annotations

from collections.abc import MutableSequence, Sequence
from math import pi, sqrt


class Funnel:
    """
    Inflow u [ml/s] to level y [cm]: A(y) y' = u - drain sqrt(y), A(y) = pi (slope y)^2.

    The input gain 1 / A(y) falls by a factor of 16 from 2 to 8 cm; ``b0`` is that at ``nominal``.
    """

    order = 1
    states = 1

    def __init__(self, slope: float = 0.5, drain: float = 8.0, nominal: float = 4.0) -> None:
        self.slope = slope
        self.drain = drain
        self.b0 = 1.0 / (pi * (slope * nominal) ** 2)

    def derivative(
        self, t: float, x: Sequence[float], u: float, w: float, dx: MutableSequence[float]
    ) -> None:
        """Write dx/dt into dx."""
        level = max(x[0], 0.2)
        dx[0] = (u - self.drain * sqrt(level)) / (pi * (self.slope * level) ** 2) + w

    def output(self, x: Sequence[float]) -> float:
        """Return y, the level."""
        return x[0]


class Filling:
    """The level that is asked for: a small step low down, a large one, a small one high up."""

    times = (0.5, 3.0, 6.0)
    levels = (0.5, 5.0, 0.5)

    def derivatives(self, t: float, out: MutableSequence[float]) -> None:
        """Write the level into out[0]."""
        out[0] = 2.0
        for i in range(len(self.times)):
            if t >= self.times[i]:
                out[0] += self.levels[i]
