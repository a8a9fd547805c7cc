"""Nonlinear state error feedback (NLSEF) with fal; see ``state.raw_command`` for the whole law."""

from __future__ import annotations

from math import copysign

from nadrc_ros.adrc.design import Design, Vector


def fal(e: float, alpha: float, delta: float) -> float:
    """
    Return |e|^alpha sign(e), and e / delta^(1-alpha) inside |e| <= delta, where the two agree.

    Source: section II-B of the paper (where it prints |x| for |e|); J. Han, 2009.
    """
    magnitude = abs(e)
    if magnitude <= delta:
        return e / float(delta ** (1.0 - alpha))
    return copysign(magnitude**alpha, e)


def fal_feedback(design: Design, x: Vector, r: Vector, v: float) -> float:
    """
    Return v + sum_i k_i fal(r_i - x_i), in units of y^(n). Shapes: x and r at least (n,).

    The gains k_i are those of (s + wc)^n where it has none of its own.
    """
    i = 0
    while i < design.order:
        v += design.feedback_gains[i] * fal(r[i] - x[i], design.exponents[i], design.fal_delta)
        i += 1
    return v
