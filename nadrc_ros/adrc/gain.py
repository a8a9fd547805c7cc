"""
A b0 that varies: looked up in a table at every sample, for plants whose input gain is no constant.

Between two samples b0 changes by a factor of 1 + wc h at most, with the controller bandwidth wc:
the gains of a loop may change as fast as the loop itself and no faster, and noise of the variable
as little. Each change re-solves d_1 as a live change of b0 does, so that y^(n) = b0 u + d_1 + ...
is the same before and after.
"""

from __future__ import annotations

from math import isnan, nan

from nadrc_ros.adrc.angle import whole
from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.state import copy_vector, output_estimate, State

# Numbers of ``Design.gain_source``.
_MEASUREMENT, _TOPIC = 1, 3


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
    design: Design, state: State, told: float, acting: float, dt: float, out: State
) -> None:
    """
    Let b0 of ``out`` go on from that of ``state`` [``dt`` s ago] towards its table.

    ``told`` is the variable of source ``topic``, nan for the last one. The first value of all is
    taken at once.
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
    _change_gain(design, before, gain, acting, out)
    out.gain[1], out.gain[2] = x, 1.0


def retune_gain(old: Design, new: Design, state: State, acting: float, out: State) -> None:
    """Let ``out`` have b0 of other settings: at once, as d_1 is re-solved, where it changes."""
    before, gain = state.gain[0], new.b0
    if new.gain_source > 0:
        told = state.gain[1] if state.gain[2] > 0.0 else nan
        begin_gain(new, output_estimate(new, out), out.profile[0], told, out)
        gain = out.gain[0]
        if old.b0_table == new.b0_table and state.gain[2] > 0.0:  # it may be on its way there
            gain = before
    _change_gain(new, before, gain, acting, out)


def _change_gain(design: Design, before: float, gain: float, acting: float, out: State) -> None:
    """Re-solve d_1 for another b0, for which L = y^(n) - b0 u is another one."""
    out.gain[0] = gain
    if gain != before:
        out.levels[0][design.order] += (before - gain) * acting


def _variable(design: Design, output: float, reference: float, told: float) -> float:
    if design.gain_source == _TOPIC:
        return told
    x = output if design.gain_source == _MEASUREMENT else reference
    # Of an angle the equivalent from the first x of the table on.
    period = design.measurement_period
    return x - whole(x - design.b0_table[0] - 0.5 * period, period)
