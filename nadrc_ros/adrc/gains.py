"""
Current-observer gains that place every pole, in closed form for any order.

The error of the current observer is e+ = (I - L C) Ad e with Ad = exp(A h) of an N-fold integrator
chain, and

    det(z I - Ad + L C Ad) = (z-1)^N + sum_i (l_i h^i / i!) E_i(z) (z-1)^(N-1-i),

E_i(z) = z A_i(z) the i-th Eulerian polynomial (E_0 = 1). Asked to equal prod_q (z - z_q), this is
triangular in powers of z - 1, and its inverse has the generating function ln(1+s)^i / (1+s):

    l_i h^i = sum_{q >= i} T_iq sigma_{q+1}(1 - z_1, ..., 1 - z_N),   T_iq = [s^q] ln(1+s)^i /
    (1+s),

with sigma_q the elementary symmetric polynomials. For equal poles these are the gains of the
fading-memory polynomial filter (N. Morrison, Introduction to Sequential Smoothing and Prediction,
1969).

Only a share g of these gains may act: the polynomial is linear in them, so that it becomes
g prod_q (z - z_q) + (1 - g) (z-1)^N. For g = 1/2 and equal poles at -w the continuous observer has
all its poles on Re s = -w/2: half-gain tuning (G. Herbst, A.-J. Hempel, T. Goehrt, S. Streif,
Half-gain tuning for active disturbance rejection control, IFAC-PapersOnLine 53(2), 2020; of
discrete observers: G. Herbst, A.-J. Hempel, Control Engineering Practice 164, 2025). The sampled
one is stable iff 1 - z < 4 sin^2(pi / 2N): always for N <= 3, up to w h = 0.88, 0.48, 0.31 for N =
4, 5, 6.
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from math import comb


def inversion_matrix(states: int) -> list[list[float]]:
    """Return T, upper triangular, shape (N, N): T_iq = [s^q] ln(1+s)^i / (1+s)."""
    return [list(row) for row in _inversion(states)]


@lru_cache
def _inversion(states: int) -> tuple[tuple[float, ...], ...]:
    """Work T out in fractions, which takes a millisecond, once per order."""
    logarithm = [Fraction(0)] + [Fraction((-1) ** (q + 1), q) for q in range(1, states)]
    row = [Fraction((-1) ** q) for q in range(states)]
    rows = []
    for _ in range(states):
        rows.append(tuple(float(value) for value in row))
        row = [
            sum((row[j] * logarithm[q - j] for j in range(q + 1)), Fraction(0))
            for q in range(states)
        ]
    return tuple(rows)


def equal_pole_matrix(states: int) -> list[list[float]]:
    """Return G (N, N): l_i h^i = sum_{q >= i} G_iq (1-z)^(q+1) when all poles are at z."""
    return [
        [value * comb(states, q + 1) for q, value in enumerate(row)]
        for row in inversion_matrix(states)
    ]
