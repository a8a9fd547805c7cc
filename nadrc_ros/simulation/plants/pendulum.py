"""A pendulum driven by a torque."""

from __future__ import annotations

from math import sin
from typing import ClassVar

import attrs
from nadrc_ros.adrc.fields import number
from nadrc_ros.adrc.settings import LARGEST, LEAST
from nadrc_ros.simulation.vector import MutableVector, Vector


@attrs.frozen(kw_only=True)
class Pendulum:
    """
    m l^2 angle'' = u - friction angle' - m g l sin(angle) + m l^2 w, a point mass on a rod.

    The angle [rad] is 0 hanging at rest and pi upright; u is a torque [N m].
    """

    order: ClassVar[int] = 2
    states: ClassVar[int] = 2

    mass: float = number(1.0, LEAST, LARGEST, 'kg', 'mass m at the tip')
    length: float = number(0.5, LEAST, LARGEST, 'm', 'length l of the rod')
    friction: float = number(0.05, 0.0, LARGEST, 'N m s/rad', 'viscous friction of the bearing')
    gravity: float = number(9.81, 0.0, LARGEST, 'm/s^2', 'gravity g')

    @property
    def b0(self) -> float:
        """Nominal input gain 1 / (m l^2) [rad/s^2 per N m]."""
        return 1.0 / (self.mass * self.length * self.length)

    def derivative(self, t: float, x: Vector, u: float, w: float, dx: MutableVector) -> None:
        """Write dx/dt into ``dx``."""
        inertia = self.mass * self.length * self.length
        weight = self.mass * self.gravity * self.length
        dx[0] = x[1]
        dx[1] = (u - self.friction * x[1] - weight * sin(x[0])) / inertia + w

    def output(self, x: Vector) -> float:
        """Return y = x[0], the angle."""
        return x[0]
