"""Step responses of discrete systems, and what is read off them."""

from __future__ import annotations

from math import ceil, inf

from nadrc_ros.adrc.theory.system import Array, growth, StateSpace
import numpy as np

# A response is followed until it has decayed to this share.
DECAYED = 1e-9
# Of one that takes more periods every m-th is enough.
LONGEST = 20_000


def thinned(system: StateSpace) -> StateSpace:
    """Return a stable discrete system every m-th period, its input held, with a period m h."""
    m = ceil(_steps(system) / LONGEST)
    n, inputs = system.b.shape
    block = np.block([[system.a, system.b], [np.zeros((inputs, n)), np.eye(inputs)]])
    power = np.linalg.matrix_power(block, m)
    return system._replace(a=power[:n, :n], b=power[:n, n:], h=m * system.h)


def _steps(system: StateSpace) -> float:
    return float(np.log(DECAYED) / np.log(max(growth(system), 1e-3)))


def step_response(system: StateSpace) -> Array:
    """
    Return the first output after a step of the first input, at t_0, t_1, ..., until it rests.

    Of slow systems take :func:`thinned` first.

    Raises
    ------
    ValueError
        For an unstable or continuous system.

    """
    if system.h <= 0.0 or growth(system) >= 1.0:
        raise ValueError('a stable discrete system is needed')
    steps = int(_steps(system)) + len(system.a) + 2
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
