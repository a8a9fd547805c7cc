"""
The machine as commissioning sees it: a chain with damping, stiffness, friction, load and delay.

x^(n) = b0 (u(t - delay) - load - friction sign(x^(n-1))) - damping x^(n-1) - stiffness x (n = 2)

with x counted from where the machine rests, and standing still where the friction is larger than
what drives it. It is stepped a period at a time: the trapezoidal rule, and exactly through the
moment in which it stops. Beside it a mode may swing, of which the output has a share:

q'' = b0 u(t - delay) - 2 zeta w q' - w^2 q,    y = x + share q^(2-n)

sampled exactly with the command held.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import inf

import attrs
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.system import StateSpace, zero_order_hold
from nadrc_ros.tuning.commission.machine import Array
import numpy as np
from scipy.linalg import block_diag
from scipy.signal import lfilter


@attrs.frozen(kw_only=True)
class Model:
    """
    Such a machine: ``order`` 1 or 2.

    ``b0`` [y^(n) per unit command], ``damping`` [1/s], ``stiffness`` [1/s^2], ``friction`` and
    ``load`` [command unit], ``delay`` [s]; ``low`` and ``high`` [output unit] are end stops.
    ``mode_share``, ``mode_frequency`` w [rad/s] and ``mode_damping`` zeta are of a mode, which
    there is none of with frequency 0.
    """

    order: int
    b0: float
    damping: float = 0.0
    stiffness: float = 0.0
    friction: float = 0.0
    load: float = 0.0
    delay: float = 0.0
    low: float = -inf
    high: float = inf
    mode_share: float = 0.0
    mode_frequency: float = 0.0
    mode_damping: float = 0.0

    @property
    def transfer(self) -> StateSpace:
        """Return the plant u -> y without delay and friction."""
        damping = [self.damping] if self.order == 1 else [self.stiffness, self.damping]
        plant = chain(self.order, self.b0, damping)
        if not self.mode_frequency:
            return plant
        mode = self._mode
        b, c = np.vstack((plant.b, mode.b)), np.hstack((plant.c, mode.c))
        return StateSpace(block_diag(plant.a, mode.a), b, c, plant.d)

    @property
    def _mode(self) -> StateSpace:
        """Return the mode u -> y, of state (q, q')."""
        w, zeta = self.mode_frequency, self.mode_damping
        a = np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]])
        c = np.zeros((1, 2))
        c[0, 2 - self.order] = self.mode_share
        return StateSpace(a, np.array([[0.0], [self.b0]]), c, np.zeros((1, 1)))

    def swinging(self, h: float) -> StateSpace:
        """Return the mode sampled every ``h`` [s]."""
        return zero_order_hold(self._mode, h)

    def outputs(self, forces: Array, h: float, y: float, v: float) -> Array:
        """
        Return the output at the end of each period of ``h`` [s], (N,), from the state y, y' on.

        ``forces`` (N,) are the means of the command in each, relative to the one with which it
        rests, as they arrive. A mode is at rest at first.
        """
        found = self._chain_outputs(forces, h, y, v)
        if self.mode_share:
            a, b, c = self.swinging(h)[:3]
            trace, determinant = np.trace(a), np.linalg.det(a)
            one, two = (c @ b).item(), (c @ a @ b).item()
            found = found + lfilter([one, two - trace * one], [1.0, -trace, determinant], forces)
        return found

    def _chain_outputs(self, forces: Array, h: float, y: float, v: float) -> Array:
        if self.friction > 0.0 or self.low > -inf or self.high < inf:
            return np.array(self.response(forces.tolist(), h, y, v)[0])
        # without what makes it stop it is a recursion with constant coefficients
        half, b = 0.5 * self.damping * h, self.b0 * (forces - self.load)
        keep, gain = (1.0 - half) / (1.0 + half), h / (1.0 + half)
        if self.order == 1:
            found: Array = lfilter([gain], [1.0, -keep], b, zi=[keep * y])[0]
            return found
        # (y, v)+ = A (y, v) + (h / 2, 1) gain force
        a = np.array(
            [
                [1.0 - 0.5 * h * gain * self.stiffness, 0.5 * h * (1.0 + keep)],
                [-gain * self.stiffness, keep],
            ]
        )
        trace, determinant = a[0, 0] + a[1, 1], a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
        first = a @ (y, v)
        zi = [first[0], (a @ first)[0] - trace * first[0]]
        ahead = [0.5 * h * gain, gain * (a[0, 1] - 0.5 * h * a[1, 1])]
        found = lfilter(ahead, [1.0, -trace, determinant], b, zi=zi)[0]
        return found

    def response(
        self, forces: Sequence[float], h: float, y: float, v: float
    ) -> tuple[list[float], float]:
        """Return x with what makes it stop, and x' at the end; without the mode."""
        b, load, dry = self.b0, self.load, abs(self.b0) * self.friction
        half = 0.5 * self.damping * h
        keep, gain = 1.0 - half, 1.0 / (1.0 + half)
        k, low, high = self.stiffness, self.low, self.high
        second = self.order == 2
        found = []
        for arrived in forces:
            force = b * (arrived - load)
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


class ModelPlant:
    """
    A model to run experiments on, a period of ``h`` [s] at a time.

    It stands at ``start`` [output unit] at first. Of a seed comes the noise, of a deviation, that
    it is measured with; ``outputs`` are without.
    """

    def __init__(
        self,
        model: Model,
        h: float,
        center: float,
        noise: float,
        seed: int,
        start: float = 0.0,
    ) -> None:
        self._model, self._h, self._center = model, h, center
        self._noise, self._random = noise, np.random.default_rng(seed)
        # the command that acts changes once in a period, from the one sent before
        whole = int(model.delay / h)
        self._old = 1.0 - (model.delay / h - whole)
        self._sent = deque([0.0] * (whole + 2), maxlen=whole + 2)
        self._y, self._v = start, 0.0
        self._mode = model.swinging(h) if model.mode_share else None
        self._swing = np.zeros((2, 1))
        self.outputs: list[float] = []

    def measure(self) -> float:
        """Return the output, with noise."""
        swing = (self._mode.c @ self._swing).item() if self._mode else 0.0
        self.outputs.append(self._y + swing)
        return self.outputs[-1] + self._noise * float(self._random.standard_normal())

    def advance(self, command: float) -> None:
        """Act so for one period."""
        self._sent.append(command - self._center)
        force = self._old * self._sent[1] + (1.0 - self._old) * self._sent[0]
        (self._y,), self._v = self._model.response([force], self._h, self._y, self._v)
        if self._mode:
            self._swing = self._mode.a @ self._swing + self._mode.b * force
