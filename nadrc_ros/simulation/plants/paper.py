"""The plant of the paper."""

from __future__ import annotations

from math import sin
from typing import ClassVar

import attrs
from nadrc_ros.adrc.fields import number
from nadrc_ros.adrc.settings import LARGEST, SMALLEST
from nadrc_ros.simulation.vector import MutableVector, Vector


@attrs.frozen(kw_only=True)
class PaperPlant:
    """
    x1' = x2, x2' = a1 x1 + a2 sin(x2) + w + (1 + a3 sin t) u, y = x1.

    Source: eq. (26) of the paper (Abdul-Adheem & Ibraheem, nested linear extended state
    observers), with a1 = 0.2 and a2 = 0.1. The paper does not give a3: 0.2 is a choice of this
    package.
    """

    order: ClassVar[int] = 2
    states: ClassVar[int] = 2
    b0: ClassVar[float] = 1.0

    a1: float = number(
        0.2, SMALLEST, LARGEST, '1/s^2', 'stiffness a1 of eq. (26), positive is unstable'
    )
    a2: float = number(0.1, SMALLEST, LARGEST, '1/s^2', 'gain a2 of sin(x2) in eq. (26)')
    # From 1 on the input gain would change its sign.
    a3: float = number(0.2, -0.9, 0.9, '', 'gain variation a3 of eq. (26), not given in the paper')

    def derivative(self, t: float, x: Vector, u: float, w: float, dx: MutableVector) -> None:
        """Write dx/dt into ``dx``."""
        dx[0] = x[1]
        dx[1] = self.a1 * x[0] + self.a2 * sin(x[1]) + w + (1.0 + self.a3 * sin(t)) * u

    def output(self, x: Vector) -> float:
        """Return y = x1."""
        return x[0]
