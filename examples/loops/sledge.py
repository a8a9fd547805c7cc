"""A sledge on a dry guide: it sticks, breaks loose and slides."""

from __future__ import annotations

from collections.abc import MutableSequence, Sequence
from math import exp, tanh


class Sledge:
    """
    Force u [N] on 1 kg to position y [m]: y'' = u - friction(y').

    Friction falls from ``static`` to ``sliding`` [N] within ``stribeck`` [m/s]. It is smooth
    within ``creep`` [m/s], so that what sticks creeps a little.
    """

    order = 2
    states = 2
    b0 = 1.0

    def __init__(
        self,
        static: float = 1.3,
        sliding: float = 1.0,
        stribeck: float = 0.02,
        creep: float = 0.001,
    ) -> None:
        self.static = static
        self.sliding = sliding
        self.stribeck = stribeck
        self.creep = creep

    def derivative(
        self, t: float, x: Sequence[float], u: float, w: float, dx: MutableSequence[float]
    ) -> None:
        """Write dx/dt into dx."""
        bend = x[1] / self.stribeck
        friction = self.sliding + (self.static - self.sliding) * exp(-bend * bend)
        dx[0] = x[1]
        dx[1] = u - friction * tanh(x[1] / self.creep) + w

    def output(self, x: Sequence[float]) -> float:
        """Return y, the position."""
        return x[0]
