"""
The linear extended state observer in current-observer form: K levels, any order.

Level k estimates x = (y, y', ..., y^(n-1), d_k, ...), N = n + m states, of the chain
y^(n) = v_k + d_k, where v_k is what the plant received plus what the previous levels already
cancel. One tick of length h is

    x_k <- (I - L C) (Ad x_k + Bd v_k) + L y_k,      v_k = b0 u + sum_{j < reach_k} d_j,

with the d_j from before the tick: exact for an input held over the tick. L places every pole of
Ad - L C Ad at z = exp(-ratio w_k h) (see ``gains``), for the h of this very tick. The continuous
counterpart is eq. (3) and (20) of the paper with beta_i = a_i w^i.
"""

from __future__ import annotations

from math import expm1

from nadrc_ros.adrc.angle import whole
from nadrc_ros.adrc.design import Design, Matrix, Vector


def update(
    design: Design,
    levels: Matrix,
    measurement: float,
    received: float,
    dt: float,
    speed: float,
    out: Matrix,
    scratch: Matrix,
) -> None:
    """
    Advance every level by one tick of ``dt`` seconds, from ``levels`` (K, N) into ``out`` (K, N).

    Of the ``measurement`` of an angle it takes the equivalent nearest to what level 1 predicts.
    ``received`` is b0 u of the command that acted since the last tick; ``speed`` scales all
    bandwidths; ``scratch`` (K + 2, N) keeps the gains of the last ``dt``.
    """
    order = design.order
    last = design.states - 1
    below = last - 1
    count = design.levels
    steps = scratch[count]  # speed, dt, dt / 2, dt / 3, ...
    if steps[1] != dt or steps[0] != speed:
        place(design, dt, speed, scratch)
    reach = design.reach
    shaped, chained = design.shaped, design.chained
    # While loops: half the time of range() in plain Python.
    k = 0
    while k < count:
        x = levels[k]
        z = out[k]
        gains = scratch[k]
        v = received
        j = reach[k]
        while j > 0:
            j -= 1
            v += levels[j][order]
        # The Taylor sums of the chain from x with v added to the state that it drives. That of the
        # output is written out: it must be there before any state is corrected.
        bottom = x[last]
        top = bottom + v if last == order else bottom
        ahead = top * steps[last]
        j = below
        while j > 0:
            if j == order:
                ahead += v
            ahead = (ahead + x[j]) * steps[j]
            j -= 1
        ahead += x[0]
        innovation = measurement - ahead
        if shaped:
            if k == 0:  # all levels get the equivalent that is nearest for level 1
                measurement -= whole(innovation, design.measurement_period)
                innovation = measurement - ahead
            if design.nonlinear:
                gains = softened(gains, abs(innovation) / design.eso_delta, scratch[count + 1])
        z[0] = ahead + gains[0] * innovation
        i = 1
        while i < last:
            ahead = top * steps[last - i]
            j = below
            while j > i:
                if j == order:
                    ahead += v
                ahead = (ahead + x[j]) * steps[j - i]
                j -= 1
            z[i] = ahead + x[i] + gains[i] * innovation
            i += 1
        z[last] = bottom + gains[last] * innovation
        if chained:
            measurement = z[0]
        k += 1


def softened(gains: Vector, excess: float, out: Vector) -> Vector:
    """Return l_i (|e| / delta)^(2^-i - 1) where the innovation e exceeds delta, else l_i."""
    if excess <= 1.0:
        return gains
    exponent = 1.0
    for i in range(len(gains)):
        out[i] = gains[i] * float(excess ** (exponent - 1.0))
        exponent *= 0.5
    return out


def place(design: Design, dt: float, speed: float, scratch: Matrix) -> None:
    """Write l_i = sum_{q >= i} G_iq sigma_{q+1} / dt^i for every level, and what they hold for."""
    states = design.states
    steps, sigma = scratch[design.levels], scratch[design.levels + 1]
    for k in range(design.levels):
        wh = speed * design.bandwidths[k] * dt
        if design.equal_poles:
            decay = -expm1(-wh)
            power = 1.0
            for q in range(states):
                power *= decay
                sigma[q] = power
        else:
            symmetric_polynomials(design.pole_ratios, wh, sigma)
        scale = 1.0
        for i in range(states):
            gain = design.gain_matrix[i][states - 1] * sigma[states - 1]
            for q in range(states - 2, i - 1, -1):
                gain += design.gain_matrix[i][q] * sigma[q]
            scratch[k][i] = gain * scale
            scale /= dt
    steps[0] = speed
    for m in range(1, states):
        steps[m] = dt / m


def symmetric_polynomials(ratios: Vector, wh: float, sigma: Vector) -> None:
    """Write sigma_1..sigma_N of 1 - exp(-ratio_j w h), shape (N,)."""
    for q in range(len(sigma)):
        sigma[q] = 0.0
    for ratio in ratios:
        decay = -expm1(-ratio * wh)
        for q in range(len(sigma) - 1, 0, -1):
            sigma[q] += decay * sigma[q - 1]
        sigma[0] += decay
