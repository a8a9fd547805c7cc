"""
The law as matrices, and its transfer functions: all observer levels and the linear feedback.

x stacks the levels, shape (K N,): x = (level 1, ..., level K), each (y, y', ..., y^(n-1), d_k,
...), level 1 with two more states for each known frequency of the disturbance. From one sample
to the next

    x[k] = A x[k-1] + B_u u[k-1] + B_y y[k],      u[k] = -F x[k] + H r[k],

r = (r, r', ..., r^(n)). In continuous time, which ``h = 0`` asks for, x' = A x + B_u u + B_y y.
Transfer functions of period h have the state p[k] = A x[k-1] + B_u u[k-1], so that x[k] = p[k] +
B_y y[k], and all signals at index k belong to t_k; commands and disturbances are held from t_k on.

The limits, the tracking differentiator and the rise of the bandwidths after a start are not in it,
and the nonlinear parts are taken inside their linear zones, which makes of the nonlinear structure
the nested one.
"""

from __future__ import annotations

from math import exp, factorial

from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.gains import inversion_matrix
from nadrc_ros.theory.known import feedback_gains, known_level, own_delay, vibration_matrix
from nadrc_ros.theory.system import Array, StateSpace
import numpy as np


def pole_frequencies(design: Design, level: int) -> list[float]:
    """Return the N poles, times -1 [rad/s], that place the gains of a level (from 0)."""
    w = design.bandwidths[level]
    if design.equal_poles:
        return [w] * design.states
    return [ratio * w for ratio in design.pole_ratios]


def starts(design: Design) -> list[int]:
    """Return where each level begins among the stacked states, and how many there are."""
    return [sum(design.sizes[:k]) for k in range(design.levels + 1)]


def observer_matrices(design: Design, h: float = 0.0) -> tuple[Array, Array, Array]:
    """
    Return A, B_u and B_y of all levels, stacked; continuous for ``h = 0``.

    Continuous: eq. (3) and (20) of the paper with the input of the structure. Discrete: the
    current observer x <- (I - L C)(Ad x + Bd v) + L y with v and L as in ``adrc.observer``.
    """
    n, begin = design.order, starts(design)
    a = np.zeros((begin[-1], begin[-1]))
    b_u, b_y = np.zeros(len(a)), np.zeros(len(a))
    levels = [_level(design, k, h) for k in range(design.levels)]
    for k, (predict, push, gain, keep) in enumerate(levels):
        rows = slice(begin[k], begin[k + 1])
        # x_k <- keep (predict x_k + push v) + gain y_k, or the same with x_k' on the left.
        a[rows, rows] += keep @ predict
        b_u[rows] = keep @ push * design.b0
        for j in range(design.reach[k]):
            # As its own model has it go on; held where that is all there is.
            acting = np.zeros((design.sizes[k], design.sizes[j] - n))
            acting[:n] = levels[j][0][:n, n:]
            a[rows, begin[j] + n : begin[j + 1]] += keep @ acting
        if design.chained and k > 0:
            before = begin[k - 1]
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
    if design.known:
        return known_level(design, k, h)
    n, size = design.order, design.states
    frequencies = pole_frequencies(design, k)
    identity = np.eye(size)
    push = np.zeros(size)
    if h > 0.0:
        powers = [h**i / factorial(i) for i in range(size)]
        predict = sum(power * np.eye(size, k=i) for i, power in enumerate(powers))
        push[:n] = powers[n:0:-1]
        gain = np.array(observer_gains(size, h, [exp(-w * h) for w in frequencies]))
        gain *= design.observer_gain_factor
        return np.asarray(predict), push, gain, identity - np.outer(gain, identity[0])
    push[n - 1] = 1.0
    gain = np.asarray(np.poly([-w for w in frequencies])[1:], dtype=float)
    gain *= design.observer_gain_factor
    return np.eye(size, k=1) - np.outer(gain, identity[0]), push, gain, identity


def observer_gains(states: int, h: float, poles: list[float]) -> list[float]:
    """
    Return the gains L, shape (N,), of the current observer with the given discrete poles.

    The law itself evaluates the same matrices in ``adrc.observer``. Units: l_i is [1/s^i]. Source:
    ``adrc.gains``.
    """
    sigma = [1.0] + [0.0] * states
    for pole in poles:
        for q in range(states, 0, -1):
            sigma[q] += (1.0 - pole) * sigma[q - 1]
    return [
        sum(row[q] * sigma[q + 1] for q in range(i, states)) / h**i
        for i, row in enumerate(inversion_matrix(states))
    ]


def law_matrices(design: Design, h: float = 0.0) -> tuple[Array, Array]:
    """
    Return F and H (n+1,) of the command u = -F x + H r, before the limits, x all levels stacked.

    v = sum_i k_i (r_i - x_i) + r_{n+1} and b0 u = v + sum_i a_i x_i - sum_k d_k, over the levels
    that the structure cancels; with known poles and vibrations, whose gains depend on the period,
    as in ``adrc.internal_model``. The fal law is taken inside its linear zone, where it has the
    gains k_i / delta^(1 - alpha_i). Error-based, H = 0.
    """
    n, begin = design.order, starts(design)
    gains = feedback_gains(design, h)
    if not design.linear:
        gains = np.array(design.feedback_gains)
        gains = gains * design.fal_delta ** (np.array(design.exponents) - 1.0)
    f, reference = np.zeros(begin[-1]), np.zeros(n + 1)
    own = gains - np.array(design.damping)
    fed = begin[design.feedback_level]
    f[fed : fed + n] = own
    if design.known:
        f[n : begin[1]] += np.append(-own, 1.0) @ vibration_matrix(design, h)
    f += disturbance_weights(design, design.cancelled)
    if not design.error_based:
        reference[:n], reference[n] = gains, 1.0
    return f / design.b0, reference / design.b0


def disturbance_weights(design: Design, levels: int | None = None) -> Array:
    """Return the row that adds d_1 + ... up to ``levels`` (default all) of the stacked states."""
    begin = starts(design)
    row = np.zeros(begin[-1])
    for first in begin[: design.levels if levels is None else levels]:
        row[first + design.order] = 1.0
    return row


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
    F, u = K (F r - y); F is improper (degree n+1 over n for one level). K has an integrator for
    every level, so the command of the controller alone, without a plant around it, drifts under
    noise. With an ``input_delay`` each period of it is a state (of a long one see ``delayed``).
    """
    k = open_controller(design, h)
    whole, part = own_delay(design, h)
    size, waiting = len(k.a), whole + (part > 0.0)
    # u[j] periods ago is u now for j = 0, else state j of those that wait.
    acting = np.zeros((2, size + waiting + k.b.shape[1] - 1))
    one = np.eye(size + waiting, len(acting[0]))
    now = np.concatenate([k.c[0], np.zeros(waiting), k.d[0, 1:]])
    for row, age in enumerate((whole, whole + 1)):
        if age <= waiting:
            acting[row] = one[size + age - 1] if age else now
    mean = (1.0 - part) * acting[0] + part * acting[1]
    into = np.zeros((size + waiting, len(now)))
    into[:size] = np.hstack([k.a, np.zeros((size, waiting)), k.b[:, 1:]])
    into[:size] += np.outer(k.b[:, 0], mean)
    for age in range(1, waiting + 1):
        into[size + age - 1] = now if age == 1 else one[size + age - 2]
    n = size + waiting
    return StateSpace(into[:, :n], into[:, n:], now[None, :n], now[None, n:], h)


def open_controller(design: Design, h: float = 0.0) -> StateSpace:
    """Return (applied command, y, r, r', ..., r^(n)) -> u: the law, with its own command cut."""
    a, b_u, b_y = observer_matrices(design, h)
    f, reference = law_matrices(design, h)
    into, through = (a @ b_y, -f @ b_y) if h > 0.0 else (b_y, 0.0)
    b = np.column_stack([b_u, into, np.zeros((len(a), len(reference)))])
    d = np.concatenate([[0.0, through], reference])
    if design.error_based:
        b[:, 2] = -into
        d[2] = -through
    return StateSpace(a, b, -f[None, :], d[None, :], h)
