"""
The linear extended state observer in current-observer form: K levels, any order.

Level k estimates x = (y, y', ..., y^(n-1), d_k, ...), N = n + m states, of the chain
y^(n) = v_k + d_k, where v_k is what the plant received plus what the previous levels already
cancel. One tick of length h is

    x_k <- (I - L C) (Ad x_k + Bd v_k) + L y_k,      v_k = b0 u + sum_{j < reach_k} d_j,

with the d_j from before the tick: exact for an input held over the tick. L places every pole of
Ad - L C Ad at z = exp(-ratio w_k h) (see ``gains``). The continuous counterpart is eq. (3) and
(20) of the paper with beta_i = a_i w^i.
"""

from __future__ import annotations

from math import expm1

from nadrc_ros.adrc.design import Design, Matrix


def update(
    design: Design,
    levels: Matrix,
    measurement: float,
    applied: float,
    dt: float,
    speed: float,
    out: Matrix,
    scratch: Matrix,
) -> None:
    """
    Advance every level by one tick of ``dt`` seconds, from ``levels`` (K, N) into ``out`` (K, N).

    ``applied`` is the command that acted since the last tick; ``speed`` scales all bandwidths;
    ``scratch`` (N, N) is only written. With a nonlinear structure the correction of state i is
    multiplied by (|e| / delta)^(2^-i - 1) where the innovation e exceeds delta.
    """
    order = design.order
    last = design.states - 1
    equal_poles = design.equal_poles
    nonlinear = design.nonlinear
    chained = design.chained
    gains: Matrix = design.gain_matrix if equal_poles else scratch
    for k in range(design.levels):
        x = levels[k]
        z = out[k]
        v = design.b0 * applied
        for j in range(design.reach[k]):
            v += levels[j][order]
        z[:] = x
        z[order] += v
        wh = speed * design.bandwidths[k] * dt
        decay = -expm1(-wh) if equal_poles else place_poles(design, wh, scratch)
        # Row i needs z[i+1:] as predicted from: the chain is swept downwards in place, Taylor sum
        # and gain polynomial together. While loops: half the time of range() in plain Python.
        per_row = decay / dt
        innovation = 0.0
        excess = 1.0
        exponent = 1.0
        i = 0
        while i <= last:
            row = gains[i]
            gain = row[last]
            ahead = 0.0
            j = last
            while j > i:
                ahead = (ahead + z[j]) * dt / (j - i)
                j -= 1
                gain = gain * decay + row[j]
            ahead += x[i]
            if i == 0:
                innovation = (measurement - ahead) * decay
                if nonlinear:
                    excess = abs(measurement - ahead) / design.eso_delta
            gain *= innovation
            if excess > 1.0:
                gain *= float(excess ** (exponent - 1.0))
                exponent *= 0.5
            z[i] = ahead + gain
            innovation *= per_row
            i += 1
        if chained:
            measurement = z[0]


def place_poles(design: Design, wh: float, gains: Matrix) -> float:
    """Write G_iq = T_iq sigma_{q+1}(1 - exp(-ratio_j w h)); return 1, the decay that fits them."""
    states = design.states
    sigma = gains[states - 1]
    for q in range(states):
        sigma[q] = 0.0
    for ratio in design.pole_ratios:
        decay = -expm1(-ratio * wh)
        for q in range(states - 1, 0, -1):
            sigma[q] += decay * sigma[q - 1]
        sigma[0] += decay
    # The last row of T has the single entry 1, so sigma can stay where it is once the other rows
    # are made.
    for i in range(states - 1):
        for q in range(states):
            gains[i][q] = design.gain_matrix[i][q] * sigma[q]
    for q in range(states - 1):
        sigma[q] = 0.0
    return 1.0
