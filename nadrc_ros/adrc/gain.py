"""
A b0 that varies: looked up in a table at every sample, for plants whose input gain is no constant.

Between two samples b0 changes by a factor of 1 + wc h at most, with the controller bandwidth wc:
the gains of a loop may change as fast as the loop itself and no faster, and noise of the variable
as little. Each change re-solves d_1 as a live change of b0 does, so that y^(n) = b0 u + d_1 + ...
is the same before and after.

A known vibration that the command cancels is in the estimates as large as b0 is: what the command
makes of y^(n) is b0 u, and the vibration what undoes it. So D = (d, d', ...) of it, what it makes
of y', ..., and ``State.ripple`` change in proportion to b0, and the rest of d_1 is re-solved.
"""

from __future__ import annotations

from math import isnan, nan

from nadrc_ros.adrc.angle import whole
from nadrc_ros.adrc.design import Design, Matrix, Vector
from nadrc_ros.adrc.state import copy_vector, output_estimate, raw_command, State
from nadrc_ros.adrc.transition import GENERATOR, VECTOR

# Numbers of ``Design.gain_source``.
_MEASUREMENT, _TOPIC = 1, 3
# Of a command that is the law's own: sums by another way differ by rounding.
_OWN = 1e-9


def gain_at(table: Vector, x: float) -> float:
    """Return b(x) of the table x1, b1, x2, b2, ...: linear between its points, constant beyond."""
    low, high = 0, len(table) // 2 - 1
    if x <= table[0]:
        return table[1]
    if x >= table[2 * high]:
        return table[2 * high + 1]
    while high - low > 1:
        middle = (low + high) // 2
        if x < table[2 * middle]:
            high = middle
        else:
            low = middle
    low *= 2
    left, right = table[low + 1], table[low + 3]
    gain = left + (right - left) * ((x - table[low]) / (table[low + 2] - table[low]))
    # Rounded it may lie beyond its ends, and so at 0.
    return min(max(gain, min(left, right)), max(left, right))


def begin_gain(
    design: Design, measurement: float, reference: float, told: float, out: State
) -> None:
    """Set b0 for a start from there; where the variable is not known it stays what it is."""
    x = _variable(design, measurement, reference, told)
    if not isnan(x):
        out.gain[0], out.gain[1], out.gain[2] = gain_at(design.b0_table, x), x, 1.0


def follow_gain(
    design: Design, state: State, told: float, sent: float, acting: float, dt: float, out: State
) -> None:
    """
    Let b0 of ``out`` go on from that of ``state`` [``dt`` s ago] towards its table.

    ``told`` is the variable of source ``topic``, nan for the last one. The first value of all is
    taken at once. ``sent`` is the command that ``state`` led to, and ``acting`` what acted since.
    """
    before, known = state.gain[0], state.gain[2] > 0.0
    x = _variable(design, output_estimate(design, out), out.profile[0], told)
    if isnan(x):
        if not known:
            copy_vector(state.gain, out.gain)
            return
        x = state.gain[1]
    gain = gain_at(design.b0_table, x)
    if known:
        most = 1.0 + design.controller_bandwidth * dt
        if abs(gain) > abs(before) * most:
            gain = before * most
        elif abs(gain) * most < abs(before):
            gain = before / most
    if gain != before and len(design.frequencies) > 0:
        acting += scale_vibration(design, state, out, sent, gain / before, out)
    _change_gain(design, before, gain, acting, out)
    out.gain[1], out.gain[2] = x, 1.0


def retune_gain(
    old: Design, new: Design, earlier: State, state: State, sent: float, acting: float, out: State
) -> None:
    """
    Let ``out`` have b0 of other settings: at once, as d_1 is re-solved, where it changes.

    ``sent`` and ``acting`` are as of :func:`follow_gain`, for the tick from ``earlier`` to
    ``state``.
    """
    before, gain = state.gain[0], new.b0
    if new.gain_source > 0:
        told = state.gain[1] if state.gain[2] > 0.0 else nan
        begin_gain(new, output_estimate(new, out), out.profile[0], told, out)
        gain = out.gain[0]
        if old.b0_table == new.b0_table and state.gain[2] > 0.0:  # it may be on its way there
            gain = before
    if gain != before and len(old.frequencies) > 0 and old.frequencies == new.frequencies:
        acting += scale_vibration(old, earlier, state, sent, gain / before, out)
    _change_gain(new, before, gain, acting, out)


def _change_gain(design: Design, before: float, gain: float, acting: float, out: State) -> None:
    """Re-solve d_1 for another b0, for which L = y^(n) - b0 u is another one."""
    out.gain[0] = gain
    if gain != before:
        out.levels[0][design.order] += (before - gain) * acting


def scale_vibration(
    design: Design, earlier: State, state: State, sent: float, ratio: float, out: State
) -> float:
    """
    Let a known vibration of ``out`` be ``ratio`` times what it is in ``state``.

    Return what is to be added to the command that acted from ``earlier`` to ``state``, that the
    rest of it is left. Both only if the law's own command was ``sent``: else the vibration is not
    in it, and no part of what the command made of y^(n).
    """
    raw = raw_command(design, earlier)
    if not abs(sent - raw) <= _OWN * abs(raw):
        return 0.0
    order, more = design.order, ratio - 1.0
    vibration = share_of_vibration(design, earlier.levels[0], earlier.work)
    cancelled = vibration[0] + earlier.ripple[order]
    before = vibration[0]
    vibration = share_of_vibration(design, state.levels[0], state.work)
    if design.input_delay > 0.0:  # what acts was for another time: the mean over the tick
        cancelled = 0.5 * (before + vibration[0])
    for j in range(design.states - order):
        out.levels[0][order + j] += more * vibration[j]
    for k in range(len(out.levels)):
        for i in range(order):
            out.levels[k][i] += more * state.ripple[i]
    for i in range(order + 1):
        out.ripple[i] = ratio * state.ripple[i]
    return cancelled / earlier.gain[0]


def share_of_vibration(design: Design, x: Vector, work: Matrix) -> Vector:
    """
    Return what of (d, d', ..., d^(M-1)) in level 1 is of the known frequencies, shape (M,).

    That is the last 2 f of these, from which s^m took the rest, and the ones before by way of
    prod_i (s^2 + w_i^2) = 0. It is written into ``work``.
    """
    order, count = design.order, 2 * len(design.frequencies)
    row, share = work[GENERATOR], work[VECTOR]
    for i in range(count + 1):
        row[i] = 0.0
    row[0], degree = 1.0, 0
    for w in design.frequencies:
        degree += 2
        for j in range(degree, 1, -1):
            row[j] = row[j - 2] + w * w * row[j]
        row[0] *= w * w
        row[1] *= w * w
    for j in range(design.states - order - 1, -1, -1):
        value = x[order + j]
        if order + j + count < design.states:
            value = -share[j + count]
            for i in range(2, count, 2):
                value -= row[i] * share[j + i]
            value /= row[0]
        share[j] = value
    return share


def _variable(design: Design, output: float, reference: float, told: float) -> float:
    if design.gain_source == _TOPIC:
        return told
    x = output if design.gain_source == _MEASUREMENT else reference
    # Of an angle the equivalent from the first x of the table on.
    period = design.measurement_period
    return x - whole(x - design.b0_table[0] - 0.5 * period, period)
