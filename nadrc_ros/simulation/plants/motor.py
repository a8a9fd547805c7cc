"""A small permanent-magnet DC motor, as a speed plant (order 1) or a position plant (order 2)."""

from __future__ import annotations

from math import exp, tanh
from typing import ClassVar

import attrs
from nadrc_ros.adrc.fields import number
from nadrc_ros.adrc.settings import LARGEST, LEAST, SMALLEST
from nadrc_ros.simulation.vector import MutableVector, Vector


@attrs.frozen(kw_only=True)
class DcMotor:
    """
    Voltage u [V] to speed [rad/s] and, for the position, angle [rad].

    J speed' = K i - friction - load_torque + J w
    L i'     = u - R i - K speed
    friction = (coulomb + (static - coulomb) exp(-(speed / stribeck_speed)^2))
               tanh(speed / smoothing_speed) + viscous speed

    The last two states are speed and armature current i [A]. The nominal order leaves the
    inductance L out: b0 = K / (J R), and the lag L / R of the current is unmodelled dynamics that
    limits the bandwidth, as in a real drive. As u enters y^(n) only through i, the total
    disturbance y^(n) - b0 u peaks for about L / R after each change of the voltage. The tanh makes
    friction smooth, so the motor creeps where a real one sticks. The default numbers are those of
    a loaded 24 V motor: 16 A stall current, 1 ms electrical and 12 ms mechanical time constant.
    """

    resistance: float = number(1.5, LEAST, LARGEST, 'Ohm', 'armature resistance R')
    inductance: float = number(1.5e-3, LEAST, LARGEST, 'H', 'armature inductance L')
    torque_constant: float = number(
        0.05, LEAST, LARGEST, 'N m/A', 'torque and back-emf constant K'
    )
    inertia: float = number(2e-5, LEAST, LARGEST, 'kg m^2', 'inertia J of rotor and load')
    viscous: float = number(1e-5, 0.0, LARGEST, 'N m s/rad', 'viscous friction')
    coulomb: float = number(5e-3, 0.0, LARGEST, 'N m', 'Coulomb friction torque')
    static: float = number(8e-3, 0.0, LARGEST, 'N m', 'friction torque near standstill')
    stribeck_speed: float = number(
        5.0, LEAST, LARGEST, 'rad/s', 'speed at which static turns Coulomb'
    )
    smoothing_speed: float = number(1.0, LEAST, LARGEST, 'rad/s', 'half width of the smooth sign')
    load_torque: float = number(0.0, SMALLEST, LARGEST, 'N m', 'constant load torque')

    @property
    def b0(self) -> float:
        """Nominal input gain K / (J R) [rad/s^2 per V], inductance left out."""
        return self.torque_constant / (self.inertia * self.resistance)

    def derivative(self, t: float, x: Vector, u: float, w: float, dx: MutableVector) -> None:
        """Write dx/dt into ``dx``; the length of ``x`` tells speed (2) from position (3)."""
        k = len(x) - 2
        speed = x[k]
        current = x[k + 1]
        bend = speed / self.stribeck_speed
        friction = self.coulomb + (self.static - self.coulomb) * exp(-(bend * bend))
        friction = friction * tanh(speed / self.smoothing_speed) + self.viscous * speed
        torque = self.torque_constant * current - friction - self.load_torque
        if k == 1:
            dx[0] = speed
        dx[k] = torque / self.inertia + w
        dx[k + 1] = (
            u - self.resistance * current - self.torque_constant * speed
        ) / self.inductance

    def output(self, x: Vector) -> float:
        """Return y = x[0], the speed or the angle."""
        return x[0]


@attrs.frozen(kw_only=True)
class MotorSpeed(DcMotor):
    """The motor with its speed [rad/s] as output: states speed, current."""

    order: ClassVar[int] = 1
    states: ClassVar[int] = 2


@attrs.frozen(kw_only=True)
class MotorPosition(DcMotor):
    """The motor with its angle [rad] as output: states angle, speed, current."""

    order: ClassVar[int] = 2
    states: ClassVar[int] = 3
