"""
The law as matrices: all observer levels together, and the linear feedback.

x stacks the levels, shape (K N,): x = (level 1, ..., level K), each (y, y', ..., y^(n-1), d_k,
...). From one sample to the next

    x[k] = A x[k-1] + B_u u[k-1] + B_y y[k],      u[k] = -F x[k] + H r[k],

r = (r, r', ..., r^(n)). In continuous time x' = A x + B_u u + B_y y.

The limits, the tracking differentiator and the rise of the bandwidths after a start are not in it,
and the nonlinear parts are taken inside their linear zones, which makes of the nonlinear structure
the nested one.
"""

from __future__ import annotations

from math import exp, factorial

from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.gains import observer_gains
from nadrc_ros.theory.system import Array
import numpy as np


def pole_frequencies(design: Design, level: int) -> list[float]:
    """Return the N poles, times -1 [rad/s], that place the gains of a level (from 0)."""
    w = design.bandwidths[level]
    if design.equal_poles:
        return [w] * design.states
    return [ratio * w for ratio in design.pole_ratios]


def observer_matrices(design: Design, h: float = 0.0) -> tuple[Array, Array, Array]:
    """
    Return A (K N, K N), B_u (K N,) and B_y (K N,); continuous for ``h = 0``.

    Continuous: eq. (3) and (20) of the paper with the input of the structure. Discrete: the
    current observer x <- (I - L C)(Ad x + Bd v) + L y with v and L as in ``adrc.observer``.
    """
    n, size = design.order, design.states
    a = np.zeros((design.levels * size, design.levels * size))
    b_u, b_y = np.zeros(len(a)), np.zeros(len(a))
    for k in range(design.levels):
        rows = slice(k * size, (k + 1) * size)
        predict, push, gain, keep = _level(design, k, h)
        # x_k <- keep (predict x_k + push v) + gain y_k, or the same with x_k' on the left.
        a[rows, rows] += keep @ predict
        b_u[rows] = keep @ push * design.b0
        for j in range(design.reach[k]):
            a[rows, j * size + n] += keep @ push
        if design.chained and k > 0:
            before = (k - 1) * size
            if h > 0.0:  # the new output estimate of the level before, itself a sum of inputs
                a[rows] += np.outer(gain, a[before])
                b_u[rows] += gain * b_u[before]
                b_y[rows] = gain * b_y[before]
            else:
                a[rows, before] += gain
        else:
            b_y[rows] = gain
    return a, b_u, b_y


def _level(design: Design, k: int, h: float) -> tuple[Array, Array, Array, Array]:
    """Return the prediction (N, N), its input (N,), the gains (N,) and I - L C or I."""
    n, size = design.order, design.states
    frequencies = pole_frequencies(design, k)
    one = np.eye(size)
    push = np.zeros(size)
    if h > 0.0:
        powers = [h**i / factorial(i) for i in range(size)]
        predict = sum(power * np.eye(size, k=i) for i, power in enumerate(powers))
        push[:n] = powers[n:0:-1]
        gain = np.array(observer_gains(size, h, [exp(-w * h) for w in frequencies]))
        gain *= design.gain_factor
        return np.asarray(predict), push, gain, one - np.outer(gain, one[0])
    push[n - 1] = 1.0
    gain = design.gain_factor * np.asarray(np.poly([-w for w in frequencies])[1:], dtype=float)
    return np.eye(size, k=1) - np.outer(gain, one[0]), push, gain, one


def law_matrices(design: Design) -> tuple[Array, Array]:
    """
    Return F (K N,) and H (n+1,) of the command u = -F x + H r, before the limits.

    v = sum_i k_i (r_i - x_i) + r_{n+1} and b0 u = v - sum_k d_k, over the levels that the
    structure cancels. The fal law is taken inside its linear zone, where it has the gains
    k_i / delta^(1 - alpha_i). Error-based, H = 0.
    """
    n, size = design.order, design.states
    gains = np.array(design.feedback_gains)
    if not design.linear:
        gains = gains * design.delta ** (np.array(design.exponents) - 1.0)
    f, reference = np.zeros(design.levels * size), np.zeros(n + 1)
    f[design.feedback_level * size : design.feedback_level * size + n] = gains
    f += disturbance_weights(design, design.cancelled)
    if not design.error_based:
        reference[:n], reference[n] = gains, 1.0
    return f / design.b0, reference / design.b0


def disturbance_weights(design: Design, levels: int | None = None) -> Array:
    """Return the row, shape (K N,), that adds d_1 + ... up to ``levels`` (default all)."""
    row = np.zeros(design.levels * design.states)
    row[design.order :: design.states] = 1.0
    row[(design.levels if levels is None else levels) * design.states :] = 0.0
    return row
