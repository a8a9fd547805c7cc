"""
The machine as commissioning sees it: a chain with damping, stiffness, friction, load and delay.

y^(n) = b0 (u(t - delay) - load - friction sign(y^(n-1))) - damping y^(n-1) - stiffness y (n = 2)

with y counted from where the machine rests, and standing still where the friction is larger than
what drives it. It is stepped a period at a time: the trapezoidal rule, and exactly through the
moment in which it stops.
"""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np


@attrs.frozen(kw_only=True)
class Model:
    """
    Such a machine: ``order`` 1 or 2.

    ``b0`` [y^(n) per unit command], ``damping`` [1/s], ``stiffness`` [1/s^2], ``friction`` and
    ``load`` [command unit], ``delay`` [s]; ``low`` and ``high`` [output unit] are end stops.
    """

    order: int
    b0: float
    damping: float = 0.0
    stiffness: float = 0.0
    friction: float = 0.0
    load: float = 0.0
    delay: float = 0.0
    low: float = float('-inf')
    high: float = float('inf')

    def response(
        self, commands: Sequence[float], h: float, y: float = 0.0, v: float = 0.0
    ) -> tuple[list[float], float]:
        """
        Return the output at the end of each period, and y' at the end of the last.

        ``commands`` are relative to the one with which it rests, the first ``lead(h)`` of them are
        from before; y and v are the state at the begin.
        """
        lead = self.lead(h)
        whole = int(self.delay / h)
        part = self.delay / h - whole
        old = 1.0 - part
        b, load, dry = self.b0, self.load, abs(self.b0) * self.friction
        half = 0.5 * self.damping * h
        keep, gain, k, low, high = (
            1.0 - half,
            1.0 / (1.0 + half),
            self.stiffness,
            self.low,
            self.high,
        )
        second = self.order == 2
        found = []
        for i in range(lead, len(commands)):
            force = b * (old * commands[i - whole] + part * commands[i - whole - 1] - load)
            x = y
            if second:
                force -= k * y
                x = v
            # x' = force - damping x - dry sign(x)
            if x > 0.0:
                new = (keep * x + (force - dry) * h) * gain
            elif x < 0.0:
                new = (keep * x + (force + dry) * h) * gain
            elif force > dry:
                new = (force - dry) * h * gain
            elif force < -dry:
                new = (force + dry) * h * gain
            else:
                new = 0.0
            path = 0.5 * (x + new) * h
            if x * new < 0.0 and dry > 0.0:
                stop = x / (x - new) * h
                rest = h - stop
                if force > dry:
                    new = (force - dry) * rest * gain
                elif force < -dry:
                    new = (force + dry) * rest * gain
                else:
                    new = 0.0
                path = 0.5 * x * stop + 0.5 * new * rest
            if second:
                y += path
                v = new
            else:
                y = new
            if y <= low:
                y = low
                v = v if v > 0.0 else 0.0
            elif y >= high:
                y = high
                v = v if v < 0.0 else 0.0
            found.append(y)
        return found, v

    def lead(self, h: float) -> int:
        """Return how many commands from before the first period act during the delay."""
        return int(self.delay / h) + 1


class ModelPlant:
    """
    A model to run experiments on, a period of ``h`` [s] at a time.

    Of a seed comes the noise, of a deviation, that it is measured with; ``outputs`` are without.
    """

    def __init__(self, model: Model, h: float, center: float, noise: float, seed: int) -> None:
        self._model, self._h, self._center = model, h, center
        self._noise, self._random = noise, np.random.default_rng(seed)
        self._sent = [0.0] * (model.lead(h) + 1)
        self._y = self._v = 0.0
        self.outputs: list[float] = []

    def measure(self) -> float:
        """Return the output, 0 at first, with noise."""
        self.outputs.append(self._y)
        return self._y + self._noise * float(self._random.standard_normal())

    def advance(self, command: float) -> None:
        """Act so for one period."""
        self._sent.append(command - self._center)
        del self._sent[0]
        (self._y,), self._v = self._model.response(self._sent, self._h, self._y, self._v)
