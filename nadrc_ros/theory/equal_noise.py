"""
Nesting at equal noise: one more level lets more noise through, so all bandwidths must shrink.

Continuous observers (small w h), all poles of level k at -w_k.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import inf

import attrs
from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.theory.noise import disturbance_variance
from nadrc_ros.theory.system import Array
import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize


def nested_design(order: int, bandwidths: Sequence[float]) -> Design:
    """Return a nested design with the given bandwidths [rad/s], one level each."""
    levels = len(bandwidths)
    settings = ControllerSettings(plant_order=order, structure='nested', levels=levels)
    return attrs.evolve(make_design(settings), bandwidths=list(bandwidths))


def noise_factor(order: int, ratios: Sequence[float]) -> float:
    """
    Return Var(sum_k d_k) / (S w^(2n+1)) of levels at ratio_k w under white noise of intensity S.

    n = 2, equal ratios: 0.1875, 0.8027, 1.9472, 3.7632 for K = 1..4.
    """
    return disturbance_variance(nested_design(order, ratios))


def equal_noise_bandwidths(
    order: int, levels: int, ratios: Sequence[float] | None = None
) -> Array:
    """
    Return w_1..w_K over the w of a single level with the same variance of the summed estimate.

    ``ratios`` are the w_k relative to each other (default all equal). The variance goes with
    w^(2n+1), so the common factor is (noise of one / noise of K)^(1 / (2n+1)): 0.7476, 0.6262,
    0.5489 for K = 2, 3, 4 and n = 2.
    """
    shape = [1.0] * levels if ratios is None else list(ratios)
    if len(shape) != levels:
        raise ValueError(f'{levels} levels need {levels} ratios')
    quotient = noise_factor(order, [1.0]) / noise_factor(order, shape)
    return np.asarray(quotient ** (1.0 / (2 * order + 1)) * np.array(shape))


def residual_gain(order: int, bandwidths: Sequence[float], omega: ArrayLike) -> Array:
    """Return |prod_k (1 - G_k(j omega))|, G_k = (w_k / (s + w_k))^(n+1), of the nested levels."""
    s = 1j * np.asarray(omega, dtype=float)
    left = np.ones_like(s)
    for w in bandwidths:
        left = left * (1.0 - (w / (s + w)) ** (order + 1))
    return np.abs(left)


def crossover(order: int, bandwidths: Sequence[float]) -> float:
    """
    Return the frequency, over w_single, above which the levels leave more than one level would.

    ``bandwidths`` over w_single too, from :func:`equal_noise_bandwidths`: 0.2172, 0.1930, 0.1755
    for K = 2, 3, 4 and n = 2. inf if there is none below 100 w.
    """

    def worse(x: float) -> float:
        w = float(np.exp(x))
        pair = residual_gain(order, bandwidths, w), residual_gain(order, [1.0], w)
        return float(np.log(pair[0] / pair[1]))

    grid = np.linspace(np.log(1e-3), np.log(1e2), 600)
    for low, high in pairwise(grid):
        if worse(low) < 0.0 <= worse(high):
            return float(np.exp(optimize.brentq(worse, low, high, rtol=1e-12)))
    return inf
