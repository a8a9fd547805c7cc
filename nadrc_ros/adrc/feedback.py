"""State error feedback: linear with reference feed-forward, or nonlinear with fal (NLSEF)."""

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


def feedback(design: Design, x: Vector, r: Vector) -> float:
    """
    Return v = sum_i k_i g(r_i - x_i) + r_{n+1}, g the identity or fal, in units of y^(n).

    Shapes: x at least (n,), r (n+1,). The gains k_i are the coefficients of (s + wc)^n unless fal
    has its own. The paper never writes the sum.
    """
    order = design.order
    gains = design.feedback_gains
    v = r[order]
    i = 0
    if design.linear:
        while i < order:
            v += gains[i] * (r[i] - x[i])
            i += 1
    else:
        while i < order:
            v += gains[i] * fal(r[i] - x[i], design.exponents[i], design.fal_delta)
            i += 1
    return v
