"""Linear systems as matrices: poles, stability, frequency response."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


class StateSpace(NamedTuple):
    """
    x' = a x + b u, y = c x + d u; with ``h > 0`` [s] x' is the state one period later.

    Shapes: a (N, N), b (N, inputs), c (outputs, N), d (outputs, inputs).
    """

    a: Array
    b: Array
    c: Array
    d: Array
    h: float = 0.0


def pick(system: StateSpace, inputs: Sequence[int], outputs: Sequence[int]) -> StateSpace:
    """Return the part of ``system`` from some inputs to some outputs."""
    d = system.d[np.ix_(list(outputs), list(inputs))]
    return system._replace(b=system.b[:, list(inputs)], c=system.c[list(outputs)], d=d)


def balance(a: Array) -> Array:
    """Return the powers of two by which states are scaled to make a matrix of even entries."""
    _, (scale, _) = linalg.matrix_balance(a, permute=False, separate=True)
    return np.asarray(scale, dtype=float)


def balanced(system: StateSpace) -> StateSpace:
    """Return the same system in coordinates of comparable size (powers of two: exact)."""
    scale = balance(system.a)
    return system._replace(
        a=system.a * scale / scale[:, None], b=system.b / scale[:, None], c=system.c * scale
    )


def poles(system: StateSpace) -> Complex:
    """
    Return the eigenvalues of a, shape (N,); [rad/s] when continuous.

    Discrete ones are found as 1 + eig(a - I): for an N-fold pole rounding moves them by
    (1e-16)^(1/N) of the matrix norm, and that of a - I is about w h instead of 1.
    """
    shift = 1.0 if system.h > 0.0 else 0.0
    eigenvalues: Complex = shift + linalg.eigvals(system.a - shift * np.eye(len(system.a)))
    return eigenvalues


def growth(system: StateSpace) -> float:
    """Return max |z| of a discrete system, max Re s [1/s] of a continuous one."""
    p = poles(system)
    return float(max(abs(p)) if system.h > 0.0 else max(p.real))


def is_stable(system: StateSpace) -> bool:
    """Whether every pole is strictly inside the unit circle, or the left half plane."""
    return growth(system) < (1.0 if system.h > 0.0 else 0.0)


def natural_frequencies(system: StateSpace) -> Array:
    """Return |s| of every pole [rad/s], shape (N,); |ln z| / h of discrete ones."""
    p = poles(system)
    if system.h > 0.0:
        return np.abs(np.log(np.where(p == 0.0, 1e-300, p)) / system.h)
    return np.abs(p)


def frequency_response(system: StateSpace) -> Callable[[ArrayLike], Complex]:
    """
    Return c (p I - a)^-1 b + d at p = j omega, or exp(j omega h), as a function of omega.

    omega [rad/s] may have any shape (...); the result has the shape (..., outputs, inputs).
    """
    a, b, c, d, h = balanced(system)
    identity = np.eye(len(a))
    shifted = a - identity if h > 0.0 else a

    def at(omega: ArrayLike) -> Complex:
        s = 1j * np.asarray(omega, dtype=float)
        shift = np.expm1(s * h) if h > 0.0 else s
        inputs = b.reshape((1,) * shift.ndim + b.shape)  # NumPy 1 takes b alone for many vectors
        return np.asarray(
            c @ np.linalg.solve(shift[..., None, None] * identity - shifted, inputs) + d
        )

    return at


def split_delay(delay: float, h: float) -> tuple[int, float]:
    """Return how many whole periods of ``h`` are in a delay, and what is left of it [s]."""
    whole = int(delay / h * (1.0 + 1e-12))
    return whole, max(delay - whole * h, 0.0)


def zero_order_hold(system: StateSpace, h: float, delay: float = 0.0) -> StateSpace:
    """
    Return the continuous ``system`` sampled every ``h`` seconds, its input held.

    ``delay`` [s], any fraction of a period, is between the hold and the system: of the period
    that starts at t_k its first part sees an input one period older. The inputs on their way
    become states. Source: K. Astrom, B. Wittenmark, Computer-Controlled Systems, 3rd ed., 3.2.

    Raises
    ------
    ValueError
        For a system that is sampled already or has a feedthrough d, or a negative delay.

    """
    if system.h > 0.0 or np.any(system.d) or delay < 0.0:
        raise ValueError('a continuous system without feedthrough, and a delay >= 0, is needed')
    n, m = system.b.shape
    whole, late = split_delay(delay, h)
    if late <= 1e-12 * h:
        late = 0.0
    after, new = held(system, h - late)
    before, older = held(system, late) if late > 0.0 else (np.eye(n), np.zeros((n, m)))
    a, old = after @ before, after @ older
    waiting = whole + (late > 0.0)
    size = n + waiting * m
    big = np.zeros((size, size))
    big[:n, :n] = a
    big[n:, n:] = np.eye(waiting * m, k=-m)  # block j >= 1 holds the input of j periods ago
    enter = np.zeros((size, m))
    enter[n:] = np.eye(waiting * m, m)
    for gain, age in ((new, whole), (old, whole + 1)):
        if age == 0:
            enter[:n] += gain
        elif age <= waiting:
            big[:n, n + (age - 1) * m : n + age * m] += gain
    c = np.hstack([system.c, np.zeros((len(system.c), waiting * m))])
    return StateSpace(big, enter, c, np.array(system.d), h)


def held(system: StateSpace, h: float) -> tuple[Array, Array]:
    """Return exp(a h) and the integral of exp(a s) b over 0..h."""
    n, m = system.b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = system.a, system.b
    e = _exponential((block * h).tobytes(), n + m)
    return e[:n, :n].copy(), e[:n, n:].copy()


@lru_cache(maxsize=32)
def _exponential(matrix: bytes, size: int) -> Array:
    """Return the exponential: the same plant is sampled for every design that is compared."""
    # a copy, as SciPy before 1.12 takes no array that is read-only
    exponential: Any = linalg.expm(np.frombuffer(matrix).reshape(size, size).copy())
    return np.asarray(exponential, dtype=float)
