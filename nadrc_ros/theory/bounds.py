"""
How large the estimation error can get when the total disturbance changes at most at a rate M.

Index i = 1..n+1 counts the states, e_i = x_i - xh_i, e_{n+1} the error of the disturbance. Units:
M is that of y^(n) per second, w [rad/s], so bound i has the unit of y^(i-1).
"""

from __future__ import annotations

from collections.abc import Sequence

from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.lyapunov import lyapunov, scaled_error_matrix
from nadrc_ros.theory.norms import l1_norm
from nadrc_ros.theory.system import Array, StateSpace
from nadrc_ros.theory.transfer import residual, total_disturbance
import numpy as np


def theorem_1(
    order: int, bandwidth: float, rate: float, a: Sequence[float] | None = None
) -> Array:
    """
    Return limsup |e_i| <= M / w^(n+2-i) 2 lmax^2 / lmin, shape (n+1,): eq. (15) with its M.

    Corollary 1, eq. (25), is the same with w' and the bound M' of |de_{n+1}/dt|; it holds for the
    nested structure only (see :func:`error_rate`, :func:`residuals`).
    """
    return rate * lyapunov(order, a).factor / _scale(order, bandwidth) / bandwidth


def theorem_1_transient(
    t: float,
    order: int,
    bandwidth: float,
    rate: float,
    error: Sequence[float],
    a: Sequence[float] | None = None,
) -> Array:
    """
    Return the bound on |e_i(t)|, shape (n+1,), from the initial error e(0) = ``error`` (n+1,).

    Eq. (14) taken back to e_i by (9). Eq. (14) is in the scaled time w t, so the exponent is
    -w t / (2 lmax); after (14), and in Corollary 1, the paper prints -t / (2 lmax).
    """
    found = lyapunov(order, a)
    scale = _scale(order, bandwidth)
    eta = scale * np.asarray(error, dtype=float)
    decay = np.exp(-bandwidth * t / (2.0 * found.largest))
    start = np.sqrt(eta @ found.p @ eta / found.smallest)
    return np.asarray((rate / bandwidth * found.factor * (1.0 - decay) + start * decay) / scale)


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

    The L1 norms of Delta -> residual, residual / s in ``transfer``, for any structure; for level
    1 it is (n+1) / w_1. Continuous observers; sampled ones take L for held over each period, which
    puts them half a period ahead of a continuous L (generalized excepted).
    """
    found = []
    for levels in range(1, design.levels + 1):
        # Under a unit step of L the residual is c e^(a t) x with x minus the final state.
        left = residual(design, levels=levels)
        start = np.asarray(np.linalg.solve(left.a, left.b), dtype=float)
        found.append(l1_norm(StateSpace(left.a, start, left.c, np.zeros((1, 1))))[0])
    return np.array(found)


def cancelled(design: Design) -> float:
    """Return the largest |sum_k d_k| over |L| <= 1: the L1 norm of G_N; 1 for one level."""
    return float(l1_norm(total_disturbance(design))[0])


def _scale(order: int, bandwidth: float) -> Array:
    """Return w^(n+1-i), i = 1..n+1: eta_i = w^(n+1-i) e_i, eq. (9)."""
    return np.asarray(bandwidth ** np.arange(order, -1.0, -1.0))
