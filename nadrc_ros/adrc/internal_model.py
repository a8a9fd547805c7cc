"""
Observers of a plant whose real poles, or whose disturbance's frequencies, are known.

The chain of :mod:`~nadrc_ros.adrc.observer` with two of its rows changed. With p_i the known poles
and w_i the known frequencies, a level estimates x = (y, ..., y^(n-1), d, d', ..., d^(M-1)) of

    y^(n) + a_{n-1} y^(n-1) + ... + a_0 y = v + d,          prod_i (s - p_i) = s^n + ... + a_0,
    d^(M) + c_{M-1} d^(M-1) + ... + c_0 d = 0,      s^m prod_i (s^2 + w_i^2) = s^M + ... + c_0,

the frequencies in level 1 only: what it leaves has none of them, and each level more would pass
more noise. Over a tick of length h with the command held,

    x <- (I - L C) (exp(A h) x + b0 u int_0^h exp(A s) B ds + sum_{j < reach_k} E d_j) + L y,

E d_j what the disturbance of level j, going on by its own model, adds to y, ..., y^(n-1). L places
the poles of level k at exp(-w_k h), one that the plant makes faster where it is, and those of a
frequency, which decay at their own rate g, at exp((-g +- j w_i) h). L C exp(A h) moves n + M
poles by n + M numbers (J. Ackermann, Der Entwurf linearer Regelungssysteme im Zustandsraum,
Regelungstechnik 20, 1972): with y so that C exp(A h) (exp(A h) - I)^k y is 0 for k < n + M - 1,
else 1, L = prod_q (exp(A h) - z_q I) y. All is worked out in the time of h, where the chain has
ones beside its diagonal, and from exp(A h) - I: so nothing cancels however short h is.

A command that is held over a period cannot cancel a vibration within it. What it can do is to
leave nothing of it in y at the samples: with D = (d, d', ...), S_h D one tick later, it is

    b0 u = -Gamma D at x = Pi D,   Pi S_h = Phi Pi - B Gamma + E,   C Pi = 0,

which makes of the law an internal model of the vibration (B. Francis, W. Wonham, The internal
model principle of control theory, Automatica 12, 1976): feedback acts on x - Pi D and cancels
Gamma D instead of d. ``State.ripple`` is (Pi D, Gamma D - d).

Nor does a held command take away at once what a known pole does: with the gains k_i of (s + wc)^n
the loop of a pole that is fast for the rate overshoots. So those of the linear feedback place the
poles of the plant under the held command at exp(-wc h), again by Ackermann's formula; where
nothing is known of the plant they stay the k_i, from which they differ little.
"""

from __future__ import annotations

from math import expm1, floor, sin

from nadrc_ros.adrc.angle import whole
from nadrc_ros.adrc.design import Design, Matrix, Vector
from nadrc_ros.adrc.observer import softened
from nadrc_ros.adrc.state import State
from nadrc_ros.adrc.transition import (
    BASIS,
    exponential,
    FASTEST_DECAY,
    LARGEST_TURN,
    MATRIX,
    place_feedback,
    PLANT,
    polynomials,
    PRODUCT,
    solve,
    VECTOR,
)


def update_known(
    design: Design,
    state: State,
    measurement: float,
    received: float,
    dt: float,
    speed: float,
    after: State,
) -> None:
    """
    Advance every level by one tick of ``dt`` seconds, as ``observer.update``, into ``after``.

    Of ``after`` levels, ``ripple`` and ``feedback`` are written. Scratch of the last ``dt`` are
    the gains, ``transition`` (N+1, N+1), exp(A h) - I with the column of the command, and in its
    last row ``feedback``, and ``foresight`` (n+1, M), the matrices of ``ripple``.
    """
    order, states, count = design.order, design.states, design.levels
    levels, out, scratch = state.levels, after.levels, after.scratch
    work = after.work
    wraps = design.measurement_period > 0.0
    steps = scratch[count]
    if steps[1] != dt or steps[0] != speed:
        place_known(design, dt, speed, after)
    take_feedback(design, after)
    k = 0
    while k < count:
        x, z, gains, size = levels[k], out[k], scratch[k], design.sizes[k]
        predicted = work[VECTOR]
        i = 0
        while i < order:
            row = after.transition[i]
            v = row[states] * received
            j = design.reach[k]
            while j > 0:
                j -= 1
                v += effect(design, j, levels[j], row)
            if size < states:
                v += row[states] * x[order]
            j = 0
            while j < (order if size < states else size):
                v += row[j] * x[j]
                j += 1
            predicted[i] = x[i] + v
            i += 1
        while i < size:
            v = x[i]
            if size == states:
                row = after.transition[i]
                j = order
                while j < size:
                    v += row[j] * x[j]
                    j += 1
            predicted[i] = v
            i += 1
        innovation = measurement - predicted[0]
        if wraps:  # all levels get the equivalent that is nearest for level 1
            measurement -= whole(innovation, design.measurement_period)
            innovation = measurement - predicted[0]
            wraps = False
        if design.nonlinear:
            gains = softened(gains, abs(innovation) / design.eso_delta, scratch[count + 1])
        i = 0
        while i < size:
            z[i] = predicted[i] + gains[i] * innovation
            i += 1
        if design.chained:
            measurement = z[0]
        k += 1
    i = 0
    while i <= order and len(design.frequencies) > 0:
        row, v, j = after.foresight[i], 0.0, order
        while j < states:
            v += row[j - order] * out[0][j]
            j += 1
        after.ripple[i] = v
        i += 1


def effect(design: Design, k: int, x: Vector, row: Vector) -> float:
    """Return what the disturbance of level ``k`` adds to a state over the tick."""
    order, states = design.order, design.states
    if design.sizes[k] < states:
        return row[states] * x[order]
    v, j = 0.0, order
    while j < states:
        v += row[j] * x[j]
        j += 1
    return v


def take_feedback(design: Design, state: State) -> None:
    """Copy the feedback gains that were placed with the rest."""
    placed, i = state.transition[design.states], 0
    while i < design.order:
        state.feedback[i] = placed[i]
        i += 1


def place_known(design: Design, dt: float, speed: float, state: State) -> None:
    """Write transition, foresight, and the gains of feedback and levels for this ``dt``."""
    scratch, transition = state.scratch, state.transition
    foresight, work = state.foresight, state.work
    order, states = design.order, design.states
    seen, slow = True, True
    for w in design.frequencies:
        seen = seen and w * dt <= LARGEST_TURN
    for p in design.plant_poles:
        slow = slow and -p * dt <= FASTEST_DECAY
    if place_feedback(design, dt, work, transition[states]) != dt:
        exponential(design, dt, False, work)
    down = 1.0  # dt^-i
    for i in range(states):
        scale = down
        for j in range(states):
            transition[i][j] = work[MATRIX + i][j] * scale
            scale *= dt
            if j < order:
                transition[i][states] = work[MATRIX + i][states] * scale
        down /= dt
    if len(design.frequencies) > 0:
        foresee(design, dt, seen, foresight, work)
    delayed = design.input_delay > 0.0 and len(design.frequencies) > 0
    if delayed or not (seen and slow):
        exponential(design, dt, True, work)
    for k in range(design.levels):
        size = design.sizes[k]
        if k == 1 and size < states:  # without the frequencies, d_k held
            for j in range(size):
                work[MATRIX + order][j] = 0.0
            for i in range(order):
                work[MATRIX + i][order] = work[MATRIX + i][states]
        if k == 0 or (k == 1 and size < states):
            observe(design, size, work)
        place_level(design, k, dt, speed, work, scratch[k])
        if not slow:
            restore(design, size, dt, work, scratch[k])
        scale = 1.0
        for i in range(size):
            scratch[k][i] *= design.observer_gain_factor * scale
            scale /= dt
    steps = scratch[design.levels]
    steps[0] = speed
    steps[1] = dt


def observe(design: Design, size: int, work: Matrix) -> None:
    """Write y, shape (``size``,), of C exp(H) (exp(H) - I)^k y = 0 for k < size - 1, else 1."""
    first = MATRIX + design.states
    row = work[first]
    for j in range(size):
        row[j] = work[MATRIX][j]
    row[0] += 1.0
    row[size] = 0.0
    for k in range(1, size):
        before, row = work[first + k - 1], work[first + k]
        for j in range(size):
            row[j] = 0.0
            for i in range(size):
                row[j] += before[i] * work[MATRIX + i][j]
        row[size] = 0.0
    row[size] = 1.0
    solve(first, size, work)
    for j in range(size):
        work[BASIS][j] = work[first + j][size]


def place_level(
    design: Design, k: int, dt: float, speed: float, work: Matrix, gains: Vector
) -> None:
    """Write the gains of a level in the time of ``dt``: one factor of the poles after another."""
    order, states, size = design.order, design.states, design.sizes[k]
    w = speed * design.bandwidths[k] * dt
    for j in range(size):
        gains[j] = work[BASIS][j]
    if size == states:
        extended = states - 2 * len(design.frequencies)
        for i in range(len(design.frequencies)):
            turn = design.frequencies[i] * dt
            decay = -expm1(-design.decays[extended + i] * w)
            if turn > LARGEST_TURN:  # not to be seen: it stays
                turn, decay = LARGEST_TURN, 0.0
            half = sin(0.5 * turn)
            arc = 4.0 * (1.0 - decay) * half * half
            apply(size, 2.0 * decay + arc, decay * decay + arc, True, work, gains)
        size_of_rest = extended
    else:
        size_of_rest = size
    for i in range(size_of_rest):
        fall = design.decays[i] * w
        if i < order:
            own = -design.plant_poles[i] * dt
            if own > FASTEST_DECAY:
                fall = FASTEST_DECAY
            elif own > fall:
                fall = own
        apply(size, -expm1(-fall), 0.0, False, work, gains)


def apply(
    size: int, first: float, second: float, twice: bool, work: Matrix, gains: Vector
) -> None:
    """Multiply by D + first, or by D^2 + first D + second, D = exp(H) - I."""
    product = work[PRODUCT]
    for i in range(size):
        product[i] = 0.0
        for j in range(size):
            product[i] += work[MATRIX + i][j] * gains[j]
    for i in range(size):
        if twice:
            value = second * gains[i] + first * product[i]
            for j in range(size):
                value += work[MATRIX + i][j] * product[j]
            work[VECTOR][i] = value
        else:
            gains[i] = product[i] + first * gains[i]
    if twice:
        for i in range(size):
            gains[i] = work[VECTOR][i]


def restore(design: Design, size: int, dt: float, work: Matrix, gains: Vector) -> None:
    """
    Make the gains those of the poles as they are, not as far as they are bounded.

    C exp(A t) L, of which the gains are the derivatives at 0, has no share of what is not
    corrected: it is the same for both, and d = y^(n) + a_{n-1} y^(n-1) + ... alone is another one.
    """
    order = design.order
    polynomials(design, dt, 1.0, True, work)
    slope = work[VECTOR]  # its derivatives
    for j in range(size):
        slope[j] = gains[j]
        if j >= order:
            for i in range(order):
                slope[j] -= work[PLANT][i] * slope[i + j - order]
    for j in range(order, size):
        value, power = slope[j], 1.0
        for i in range(order - 1, -1, -1):
            power *= dt
            value += design.damping[i] * power * slope[i + j - order]
        gains[j] = value


def foresee(design: Design, dt: float, seen: bool, foresight: Matrix, work: Matrix) -> None:
    """Write Pi, and Gamma without what selects d: what feedback leaves to the vibration."""
    order, states = design.order, design.states
    count = states - order
    for i in range(order + 1):
        for c in range(count):
            foresight[i][c] = 0.0
    if not seen:
        return
    first, size = MATRIX + states, order * count
    for i in range(order):
        dynamics = work[MATRIX + i]
        for c in range(count):
            row = work[first + i * count + c]
            for j in range(size):
                row[j] = 0.0
            for j in range(1, order):
                row[(j - 1) * count + c] -= dynamics[j]
            if i > 0:
                for j in range(count):
                    row[(i - 1) * count + j] += work[MATRIX + order + j][order + c]
            row[(order - 1) * count + c] += dynamics[states]
            row[size] = dynamics[order + c]
    solve(first, size, work)
    for i in range(order):
        for c in range(count):
            row = foresight[order if i == order - 1 else i + 1]
            row[c] = work[first + i * count + c][size]
    if design.input_delay > 0.0:
        lead(design, dt, foresight[order], work)
    for i in range(order + 1):
        scale = 1.0
        for _ in range(order - i):
            scale *= dt
        for c in range(count):
            foresight[i][c] *= scale
            scale *= dt
    foresight[order][0] -= 1.0


def lead(design: Design, dt: float, gains: Vector, work: Matrix) -> None:
    """
    Make of Gamma what cancels the vibration that there is when the command arrives.

    Of a delay of m + p periods the observers get (1 - p) u[k-m] + p u[k-m-1] at once, so that
    Gamma' ((1 - p) S + p) = Gamma S^(m+1).
    """
    order, states = design.order, design.states
    first, count = MATRIX + states, states - order
    periods = floor(design.input_delay / dt * (1.0 + 1e-12))
    part = max(design.input_delay / dt - periods, 0.0)
    for j in range(count):
        row = work[first + j]
        for i in range(count):
            row[i] = (1.0 - part) * work[MATRIX + order + i][order + j]
        row[j] += 1.0
        row[count] = gains[j]
    solve(first, count, work)
    for j in range(count):
        gains[j] = work[first + j][count]
    exponential(design, (periods + 1.0) * dt, False, work)
    moved, up = work[PRODUCT], 1.0  # in the time of dt
    for j in range(count):
        moved[j] = gains[j]
        scale = up
        for i in range(count):
            moved[j] += gains[i] * work[MATRIX + order + i][order + j] * scale
            scale /= periods + 1.0
        up *= periods + 1.0
    for j in range(count):
        gains[j] = moved[j]
