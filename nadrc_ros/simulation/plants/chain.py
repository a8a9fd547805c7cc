"""A chain of integrators."""

from __future__ import annotations

import attrs
from nadrc_ros.adrc.fields import integer, number
from nadrc_ros.adrc.settings import FASTEST, LARGEST, SMALLEST
from nadrc_ros.simulation.plants.protocol import MAX_ORDER
from nadrc_ros.simulation.vector import MutableVector, Vector


@attrs.frozen(kw_only=True)
class Chain:
    """
    y^(n) = -damping y^(n-1) + gain u - load + w, the plant that ADRC pretends to have.

    Of order 1 it is a first-order lag: y' = -damping y + gain u - load + w.
    """

    order: int = integer(2, 1, MAX_ORDER, 'number of integrators n', live=False)
    gain: float = number(
        1.0, SMALLEST, LARGEST, '', 'input gain, also the nominal b0', nonzero=True
    )
    damping: float = number(0.0, -FASTEST, FASTEST, '1/s', 'damping of the highest state')
    load: float = number(0.0, SMALLEST, LARGEST, '', 'constant load, in units of y^(n)')

    @property
    def states(self) -> int:
        """Return the number of states: the order."""
        return self.order

    @property
    def b0(self) -> float:
        """Nominal input gain: the gain."""
        return self.gain

    def derivative(self, t: float, x: Vector, u: float, w: float, dx: MutableVector) -> None:
        """Write dx/dt into ``dx``."""
        for i in range(self.order - 1):
            dx[i] = x[i + 1]
        top = self.order - 1
        dx[top] = -self.damping * x[top] + self.gain * u - self.load + w

    def output(self, x: Vector) -> float:
        """Return y = x[0]."""
        return x[0]
