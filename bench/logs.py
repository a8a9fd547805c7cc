"""
Logs of plants in loops, by simulators that nothing of the package is in.

A plant is a line of Python, integrated by Runge and Kutta's method or by SciPy's solve_ivp, and
its controller is a PID that is written here.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import attrs
from nadrc_ros.records.recorded_run import RecordedRun
import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

Array = npt.NDArray[np.float64]
Slope = Callable[[Array, float, float], list[float]]  # of state, command and disturbance
Signal = Callable[[Array], Array]
INF = float('inf')


@attrs.frozen(kw_only=True)
class Pid:
    """A PI or PID with a filtered derivative of the measurement and held integral at limits."""

    p: float
    i: float = 0.0
    d: float = 0.0
    filter: float = 0.1
    low: float = -INF
    high: float = INF
    offset: float = 0.0

    def run(self, h: float) -> Callable[[float, float], float]:
        total, slow = self.offset, None

        def command(r: float, y: float) -> float:
            nonlocal total, slow
            slow = y if slow is None else slow
            rate = (y - slow) / self.filter
            slow += (y - slow) * (1.0 - np.exp(-h / self.filter))
            u = self.p * (r - y) + total - self.d * rate
            if self.low < u < self.high or (r - y) * u < 0.0:
                total += self.i * h * (r - y)
            return float(min(max(u, self.low), self.high))

        return command


@attrs.frozen(kw_only=True)
class Case:
    """
    One plant and its experiment.

    ``b0`` has the true gain of each order that is true: a lag tau that is told apart from the
    other dynamics makes a plant of order n one of order n + 1 with b0 / tau.
    """

    b0: dict[int, float]
    slope: Slope
    h: float
    seconds: float
    reference: Signal
    controller: Pid | None = None
    start: tuple[float, ...] = (0.0,)
    late: int = 0
    noise: float = 0.0
    colour: float = 0.0  # pole of a filter in the sensor, that the noise has passed
    disturbance: float = 0.0
    steps: int = 2
    outside: bool = False
    step: float = 0.0
    play: float = 0.0
    cut: int = 0
    repeated: float = 0.0
    recorded: bool = True

    @property
    def order(self) -> int:
        """Return the order by which the plant is known."""
        return min(self.b0)

    def log(self, seed: int) -> RecordedRun:
        """Return what a recorder would have written; noise, disturbance and phase are random."""
        rng = np.random.default_rng(seed)
        count = int(self.seconds / self.h)
        t: Array = self.h * np.arange(count, dtype=np.float64)
        r: Array = np.asarray(self.reference(t + 0.03 * self.seconds * rng.uniform()), float)
        slow = np.exp(-self.h / (0.02 * self.seconds))
        pushes: Array = lfilter([np.sqrt(1.0 - slow**2)], [1.0, -slow], rng.normal(size=count))
        noise: Array = lfilter([self.noise], [1.0, -self.colour], rng.normal(size=count))
        y, u = self._loop(r, self.disturbance * pushes, noise)
        kept = np.arange(count)
        if self.repeated:
            kept = kept - (rng.uniform(size=count) < self.repeated)
        seen = r[np.maximum(kept, 0)] if self.recorded else np.full(count, np.nan)
        columns = {'time': t, 'reference': seen, 'measurement': y, 'command': u}
        columns = {name: values[self.cut :] for name, values in columns.items()}
        return RecordedRun(
            path=Path('log'),
            rate=1.0 / self.h,
            stop=float(columns['time'][-1]),
            columns=columns,
            summary={},
        )

    def _loop(self, r: Array, pushes: Array, noise: Array) -> tuple[Array, Array]:
        x, command = np.array(self.start), self.controller.run(self.h) if self.controller else None
        output, sent = np.empty_like(r), np.empty_like(r)
        ahead = [self.controller.offset if self.controller else r[0]] * self.late
        seen = x[0]
        for k, (ref, push) in enumerate(zip(r.tolist(), pushes.tolist())):
            seen = min(max(seen, x[0] - self.play / 2), x[0] + self.play / 2)
            y = (seen if self.play else x[0]) + noise[k]
            output[k] = self.step * round(y / self.step) if self.step else y
            sent[k] = command(ref, output[k]) if command else ref
            ahead.append(float(sent[k]))
            x = self._moved(x, ahead.pop(0), push)
        return output, sent

    def _moved(self, x: Array, u: float, push: float) -> Array:
        if self.outside:
            found = solve_ivp(
                lambda t, z: self.slope(z, u, push), (0.0, self.h), x, rtol=1e-7, atol=1e-9
            )
            return np.asarray(found.y[:, -1])
        h = self.h / self.steps
        for _ in range(self.steps):
            a = np.array(self.slope(x, u, push))
            b = np.array(self.slope(x + 0.5 * h * a, u, push))
            c = np.array(self.slope(x + 0.5 * h * b, u, push))
            d = np.array(self.slope(x + h * c, u, push))
            x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        return x


def square(low: float, high: float, half: float) -> Signal:
    """Return a signal that changes between two values every ``half`` seconds."""
    return lambda t: np.where(np.floor(t / half) % 2 == 0, low, high)


def chirp(size: float, slow: float, fast: float, seconds: float) -> Signal:
    """Return a sine whose angular frequency grows from slow to fast within the time."""
    return lambda t: size * np.sin((slow + 0.5 * (fast - slow) * t / seconds) * t)


def moves(size: float, rate: float, half: float) -> Signal:
    """Return moves to and fro at a constant rate, with rests."""

    def value(t: Array) -> Array:
        phase = t / half % 2.0
        ramp = np.minimum(phase, 1.0) - np.maximum(phase - 1.0, 0.0)
        return np.asarray(np.clip((ramp - 0.5) * rate * half, -size / 2, size / 2))

    return value


def random_steps(low: float, high: float, hold: float) -> Signal:
    """Return a value drawn anew every ``hold`` seconds."""

    def value(t: Array) -> Array:
        levels = np.random.default_rng(17).uniform(low, high, size=int(t[-1] / hold) + 2)
        return np.asarray(levels[(t / hold).astype(int)])

    return value


def multisine(size: float, slow: float, fast: float) -> Signal:
    """Return eight sines [rad/s] with the phases of Schroeder."""
    w = np.geomspace(slow, fast, 8)
    return lambda t: size / 4.0 * sum(np.sin(f * t - k * k * np.pi / 8) for k, f in enumerate(w))
