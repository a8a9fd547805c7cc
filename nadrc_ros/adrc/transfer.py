"""
Bumpless transfers: a state is made to fit other settings or another reference.

What the limits leave of the command is as before. Where the law alone would ask for another one,
an offset that decays makes up for the difference.
"""

from __future__ import annotations

from math import nan, prod

from nadrc_ros.adrc.delay_line import acting, blank_line, merge_short, pass_through
from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.gain import retune_gain
from nadrc_ros.adrc.internal_model import place_known, take_feedback
from nadrc_ros.adrc.limiter import limit
from nadrc_ros.adrc.state import (
    blank_state,
    copy_vector,
    damping,
    raw_command,
    reference_share,
    State,
)


def retune(
    old: Design,
    new: Design,
    state: State,
    reference: Vector,
    applied: float,
    dt: float,
    sent: float = nan,
    downstream: float = nan,
    earlier: State | None = None,
) -> State:
    """
    Return ``state`` of ``old`` as one of ``new`` that gives the same command.

    Output and derivative estimates are kept. d_1 takes over what the levels that go away
    estimated, and is re-solved for the new b0 and poles, for which L = y^(n) + sum_i a_i y^(i) -
    b0 u is another one. Where the command, limited as it is, would still be another one, the
    difference becomes an offset. Much of it is the noise of one sample, which a slow loop would
    integrate for long: so it decays with the inner observer, and so does what is left of a
    takeover that would become slower.
    ``reference``, ``applied``, ``dt``, ``sent`` and ``downstream`` are those of the step that led
    to ``state``, from the one ``earlier``. Plant order is fixed.
    """
    n = new.order
    if sent != sent:
        sent = applied
    after = blank_state(new)
    after.profile[:] = state.profile
    for k in range(new.levels):
        # A level that is new starts where the last one is, with nothing left to estimate.
        source = state.levels[min(k, old.levels - 1)]
        for i in range(n):
            after.levels[k][i] = source[i]
            if old.error_based:  # by way of the output, whichever of the two is observed
                after.levels[k][i] += state.profile[i]
            if new.error_based:
                after.levels[k][i] -= after.profile[i]
        if k < old.levels:
            pace = _pace(old, new)
            for i in range(n, min(old.states, new.states)):
                after.levels[k][i] = source[i] * pace ** (i - n)
    for k in range(new.levels, old.levels):
        after.levels[0][n] += state.levels[k][n]
    if old.error_based:
        after.levels[0][n] += reference_share(old, state.profile)
    if old.known or new.known:
        y = [x + r for x, r in zip(state.levels[old.feedback_level], state.profile)]
        if not old.error_based:
            y = list(state.levels[old.feedback_level])
        after.levels[0][n] += damping(new, y) - damping(old, y)
        if new.frequencies:
            after.ripple[:] = state.ripple
        if new.known and 0.0 < dt <= new.max_dt:
            place_known(new, dt, 1.0, after)
            take_feedback(new, after)
    if new.error_based:
        after.levels[0][n] -= reference_share(new, after.profile)
    driving = applied - state.offset[2]
    acted = acting(state.delay_line, driving)
    if earlier is not None and old.input_delay > 0.0:  # over the step, not from now on
        line, spare = earlier.delay_line, blank_line(old.input_delay)
        acted = pass_through(old.input_delay, line, driving, dt, spare)
    retune_gain(old, new, earlier or state, state, sent, acted, after)
    if new.error_deadband > 0.0:  # else it wakes
        after.resting[:] = state.resting
    after.offset[:] = state.offset
    if new.controller_bandwidth < old.controller_bandwidth:
        after.offset[:] = 0.0, state.offset[0] + state.offset[1], state.offset[2]
    # Not begun anew: what the observers rose to, and what the law usually asks for.
    after.startup[:] = state.startup
    after.smoothed[:] = state.smoothed
    after.since_sample[:] = state.since_sample
    if old.input_delay > 0.0 and new.input_delay > 0.0:  # cut, if it is too long
        lines = [(state.delay_line, driving, after.delay_line)]
        if new.feed_forward_timeout > 0.0:  # which is fixed
            lines.append((state.fed_line, state.offset[2], after.fed_line))
        for line, entering, out in lines:
            pass_through(new.input_delay, line, entering, 0.0, out)
            if new.input_delay > old.input_delay:
                merge_short(new.input_delay, out)
    after.angle[:] = state.angle
    command = limit(old, raw_command(old, state), sent, dt, downstream)[0]
    _make_up(new, after, command, sent, dt, downstream, 1)
    # The next step will take the reference itself for the profile. That is no noise of one
    # sample, so the bump goes into the offset that lasts.
    if old.tracking_acceleration > 0.0 >= new.tracking_acceleration:
        raw = raw_command(new, after)
        restart_profile(new, reference[0], after)
        if new.error_based:
            for i in range(1, n):
                for k in range(new.levels):
                    after.levels[k][i] -= reference[i]
            after.levels[0][n] -= reference_share(new, reference)
            after.levels[0][n] += reference_share(new, after.profile)
        after.profile[:] = reference
        after.offset[0] += raw - raw_command(new, after)
    return after


def _pace(old: Design, new: Design) -> float:
    """
    Return by how much faster a known vibration is now, 0 where its estimate is of no use.

    Of d(t) = sin(w t) the derivatives grow with powers of w: so its size and phase are kept.
    """
    if old.frequencies == new.frequencies:
        return 1.0
    if len(old.frequencies) != len(new.frequencies):
        return 0.0
    ratios = [now / before for before, now in zip(old.frequencies, new.frequencies)]
    return prod(ratios) ** (1.0 / len(ratios))


def restart_profile(design: Design, start_value: float, state: State) -> None:
    """Let the profile rest at ``start_value``; error-based estimates move along with it."""
    before = raw_command(design, state)
    if design.error_based and design.known:
        state.levels[0][design.order] += damping(design, state.profile)
        state.levels[0][design.order] -= design.damping[0] * start_value
    for i in range(design.order + 1):
        origin = start_value if i == 0 else 0.0
        if design.error_based:  # d_1 is of L - r^(n)
            for k in range(design.levels if i < design.order else 1):
                state.levels[k][i] += state.profile[i] - origin
        state.profile[i] = origin
    change = raw_command(design, state) - before
    state.smoothed[0] += change
    state.smoothed[1] += change


def turn_profile(design: Design, away: float, state: State) -> None:
    """Take whole periods off the profile; error-based estimates move along with it."""
    before = raw_command(design, state)
    state.profile[0] -= away
    if design.error_based:
        for k in range(design.levels):
            state.levels[k][0] += away
    change = raw_command(design, state) - before
    state.smoothed[0] += change
    state.smoothed[1] += change


def adopt_reference(
    design: Design, reference: Vector, state: State, sent: float, dt: float, downstream: float
) -> None:
    """Let the profile be the reference as it is by now, without a bump."""
    if not design.tracking_acceleration > 0.0 and not design.error_based:  # else it was not used
        command = limit(design, raw_command(design, state), sent, dt, downstream)[0]
        copy_vector(reference, state.profile)
        _make_up(design, state, command, sent, dt, downstream, 0)


def _make_up(
    design: Design,
    state: State,
    command: float,
    sent: float,
    dt: float,
    downstream: float,
    part: int,
) -> None:
    """Add to a part of the offset what the command, limited as it is, misses."""
    raw = raw_command(design, state)
    if limit(design, raw, sent, dt, downstream)[0] != command:
        state.offset[part] += command - raw
