"""Gains of a stable system: the largest for sinusoids, and L1 for bounded signals."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, inf, log2, pi

from nadrc_ros.theory.system import (
    Array,
    balanced,
    Complex,
    held,
    is_stable,
    natural_frequencies,
    poles,
    StateSpace,
)
import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize

# Over how many time constants an impulse response is followed, and samples per fastest one.
_TIME_CONSTANTS = 70.0
_SAMPLES_EACH = 100


def peak(at: Callable[[ArrayLike], Complex], omega: Array) -> float:
    """Return the largest singular value of a response at 0 and around ``omega``, sorted."""

    def gain(w: float) -> float:
        return float(np.linalg.norm(at(w), 2))

    gains = np.linalg.norm(at(omega), 2, axis=(1, 2))
    best = max(float(gains.max()), gain(0.0))
    for i in range(1, len(omega) - 1):
        if gains[i] >= max(gains[i - 1], gains[i + 1], 0.9 * best):
            top = optimize.minimize_scalar(
                lambda x: -gain(float(np.exp(x))),
                bounds=(np.log(omega[i - 1]), np.log(omega[i + 1])),
                method='bounded',
                options={'xatol': 1e-9},
            )
            best = max(best, -float(top.fun))
    return best


def frequency_grid(*systems: StateSpace, points: int = 1500) -> Array:
    """Return frequencies [rad/s] well around all poles, those of the poles included, sorted."""
    near = np.concatenate([natural_frequencies(system) for system in systems])
    h = max(system.h for system in systems)
    high = pi / h if h > 0.0 else 1e3 * near.max()
    near = np.minimum(near, high)  # what is faster than the sampling, as a delay is, is not seen
    near = near[near > 1e-6 * near.max()]
    low = 1e-3 * near.min()
    grid = np.concatenate([np.geomspace(low, high, points), near[near < high]])
    return np.unique(grid)


def l1_norm(system: StateSpace) -> Array:
    """
    Return the L1 norm of the impulse response to a single input, shape (outputs,).

    It is the largest |output| that an input bounded by 1 can reach, and no smaller bound holds
    (M. Vidyasagar, Optimal rejection of persistent bounded disturbances, IEEE Trans. Autom.
    Control 31(6), 1986). Computed as the total variation of the step response, to about 1e-4; inf
    when unstable.

    Raises
    ------
    ValueError
        For a system of more than one input.

    """
    if system.b.shape[1] != 1:
        raise ValueError('one input at a time')
    if not is_stable(system):
        return np.full(len(system.c), inf)
    system = balanced(system)
    through = np.abs(system.d[:, 0])
    if system.h > 0.0:
        slowest = -np.log(max(*np.abs(poles(system)), 1e-3))
        impulse = system.c @ _orbit(system.a, system.b[:, 0], _TIME_CONSTANTS / slowest)
        return np.asarray(through + np.abs(impulse).sum(axis=1))
    p = poles(system)
    dt = 1.0 / (_SAMPLES_EACH * np.abs(p).max())
    transition, _ = held(system, dt)
    settled = np.asarray(np.linalg.solve(system.a, system.b[:, 0]), dtype=float)
    step = system.c @ _orbit(transition, settled, _TIME_CONSTANTS / -p.real.max() / dt)
    return np.asarray(through + np.abs(np.diff(step, axis=1)).sum(axis=1))


def _orbit(a: Array, x: Array, steps: float) -> Array:
    """Return x, a x, a^2 x, ..., shape (N, count), count a power of two >= steps."""
    orbit, power = x[:, None], a
    for _ in range(ceil(log2(max(steps, 2.0)))):
        orbit = np.hstack([orbit, power @ orbit])
        power = power @ power
    return orbit
