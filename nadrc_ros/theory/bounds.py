"""
How large the estimation error can get when the total disturbance changes at most at a rate M.

Index i = 1..n+1 counts the states, e_i = x_i - xh_i, e_{n+1} the error of the disturbance. Units:
M is that of y^(n) per second, w [rad/s], so bound i has the unit of y^(i-1).

Lemma 1 and Theorem 1 of the paper rest on a Lyapunov function: in the time w t the scaled errors
eta_i = w^(n+1-i) e_i obey eq. (12), eta' = A eta + b Delta / w, with b = (0, ..., 0, 1) and A of
the constants a_1..a_{n+1} in beta_i = a_i w^i.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import NamedTuple

from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.model import residual
from nadrc_ros.theory.norms import l1_norm
from nadrc_ros.theory.system import Array, StateSpace
import numpy as np
from scipy import linalg


class Lyapunov(NamedTuple):
    """
    P (n+1, n+1) with A'P + PA = -I, its extreme eigenvalues, and 2 lmax^2 / lmin.

    Dimensionless.
    """

    p: Array
    smallest: float
    largest: float
    factor: float


def coefficients(order: int, a: Sequence[float] | None = None) -> Array:
    """Return a_1..a_{n+1}, shape (n+1,): as given, or of (s + 1)^(n+1): the bandwidth choice."""
    if a is None:
        return np.array([float(comb(order + 1, i)) for i in range(1, order + 2)])
    if len(a) != order + 1:
        raise ValueError(f'a must have n + 1 = {order + 1} entries')
    return np.array(a, dtype=float)


def scaled_error_matrix(order: int, a: Sequence[float] | None = None) -> Array:
    """Return A (n+1, n+1) of eq. (12): -a_i in the first column, ones above the diagonal."""
    matrix = np.eye(order + 1, k=1)
    matrix[:, 0] = -coefficients(order, a)
    return matrix


def lyapunov(order: int, a: Sequence[float] | None = None) -> Lyapunov:
    """
    Solve A'P + PA = -I for a Hurwitz A: V = eta'P eta and W = ||eta||^2 of Assumption 3.

    For n = 2 and binomial a_i, P = [[1, -1/2, -1], [-1/2, 1, -1/2], [-1, -1/2, 4]].

    Raises
    ------
    ValueError
        For a_i that are not n + 1, or whose polynomial has a root that does not decay.

    """
    matrix = scaled_error_matrix(order, a)
    if max(np.linalg.eigvals(matrix).real) >= 0.0:
        raise ValueError('the a_i are not Hurwitz')
    p = np.asarray(linalg.solve_continuous_lyapunov(matrix.T, -np.eye(order + 1)))
    p = (p + p.T) / 2.0
    values = np.linalg.eigvalsh(p)
    smallest, largest = float(values[0]), float(values[-1])
    return Lyapunov(p, smallest, largest, 2.0 * largest**2 / smallest)


def theorem_1(
    order: int, bandwidth: float, rate: float, a: Sequence[float] | None = None
) -> Array:
    """
    Return limsup |e_i| <= M / w^(n+2-i) 2 lmax^2 / lmin, shape (n+1,): eq. (15) with its M.

    Corollary 1, eq. (25), is the same with w' and the bound M' of |de_{n+1}/dt|; it holds for the
    nested structure only (see :func:`error_rate`, :func:`residuals`).
    """
    return rate * lyapunov(order, a).factor / _scale(order, bandwidth) / bandwidth


def sharp(order: int, bandwidth: float, rate: float, a: Sequence[float] | None = None) -> Array:
    """
    Return the smallest bound on limsup |e_i|, shape (n+1,): M times the L1 norm of Delta -> e_i.

    For binomial a_i the impulse responses are non-negative, so that it is C(n+1, i-1) M /
    w^(n+2-i), reached by a constant Delta. For others it is computed.
    """
    matrix = scaled_error_matrix(order, a)
    size = order + 1
    last = np.eye(size)[:, -1:]
    gains = l1_norm(StateSpace(matrix, last, np.eye(size), np.zeros((size, 1))))
    return np.asarray(rate / bandwidth * gains / _scale(order, bandwidth))


def error_rate(order: int, a: Sequence[float] | None = None) -> float:
    """
    Return the smallest M'/M with |de_{n+1}/dt| <= M' for every |Delta| <= M.

    It is the L1 norm of 1 - G_1, 2 for binomial a_i: Lemma 2, which says M' <= M, does not hold.
    Independent of the bandwidth.
    """
    matrix = scaled_error_matrix(order, a)
    last = np.eye(order + 1)[:, -1:]
    row = -matrix[-1:] * np.eye(order + 1)[:1]  # dxh_{n+1}/dt = a_{n+1} e_1
    return float(l1_norm(StateSpace(matrix, last, -row, np.ones((1, 1))))[0])


def residuals(design: Design) -> Array:
    """
    Return the smallest bounds on limsup |L - d_1 - ... - d_k| / M, k = 1..K, shape (K,) [s].

    The L1 norms of Delta -> residual, residual / s in ``model``, for any structure; for level
    1 it is (n+1) / w_1. Continuous observers; sampled ones take L for held over each period, which
    puts them half a period ahead of a continuous L (generalized excepted).
    """
    gains = []
    for levels in range(1, design.levels + 1):
        # Under a unit step of L the residual is c e^(a t) x with x minus the final state.
        system = residual(design, levels=levels)
        start = np.asarray(np.linalg.solve(system.a, system.b), dtype=float)
        gains.append(l1_norm(StateSpace(system.a, start, system.c, np.zeros((1, 1))))[0])
    return np.array(gains)


def _scale(order: int, bandwidth: float) -> Array:
    """Return w^(n+1-i), i = 1..n+1: eta_i = w^(n+1-i) e_i, eq. (9)."""
    return np.asarray(bandwidth ** np.arange(order, -1.0, -1.0))
