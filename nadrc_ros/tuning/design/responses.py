"""Step responses of discrete systems, and what is read off them."""

from __future__ import annotations

from math import inf

from nadrc_ros.adrc.theory.system import Array, growth, StateSpace
import numpy as np

# A response is followed until it has decayed to this share, at most for that many periods.
DECAYED = 1e-9
LONGEST = 200_000


def step_response(system: StateSpace) -> Array:
    """
    Return the first output after a step of the first input, at t_0, t_1, ..., until it rests.

    Raises
    ------
    ValueError
        For an unstable or continuous system.

    """
    rate = growth(system)
    if system.h <= 0.0 or rate >= 1.0:
        raise ValueError('a stable discrete system is needed')
    steps = int(min(np.log(DECAYED) / np.log(max(rate, 1e-3)), LONGEST)) + len(system.a) + 2
    a, b, c, d = system.a, system.b[:, 0], system.c[0], system.d[0, 0]
    x, response = np.zeros(len(a)), np.empty(steps)
    for k in range(steps):
        response[k] = c @ x + d
        x = a @ x + b
    return response


def settling_time(response: Array, h: float, band: float) -> float:
    """
    Return when a response last enters its final value 1 +- ``band`` [s], inf if it never stays.

    Between two samples ``h`` apart the error is taken as a straight line.
    """
    error = np.abs(response - 1.0)
    outside = np.flatnonzero(error > band)
    if not outside.size:
        return 0.0
    last = int(outside[-1])
    if last + 1 == len(error):
        return inf
    share = (error[last] - band) / (error[last] - error[last + 1])
    return float((last + share) * h)
