"""A step-down converter, and what it is tried with: `nadrc simulate buck_converter.yaml`."""

from __future__ import annotations

from collections.abc import MutableSequence, Sequence
from math import exp

Written = MutableSequence[float]


class Converter:
    """
    Duty cycle to output voltage [V]: L C y'' = supply u - y - L / R y'.

    A coil and a capacitor behind a switch, averaged over its cycles, with a load resistance R.
    """

    order = 2
    states = 2

    def __init__(
        self,
        supply: float = 20.0,
        inductance: float = 0.01,
        capacitance: float = 1e-3,
        load: float = 50.0,
    ) -> None:
        self.coil = inductance * capacitance
        self.drain = 1.0 / (load * capacitance)
        self.b0 = supply / self.coil

    def derivative(self, t: float, x: Sequence[float], u: float, w: float, dx: Written) -> None:
        """Write dx/dt into dx."""
        dx[0] = x[1]
        dx[1] = self.b0 * u - x[0] / self.coil - self.drain * x[1] + w

    def output(self, x: Sequence[float]) -> float:
        """Return y, the voltage."""
        return x[0]


class SmoothStep:
    """A step from start to end through the filter 1 / (1 + s / speed)^5."""

    def __init__(
        self, start: float = 4.0, end: float = 10.0, speed: float = 400.0, time: float = 0.02
    ) -> None:
        self.start = start
        self.height = end - start
        self.speed = speed
        self.time = time

    def derivatives(self, t: float, out: Written) -> None:
        """Write r, r', r'' into out, as many as it takes."""
        p = self.speed * (t - self.time)
        out[0] = self.start
        if p > 0.0:
            rest = exp(-p)
            terms = 1.0 + p * (1.0 + p / 2.0 * (1.0 + p / 3.0 * (1.0 + p / 4.0)))
            out[0] += self.height * (1.0 - rest * terms)
            scale = self.height * self.speed * rest * p * p * p / 24.0
            if len(out) > 1:
                out[1] = scale * p
            if len(out) > 2:
                out[2] = scale * self.speed * (4.0 - p)


class Load:
    """What the load does to y'' [V/s^2]: a jump, a ramp, nothing again."""

    times = (0.04, 0.06, 0.08)
    levels = (-2e5, 1e5, 0.0)
    slopes = (0.0, 5e6, 0.0)

    def derivatives(self, t: float, out: Written) -> None:
        """Write the disturbance into out[0]."""
        out[0] = 0.0
        for i in range(len(self.times)):
            if t >= self.times[i]:
                out[0] = self.levels[i] + self.slopes[i] * (t - self.times[i])
