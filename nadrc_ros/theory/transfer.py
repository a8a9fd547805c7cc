"""
Transfer functions of every structure, continuous (``h = 0``) or as implemented at period ``h``.

Discrete systems have the state p[k] = A x[k-1] + B_u u[k-1], so that x[k] = p[k] + B_y y[k], and
all signals at index k belong to t_k; commands and disturbances are held from t_k on.
"""

from __future__ import annotations

from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.model import disturbance_weights, law_matrices, observer_matrices
from nadrc_ros.theory.system import Complex, StateSpace
import numpy as np


def observer(design: Design, h: float = 0.0) -> StateSpace:
    """Return (u, y) -> all estimates, shape (K N,), with the applied command as an input."""
    a, b_u, b_y = observer_matrices(design, h)
    one, none = np.eye(len(a)), np.zeros(len(a))
    if h > 0.0:
        return StateSpace(a, np.column_stack([b_u, a @ b_y]), one, np.column_stack([none, b_y]), h)
    return StateSpace(a, np.column_stack([b_u, b_y]), one, np.zeros((len(a), 2)))


def total_disturbance(design: Design, h: float = 0.0, levels: int | None = None) -> StateSpace:
    """
    Return G_N: total disturbance L -> d_1 + ... + d_K, or up to ``levels``, for any command.

    Measured from the state of the plant, the estimates obey the observer equations with y = 0 and
    the input -L in place of b0 u. With G_k = (w_k / (s + w_k))^(n+1), conventional has G_1 and
    nested 1 - prod_k (1 - G_k). With the feedback's v given from outside, L may depend on the
    command with a gain below 1 / ||G_N||inf; v depends on the estimates, and allows less.
    """
    a, b_u, _ = observer_matrices(design, h)
    c = disturbance_weights(design, levels)[None, :]
    return StateSpace(a, -b_u[:, None] / design.b0, c, np.zeros((1, 1)), h)


def residual(design: Design, h: float = 0.0, levels: int | None = None) -> StateSpace:
    """
    Return total disturbance L -> L - sum_k d_k, what the levels together leave.

    Nested prod_k (1 - G_k(p)) with p = s, or z and then exactly: in discrete time
    G_k = (1 - z_k)^(n+1) z E_n(z) / (n! (z - z_k)^(n+1)), z_k = exp(-w_k h), z E_n(z) the n-th
    Eulerian polynomial (for L held over each period). Printed: (1 - G_1) / (1 + G_2).
    """
    estimate = total_disturbance(design, h, levels)
    return estimate._replace(c=-estimate.c, d=np.ones((1, 1)))


def controller(design: Design, h: float = 0.0) -> StateSpace:
    """
    Return (y, r, r', ..., r^(n)) -> u: the law in closed form, its own command as the applied one.

    Column 0 is -K(s), or -K(z), and also measurement noise -> command of the controller alone;
    the others are the reference path, which in two-degree-of-freedom form is K times a prefilter
    (see :func:`prefilter`). K has an integrator for every level, so the command of the
    controller alone, without a plant around it, drifts under noise.
    """
    a, b_u, b_y = observer_matrices(design, h)
    f, reference = law_matrices(design)
    closed = a - np.outer(b_u, f)
    into = closed @ b_y if h > 0.0 else b_y
    through = -f @ b_y if h > 0.0 else 0.0
    b = np.column_stack([into, np.outer(b_u, reference)])
    d = np.concatenate([[through], reference])
    if design.error_based:
        b[:, 1] = -into
        d[1] = -through
    return StateSpace(closed, b, -f[None, :], d[None, :], h)


def prefilter(y_to_u: Complex, r_to_u: Complex) -> Complex:
    """
    Return F of u = K (F r - y) from the responses of the two columns: -r_to_u / y_to_u.

    As a system it is improper (degree n+1 over n for one level), so it exists as a response only.
    """
    return np.asarray(-r_to_u / y_to_u)
