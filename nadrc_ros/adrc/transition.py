"""
exp(A h) - I of the model with known poles and frequencies, for any h, and the feedback on it.

The vectors that it takes, the result and what is solved with it share ``State.work``: vectors by
the names here, then the result from ``MATRIX`` on, then as many rows for a system of equations.
"""

from __future__ import annotations

from math import expm1, inf

from nadrc_ros.adrc.design import Design, Matrix, Vector
from nadrc_ros.adrc.state import WORK_VECTORS

# Over a tick so long that a pole of the plant decays by more than exp(-3), or a vibration turns by
# more than 2.5 rad, which is near the half turn that no sample shows, these are not corrected.
FASTEST_DECAY, LARGEST_TURN = 3.0, 2.5
# Of a Taylor sum: what the coefficients of both polynomials may add up to, and how many terms
# leave 1e-18 then.
_LARGEST_SUM, _FEWEST_TERMS, _MORE_TERMS, _MOST_HALVINGS = 3.0, 20, 5.0, 70
# Rows of ``State.work``, before two matrices.
PLANT, GENERATOR, BASIS, VECTOR, PRODUCT = range(WORK_VECTORS)
MATRIX = WORK_VECTORS


def polynomials(design: Design, dt: float, part: float, bounded: bool, work: Matrix) -> None:
    """Write a_j and c_j, lowest first, in the time of ``part`` of ``dt``; bounded if so asked."""
    row = work[PLANT]
    row[0] = 1.0
    for degree in range(1, design.order + 1):
        root = design.plant_poles[degree - 1] * dt
        if bounded and root < -FASTEST_DECAY:
            root = -FASTEST_DECAY
        root *= part
        row[degree] = 0.0
        for j in range(degree, 0, -1):
            row[j] = row[j - 1] - root * row[j]
        row[0] *= -root
    row, degree = work[GENERATOR], design.states - design.order - 2 * len(design.frequencies)
    for j in range(degree):
        row[j] = 0.0
    row[degree] = 1.0
    for w in design.frequencies:
        turn = w * dt
        if bounded and turn > LARGEST_TURN:
            turn = LARGEST_TURN
        turn *= part
        degree += 2
        row[degree] = row[degree - 1] = 0.0
        for j in range(degree, 1, -1):
            row[j] = row[j - 2] + turn * turn * row[j]
        row[0] *= turn * turn
        row[1] *= turn * turn


def exponential(design: Design, dt: float, bounded: bool, work: Matrix) -> None:
    """
    Write exp(H) - I for H = A h with the input as the last state, at ``MATRIX``.

    In the time of h the rows follow from two Taylor sums: row i + 1 is the derivative of row i,
    which is its product with H. Where H is not small, h is halved and the result doubled as often.
    """
    order, states = design.order, design.states
    part, halved, size = 1.0, 0, _LARGEST_SUM + 1.0
    while size > _LARGEST_SUM and halved < _MOST_HALVINGS:
        if halved > 0:
            part *= 0.5
        polynomials(design, dt, part, bounded, work)
        size = 0.0
        for j in range(order):
            size += abs(work[PLANT][j])
        for j in range(states - order):
            size += abs(work[GENERATOR][j])
        halved += 1
    terms = int(_FEWEST_TERMS + _MORE_TERMS * size)
    taylor(0, order, states, terms, work)
    taylor(order, order, states, terms, work)
    other = MATRIX + states
    for _ in range(halved - 1):
        for i in range(states):
            for j in range(states + 1):
                value = 2.0 * work[MATRIX + i][j]
                for q in range(states):
                    value += work[MATRIX + i][q] * work[MATRIX + q][j]
                work[other + i][j] = value
        for i in range(states):
            for j in range(states + 1):
                work[MATRIX + i][j] = work[other + i][j]
    if part < 1.0:
        up = 1.0
        for i in range(states):
            scale = up
            for j in range(states):
                work[MATRIX + i][j] *= scale
                scale *= part
                if j < order:
                    work[MATRIX + i][states] *= part
            work[MATRIX + i][states] *= up
            up /= part


def taylor(first: int, order: int, states: int, terms: int, work: Matrix) -> None:
    """Write row ``first`` of exp(H) - I, the sum of e H^k / k!, and those that follow from it."""
    plant, generator, term = work[PLANT], work[GENERATOR], work[VECTOR]
    total = work[MATRIX + first]
    j = 0
    while j <= states:
        total[j] = term[j] = 0.0
        j += 1
    term[first] = 1.0
    k = 0
    while k < terms:
        k += 1
        share = 1.0 / k
        top, last = term[order - 1] * share, term[states - 1] * share
        term[states] = top
        total[states] += top
        j = states
        while j > first:
            j -= 1
            value = term[j - 1] * share if j > first else 0.0
            value -= top * plant[j] if j < order else last * generator[j - order]
            term[j] = value
            total[j] += value
    end = order if first < order else states
    for i in range(first, end - 1):
        row, below = work[MATRIX + i], work[MATRIX + i + 1]
        top, last = row[order - 1], row[states - 1]
        below[states] = top
        for j in range(states):
            value = row[j - 1] if j > 0 else 0.0
            below[j] = value - (top * plant[j] if j < order else last * generator[j - order])


def solve(first: int, size: int, work: Matrix) -> None:
    """Solve the equations in rows from ``first`` on; right sides, and the result, come last."""
    for j in range(size):
        best = j
        for i in range(j + 1, size):
            if abs(work[first + i][j]) > abs(work[first + best][j]):
                best = i
        pivot = work[first + best][j]
        if pivot == 0.0:
            pivot = inf
        for c in range(j, size + 1):
            value = work[first + best][c]
            work[first + best][c] = work[first + j][c]
            work[first + j][c] = value / pivot
        for i in range(size):
            factor = work[first + i][j]
            if i != j and factor != 0.0:
                for c in range(j, size + 1):
                    work[first + i][c] -= factor * work[first + j][c]


def place_feedback(design: Design, dt: float, work: Matrix, gains: Vector) -> float:
    """
    Write the gains K, shape (n,), with which all poles of the loop are at exp(-wc h).

    The command b0 u = K (r - x) + a x is held over h = ``dt``, at most over what a pole takes to
    change by exp(3): a longer one was a gap, and the next one is not. Returned is the h whose
    exponential is at ``MATRIX``, 0 where no pole is known and the gains are those of the design.
    """
    order, fastest = design.order, 0.0
    for p in design.plant_poles:
        fastest = max(fastest, abs(p))
    for i in range(order):
        gains[i] = design.feedback_gains[i]
    if fastest == 0.0:
        return 0.0
    if fastest * dt > FASTEST_DECAY:
        dt = FASTEST_DECAY / fastest
    exponential(design, dt, False, work)
    first = MATRIX + design.states  # q (exp(H) - I)^k B = 0 for k < n - 1, else 1
    for j in range(order):
        work[first][j] = work[MATRIX + j][design.states]
    for k in range(1, order):
        for i in range(order):
            work[first + k][i] = 0.0
            for j in range(order):
                work[first + k][i] += work[MATRIX + i][j] * work[first + k - 1][j]
    for k in range(order):
        work[first + k][order] = 0.0
    work[first + order - 1][order] = 1.0
    solve(first, order, work)
    q, product = work[VECTOR], work[PRODUCT]
    for j in range(order):
        q[j] = work[first + j][order]
    fall = -expm1(-design.controller_bandwidth * dt)
    for _ in range(order):
        for j in range(order):
            product[j] = fall * q[j]
            for i in range(order):
                product[j] += q[i] * work[MATRIX + i][j]
        for j in range(order):
            q[j] = product[j]
    scale = 1.0
    for i in range(order - 1, -1, -1):
        scale /= dt
        gains[i] = q[i] * scale + design.damping[i]
    return dt
