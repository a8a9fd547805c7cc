"""
The plants by name, and the registry of them. One more is a class and a line at the end.

Every class here keeps to :class:`~nadrc_ros.simulation.protocols.Plant`.
"""

from __future__ import annotations

from math import exp, sin, tanh
from typing import ClassVar

import attrs
from nadrc_ros.adrc.design import polynomial
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import integer, number, numbers, Registry
from nadrc_ros.adrc.settings import FASTEST, HIGHEST, LEAST, LOWEST
from nadrc_ros.simulation.protocols import MAX_ORDER, MutableVector, Plant, Vector


class _Output:
    __slots__ = ()

    def output(self, x: Vector) -> float:
        """Return y = x[0]."""
        return x[0]


@attrs.frozen(kw_only=True)
class PaperPlant(_Output):
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
        0.2, LOWEST, HIGHEST, '1/s^2', 'stiffness a1 of eq. (26), positive is unstable'
    )
    a2: float = number(0.1, LOWEST, HIGHEST, '1/s^2', 'gain a2 of sin(x2) in eq. (26)')
    # From 1 on the input gain would change its sign.
    a3: float = number(0.2, -0.9, 0.9, '', 'gain variation a3 of eq. (26), not given in the paper')

    def derivative(self, t: float, x: Vector, u: float, w: float, dx: MutableVector) -> None:
        """Write dx/dt into ``dx``."""
        dx[0] = x[1]
        dx[1] = self.a1 * x[0] + self.a2 * sin(x[1]) + w + (1.0 + self.a3 * sin(t)) * u


@attrs.frozen(kw_only=True)
class Chain(_Output):
    """
    y^(n) = -damping y^(n-1) + gain u - load + w, the plant that ADRC pretends to have.

    Of order 1 it is a first-order lag: y' = -damping y + gain u - load + w.
    """

    order: int = integer(2, 1, MAX_ORDER, 'number of integrators n', live=False)
    gain: float = number(1.0, LOWEST, HIGHEST, '', 'input gain, also the nominal b0', nonzero=True)
    damping: float = number(0.0, -FASTEST, FASTEST, '1/s', 'damping of the highest state')
    load: float = number(0.0, LOWEST, HIGHEST, '', 'constant load, in units of y^(n)')

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


@attrs.frozen(kw_only=True)
class RealPoles(_Output):
    """
    prod_i (d/dt - p_i) y = gain u - load + w: lags and integrators in series.

    The order is the number of poles. Of a drive whose velocity follows its command with a lag of
    50 ms, gain and poles of the position are 20 v, [-20, 0].
    """

    poles: tuple[float, ...] = numbers(
        (-20.0, 0.0), -FASTEST, FASTEST, 'rad/s', 'real poles p_i', live=False
    )
    gain: float = number(20.0, LOWEST, HIGHEST, '', 'input gain, also b0', nonzero=True)
    load: float = number(0.0, LOWEST, HIGHEST, '', 'constant load, in units of y^(n)')
    # a_0..a_{n-1} of y^(n) + a_{n-1} y^(n-1) + ... + a_0 y.
    damping: tuple[float, ...] = attrs.field(init=False)

    @damping.default
    def _expand(self) -> tuple[float, ...]:
        return tuple(polynomial(self.poles))

    def __attrs_post_init__(self) -> None:
        if len(self.poles) > MAX_ORDER:
            raise SettingError('poles', self.poles, f'a list of 1 to {MAX_ORDER} entries')

    @property
    def order(self) -> int:
        """Return the number of poles."""
        return len(self.poles)

    @property
    def states(self) -> int:
        """Return the number of states: the order."""
        return len(self.poles)

    @property
    def b0(self) -> float:
        """Nominal input gain: the gain."""
        return self.gain

    def derivative(self, t: float, x: Vector, u: float, w: float, dx: MutableVector) -> None:
        """Write dx/dt into ``dx``."""
        top = len(self.damping) - 1
        force = self.gain * u - self.load + w
        for i in range(top + 1):
            force -= self.damping[i] * x[i]
        for i in range(top):
            dx[i] = x[i + 1]
        dx[top] = force


@attrs.frozen(kw_only=True)
class DcMotor(_Output):
    """
    Voltage u [V] to speed [rad/s] and, for the position, angle [rad].

    J speed' = K i - friction - load_torque + J w
    L i' = u - R i - K speed
    friction = dry tanh(speed / smoothing_speed) + viscous speed
    dry = coulomb + (static - coulomb) exp(-(speed / stribeck_speed)^2)

    The last two states are speed and armature current i [A]. The nominal order leaves the
    inductance L out: b0 = K / (J R), and the lag L / R of the current is unmodeled dynamics that
    limits the bandwidth, as in a real drive. As u enters y^(n) only through i, the total
    disturbance y^(n) - b0 u peaks for about L / R after each change of the voltage. The tanh makes
    friction smooth, so the motor creeps where a real one sticks. The default numbers are those of
    a loaded 24 V motor: 16 A stall current, 1 ms electrical and 12 ms mechanical time constant.
    """

    resistance: float = number(1.5, LEAST, HIGHEST, 'Ohm', 'armature resistance R')
    inductance: float = number(1.5e-3, LEAST, HIGHEST, 'H', 'armature inductance L')
    torque_constant: float = number(
        0.05, LEAST, HIGHEST, 'N m/A', 'torque and back-emf constant K'
    )
    inertia: float = number(2e-5, LEAST, HIGHEST, 'kg m^2', 'inertia J of rotor and load')
    viscous: float = number(1e-5, 0.0, HIGHEST, 'N m s/rad', 'viscous friction')
    coulomb: float = number(5e-3, 0.0, HIGHEST, 'N m', 'Coulomb friction torque')
    static: float = number(8e-3, 0.0, HIGHEST, 'N m', 'friction torque near standstill')
    stribeck_speed: float = number(
        5.0, LEAST, HIGHEST, 'rad/s', 'speed at which static turns Coulomb'
    )
    smoothing_speed: float = number(1.0, LEAST, HIGHEST, 'rad/s', 'half width of the smooth sign')
    load_torque: float = number(0.0, LOWEST, HIGHEST, 'N m', 'constant load torque')

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


@attrs.frozen(kw_only=True)
class Pendulum(_Output):
    """
    m l^2 angle'' = u - friction angle' - m g l sin(angle) + m l^2 w, a point mass on a rod.

    The angle [rad] is 0 hanging at rest and pi upright; u is a torque [N m].
    """

    order: ClassVar[int] = 2
    states: ClassVar[int] = 2

    mass: float = number(1.0, LEAST, HIGHEST, 'kg', 'mass m at the tip')
    length: float = number(0.5, LEAST, HIGHEST, 'm', 'length l of the rod')
    friction: float = number(0.05, 0.0, HIGHEST, 'N m s/rad', 'viscous friction of the bearing')
    gravity: float = number(9.81, 0.0, HIGHEST, 'm/s^2', 'gravity g')

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


@attrs.frozen(kw_only=True)
class Thermal(_Output):
    """
    Heater command u [%] to temperature T [degC], of order 1.

    capacity T' = q - loss (T - ambient) + capacity w
    heater_lag q' = power u / 100 - q

    The second state is the heat flow q [W] out of the heater. The nominal order leaves its lag
    out: b0 = power / (100 capacity), and the lag is unmodeled dynamics that limits the bandwidth.
    The default numbers are those of a laboratory oven: 500 W, time constant 10 minutes, 220 degC
    at full power.
    """

    order: ClassVar[int] = 1
    states: ClassVar[int] = 2

    power: float = number(500.0, LEAST, HIGHEST, 'W', 'heat flow at u = 100 %')
    capacity: float = number(1500.0, LEAST, HIGHEST, 'J/K', 'heat capacity')
    loss: float = number(2.5, 0.0, HIGHEST, 'W/K', 'heat flow to the surroundings per difference')
    ambient: float = number(20.0, LOWEST, HIGHEST, 'degC', 'temperature of the surroundings')
    heater_lag: float = number(8.0, LEAST, HIGHEST, 's', 'time constant of the heater')

    @property
    def b0(self) -> float:
        """Nominal input gain power / (100 capacity) [K/s per %], lag left out."""
        return self.power / (100.0 * self.capacity)

    def derivative(self, t: float, x: Vector, u: float, w: float, dx: MutableVector) -> None:
        """Write dx/dt into ``dx``."""
        dx[0] = (x[1] - self.loss * (x[0] - self.ambient)) / self.capacity + w
        dx[1] = (self.power * u / 100.0 - x[1]) / self.heater_lag


PLANTS = Registry[type[Plant]](
    'plant',
    {
        'paper': PaperPlant,
        'chain': Chain,
        'lags': RealPoles,
        'motor': MotorSpeed,
        'motor_position': MotorPosition,
        'pendulum': Pendulum,
        'thermal': Thermal,
    },
)
