"""A bumpless change of settings: the state of one design as that of another."""

from __future__ import annotations

from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.law import approach, blank_state, limit, raw_command, State


def retune(
    old: Design,
    new: Design,
    state: State,
    reference: Vector,
    applied: float,
    dt: float,
) -> State:
    """
    Return ``state`` of ``old`` as one of ``new`` that gives the same command.

    Output and derivative estimates are kept. d_1 takes over what the levels that go away
    estimated, and is re-solved for the new b0, for which L = y^(n) - b0 u is another one. Where
    the command, limited as it is, would still be another one, the difference becomes an offset.
    Much of it is the noise of one sample, which a slow loop would integrate for long: so it decays
    with the inner observer, and so does what is left of a takeover that would become slower.
    ``reference``, ``applied`` and ``dt`` are those of the step that led to ``state``. Plant order
    is fixed.
    """
    n = new.order
    after = blank_state(new)
    after.profile[:] = state.profile
    for k in range(new.levels):
        source = state.levels[min(k, old.levels - 1)]
        for i in range(n):
            after.levels[k][i] = source[i]
            if old.error_based:
                after.levels[k][i] += state.profile[i]
            if new.error_based:
                after.levels[k][i] -= after.profile[i]
        if k < old.levels:
            for i in range(n, min(old.states, new.states)):
                after.levels[k][i] = source[i]
    for k in range(new.levels, old.levels):
        after.levels[0][n] += state.levels[k][n]
    if old.error_based:
        after.levels[0][n] += state.profile[n]
    if new.error_based:
        after.levels[0][n] -= after.profile[n]
    after.levels[0][n] += (old.b0 - new.b0) * applied
    after.offset[:] = state.offset
    if new.controller_bandwidth < old.controller_bandwidth:
        after.offset[:] = 0.0, sum(state.offset)
    after.risen[:] = state.risen
    after.usual[:] = state.usual
    after.waited[:] = state.waited
    command = limit(old, raw_command(old, state), applied, dt)[0]
    raw = raw_command(new, after)
    if limit(new, raw, applied, dt)[0] != command:
        after.offset[1] += command - raw
    if old.tracking_acceleration > 0.0 >= new.tracking_acceleration:
        raw = raw_command(new, after)
        approach(new, reference[0], after)
        after.profile[:] = reference
        after.offset[0] += raw - raw_command(new, after)
    return after
