"""
The Lyapunov function of the scaled estimation error: Lemma 1 and Theorem 1 of the paper.

In the time w t the scaled errors eta_i = w^(n+1-i) e_i obey eq. (12), eta' = A eta + b Delta / w,
with b = (0, ..., 0, 1) and A of the constants a_1..a_{n+1} in beta_i = a_i w^i.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import NamedTuple

from nadrc_ros.theory.system import Array
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
    """
    matrix = scaled_error_matrix(order, a)
    if max(np.linalg.eigvals(matrix).real) >= 0.0:
        raise ValueError('the a_i are not Hurwitz')
    p = np.asarray(linalg.solve_continuous_lyapunov(matrix.T, -np.eye(order + 1)))
    p = (p + p.T) / 2.0
    values = np.linalg.eigvalsh(p)
    smallest, largest = float(values[0]), float(values[-1])
    return Lyapunov(p, smallest, largest, 2.0 * largest**2 / smallest)
