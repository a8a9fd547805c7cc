"""
How far the loop of the discrete law and a linear plant is from instability.

The loop is opened at the plant: L(z) = K(z) P(z), negative feedback, L = -1 being critical. With
integrators of the plant and of every level, L starts far beyond -180 degrees, so that gain, too
little as well as too much of it, may destabilise, and |L| = 1 may be crossed several times: all
crossings are searched. Source: K. Astrom, R. Murray, Feedback Systems, 2nd ed., ch. 10; I. Landau,
G. Zito, Digital Control Systems, 2006, ch. 2.6 (modulus and delay margin).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import inf, isfinite, pi
from typing import NamedTuple

from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.delayed import (
    delayed_loop,
    is_stable_loop,
    Loop,
    loop_grid,
    open_response,
)
from nadrc_ros.theory.system import Array, Complex, StateSpace
import numpy as np
from numpy.typing import NDArray
from scipy import optimize


class Margins(NamedTuple):
    """
    Distances to instability; of an unstable loop 0, and 1 for both gains.

    ``gain_low`` and ``gain_high``: the factors on the loop gain between which it is stable.
    ``phase`` [rad]: the smallest, of either sign. ``delay`` [s]: the shortest that destabilises,
    taken as the phase exp(-j w t), so exact for whole periods. ``modulus``: min |1 + L|, that is 1
    / ||S||inf. ``crossover`` [rad/s]: the highest frequency with |L| = 1, 0 without one.
    """

    gain_low: float
    gain_high: float
    phase: float
    delay: float
    modulus: float
    crossover: float

    def as_dict(self) -> dict[str, float | None]:
        """Return the numbers by name, None for what is infinite, as JSON takes them."""
        return {k: v if isfinite(v) else None for k, v in self._asdict().items()}


Indices = NDArray[np.intp]
# |L| of two points of the grid between which a crossing lies, one over the other at most: its
# logarithm.
_NEAR = 3.0
UNSTABLE = Margins(1.0, 1.0, 0.0, 0.0, 0.0, 0.0)


def margins(
    design: Design, plant: StateSpace, h: float, delay: float = 0.0, points: int = 3000
) -> Margins:
    """Return the :class:`Margins` of the loop with the continuous ``plant`` at period ``h``."""
    return loop_margins(delayed_loop(design, plant, h, delay), points)


def loop_margins(closed: Loop, points: int = 3000) -> Margins:
    """Return the :class:`Margins` of a loop."""
    h = closed.h
    if not is_stable_loop(closed):
        return UNSTABLE
    respond = open_response(closed)
    loop = cache(respond)  # the ends of brackets, and what was found, are asked for again
    omega = loop_grid(closed, points)
    values = respond(omega)
    size = np.log(np.abs(values))
    brackets = _changes(size)
    crossings = _roots(omega, brackets, lambda w: float(np.log(np.abs(loop(w)))))
    angles = [float(np.angle(-loop(w))) for w in crossings]  # of L, from -180 degrees
    # Of all the turns of a dead time only the crossings near the largest below 1 limit the gain.
    brackets = _changes(values.imag)
    inside = size[brackets][size[brackets] < 0.0]
    brackets = brackets[size[brackets] >= inside.max(initial=-inf) - _NEAR]
    real = [float(loop(w).real) for w in _roots(omega, brackets, lambda w: float(loop(w).imag))]
    real.append(float(loop(pi / h).real))
    factors = [-1.0 / value for value in real if value < 0.0]
    return Margins(
        gain_low=max((f for f in factors if f < 1.0), default=0.0),
        gain_high=min((f for f in factors if f > 1.0), default=inf),
        phase=min((abs(angle) for angle in angles), default=inf),
        delay=min(((angle % (2.0 * pi)) / w for angle, w in zip(angles, crossings)), default=inf),
        modulus=_least_distance(omega, values, loop),
        crossover=max(crossings, default=0.0),
    )


def _changes(values: Array) -> Indices:
    """Return after which points of a grid the sign changes."""
    return np.flatnonzero(np.signbit(values[:-1]) != np.signbit(values[1:]))


def _roots(omega: Array, brackets: Indices, function: Callable[[float], float]) -> list[float]:
    """Return where ``function`` changes sign after points of the grid."""
    return [
        float(optimize.brentq(function, omega[i], omega[i + 1], rtol=1e-12))
        for i in brackets
        if function(omega[i]) * function(omega[i + 1]) < 0.0
    ]


def _least_distance(omega: Array, values: Complex, loop: Callable[[float], Complex]) -> float:
    """Return min |1 + L|, refined around the best point of the grid."""
    i = int(np.argmin(np.abs(1.0 + values)))
    low, high = omega[max(i - 1, 0)], omega[min(i + 1, len(omega) - 1)]
    nearest = optimize.minimize_scalar(
        lambda w: float(np.abs(1.0 + loop(w))), bounds=(low, high), method='bounded'
    )
    return min(float(nearest.fun), float(np.abs(1.0 + values[i])))
