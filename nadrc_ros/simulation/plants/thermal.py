"""A thermal process: an oven, a barrel or a bath with an electric heater that has a lag."""

from __future__ import annotations

from typing import ClassVar

import attrs
from nadrc_ros.adrc.fields import number
from nadrc_ros.adrc.settings import LARGEST, LEAST, SMALLEST
from nadrc_ros.simulation.vector import MutableVector, Vector


@attrs.frozen(kw_only=True)
class Thermal:
    """
    Heater command u [%] to temperature T [degC], of order 1.

    capacity T' = q - loss (T - ambient) + capacity w
    heater_lag q' = power u / 100 - q

    The second state is the heat flow q [W] out of the heater. The nominal order leaves its lag
    out: b0 = power / (100 capacity), and the lag is unmodelled dynamics that limits the bandwidth.
    The default numbers are those of a laboratory oven: 500 W, time constant 10 minutes, 220 degC
    at full power.
    """

    order: ClassVar[int] = 1
    states: ClassVar[int] = 2

    power: float = number(500.0, LEAST, LARGEST, 'W', 'heat flow at u = 100 %')
    capacity: float = number(1500.0, LEAST, LARGEST, 'J/K', 'heat capacity')
    loss: float = number(2.5, 0.0, LARGEST, 'W/K', 'heat flow to the surroundings per difference')
    ambient: float = number(20.0, SMALLEST, LARGEST, 'degC', 'temperature of the surroundings')
    heater_lag: float = number(8.0, LEAST, LARGEST, 's', 'time constant of the heater')

    @property
    def b0(self) -> float:
        """Nominal input gain power / (100 capacity) [K/s per %], lag left out."""
        return self.power / (100.0 * self.capacity)

    def derivative(self, t: float, x: Vector, u: float, w: float, dx: MutableVector) -> None:
        """Write dx/dt into ``dx``."""
        dx[0] = (x[1] - self.loss * (x[0] - self.ambient)) / self.capacity + w
        dx[1] = (self.power * u / 100.0 - x[1]) / self.heater_lag

    def output(self, x: Vector) -> float:
        """Return y = x[0], the temperature."""
        return x[0]
