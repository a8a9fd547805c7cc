"""
The law as a pure function: N-ADRC from one sample to one command.

Nothing here raises: bad input gives a :class:`Status`, and the state after ``step`` equals the one
before to the bit.

``step`` refuses what is not usable, advances the reference profile, the rise of a start and the
observers, in that order as each needs the one before; then the offset of a transfer decays, b0
goes on in its table, the deadband decides whether the loop rests, the command follows from the new
state, and the limiter has the last word.
"""

from __future__ import annotations

from math import copysign, exp, nan

from nadrc_ros.adrc.angle import whole
from nadrc_ros.adrc.deadband import mind_deadband
from nadrc_ros.adrc.delay_line import pass_through
from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.differentiator import track
from nadrc_ros.adrc.gain import begin_gain, follow_gain
from nadrc_ros.adrc.internal_model import update_known
from nadrc_ros.adrc.limiter import clamp, limit, present
from nadrc_ros.adrc.observer import update
from nadrc_ros.adrc.settings import HIGHEST, LOWEST
from nadrc_ros.adrc.state import copy_state, copy_vector, match_command, raw_command, rest, State
from nadrc_ros.adrc.status import BAD_REFERENCE, BAD_TIME_STEP, NO_MEASUREMENT, RESTARTED

# Resolution of a time stamp [s].
_SHORTEST_STEP = 1e-9


def step(
    design: Design,
    state: State,
    reference: Vector,
    measurement: float,
    applied: float,
    dt: float,
    out: State,
    gain_variable: float = nan,
    sent: float = nan,
    downstream: float = nan,
    feed_forward: float = 0.0,
) -> tuple[float, int]:
    """
    Advance the controller by one sample; return the command and a :class:`Status`.

    Parameters
    ----------
    design, state, out
        The numbers, the state before, and a distinct buffer for the state after.
    reference
        r, r', ..., r^(n), shape (n+1,), zeros where a derivative is unknown.
    measurement
        y [output unit].
    applied
        The command that really acted up to now [command unit]: since the previous sample, or since
        the last tick without one. The observers then get the mean of the command over ``dt``,
        which gives y^(n-1) exactly. For n = 1 that is all; above, what it leaves in y is below
        b0 R dt^(n+1) / 12 with the rate limit R, and nothing where the command stood still.
    dt
        Time since the previous sample [s].
    gain_variable
        What ``b0_table`` is over if ``b0_source`` is ``topic``; nan for the last one.
    sent, downstream
        From where the rate limit counts, see :func:`~nadrc_ros.adrc.limiter.limit`; by default
        from ``applied``.
    feed_forward
        What is added to the command from now on [command unit]: -1 / b0 times what is known of the
        total disturbance. The observers get the applied command without the one of before, and
        estimate the rest.

    Returns
    -------
    tuple
        b0 u = v - sum_k d_k (eq. (17) of the paper and v' = v - zh_{n+1}, which it never writes)
        + b0 times the feed-forward, limited in rate and then in magnitude. After ``dt > max_dt``,
        or should the estimates overflow, the observers restart without a bump. On bad input the
        applied command, brought inside the limits.

    """
    # All before anything is written. Comparisons with nan are false: each is written so that
    # false refuses.
    if not design.measurement_min <= measurement <= design.measurement_max:
        return _refuse(design, state, applied, out, NO_MEASUREMENT)
    if not dt >= _SHORTEST_STEP:
        return _refuse(design, state, applied, out, BAD_TIME_STEP)
    if not LOWEST <= applied <= HIGHEST:
        applied = design.safe_command
    if sent != sent:
        sent = applied
    if not LOWEST <= reference[0] <= HIGHEST:
        return _refuse(design, state, applied, out, BAD_REFERENCE)
    if design.error_based and not _usable(reference):  # no sum below would show it
        return _refuse(design, state, applied, out, BAD_REFERENCE)
    known = state.since_sample[1]
    before = state.offset
    acting = applied - before[2]
    b0, special = design.b0, design.special
    if special:
        b0 = state.gain[0]
        if design.input_delay > 0.0:
            line = state.delay_line
            acting = pass_through(design.input_delay, line, acting, dt - known, out.delay_line)
            if design.feed_forward_timeout > 0.0:
                line = state.fed_line
                pass_through(design.input_delay, line, before[2], dt - known, out.fed_line)
        if design.measurement_period > 0.0:
            copy_vector(state.angle, out.angle)
    if dt > design.max_dt:
        return _restart(
            design,
            state,
            reference,
            measurement,
            present(sent, downstream),
            acting,
            out,
            gain_variable,
            feed_forward,
        )
    profile = out.profile
    if design.tracking_acceleration > 0.0:
        copy_vector(state.profile, profile)
        track(reference[0], design.tracking_acceleration, dt, profile)
    else:  # a call of copy_vector would take a fortieth of the step
        i = design.order
        while i >= 0:
            profile[i] = reference[i]
            i -= 1
    observed = measurement
    if design.error_based:
        observed -= profile[0]
    speed = 1.0
    risen = startup = state.startup[0]
    if startup < 1.0:
        startup = rise(startup, dt, design.startup_time)
        speed = startup * startup * startup
    out.startup[0] = startup
    acted = acting
    if known > 0.0:
        acted = state.since_sample[0]
        if known < dt:  # the last command acted for the rest
            acted += (acting - acted) * (1.0 - known / dt)
    out.since_sample[1] = 0.0
    received = b0 * acted
    if special and design.known:
        update_known(design, state, observed, received, dt, speed, out)
    else:
        update(design, state.levels, observed, received, dt, speed, out.levels, out.scratch)
    lasting, brief = before[0], before[1]
    offset = out.offset
    offset[2] = feed_forward
    offset[0] = lasting * exp(-design.controller_bandwidth * dt) if lasting != 0.0 else 0.0
    offset[1] = brief * exp(-design.bandwidths[0] * dt) if brief != 0.0 else 0.0
    if special:
        if design.gain_source > 0:
            follow_gain(design, state, gain_variable, sent, acting, dt, out)
        if design.error_deadband > 0.0:
            mind_deadband(design, state, reference, sent, acting, dt, out)
    raw = raw_command(design, out)
    if raw - raw != 0.0:  # not finite: a derivative of the reference, or wildly uneven dt
        return _restart(
            design,
            state,
            reference,
            measurement,
            present(sent, downstream),
            acting,
            out,
            gain_variable,
            feed_forward,
        )
    share = 1.0
    if risen > 0.0:  # at the first step of all there is nothing to smooth with
        share = design.controller_bandwidth * dt
        share /= 1.0 + share  # implicit Euler: below 1 however long dt is
    usual, smoothed = state.smoothed, out.smoothed
    once, twice = usual[0], usual[1]
    once += (raw - offset[0] - offset[1] - feed_forward - once) * share
    smoothed[0] = once
    smoothed[1] = twice + (once - twice) * share
    if lasting != 0.0:
        # An offset that was made under a bad sample may be far too large. What of it only presses
        # against a limit goes at once, which the command does not show.
        excess = raw - clamp(design, raw)
        if excess * lasting > 0.0:
            removed = min(abs(excess), abs(offset[0]))
            offset[0] -= copysign(removed, lasting)
    return limit(design, raw, sent, dt, downstream)


def rise(startup: float, dt: float, startup_time: float) -> float:
    """
    Return how far a start is by now: the share t / T of which the cube slows the observers.

    The device against peaking of section II-C of the paper: 1/eps = 100 t^3 in the first second
    and 100 from then on. It is for the first start of all, from a state that nobody knows: what
    has risen never falls, whatever ``startup_time`` becomes, nor when the observers restart, as
    slow observers would open a loop that relies on them. Counted in shares, not in seconds, so
    that a live change of ``startup_time`` goes on from where the rise is.
    """
    if not dt < startup_time:
        return 1.0
    return min(1.0, startup + dt / startup_time)


def _restart(
    design: Design,
    state: State,
    reference: Vector,
    measurement: float,
    applied: float,
    acting: float,
    out: State,
    gain_variable: float,
    feed_forward: float,
) -> tuple[float, int]:
    profile = state.profile  # of a reference that is approached: it goes on from where it is
    if design.tracking_acceleration <= 0.0:
        if not _usable(reference):
            return _refuse(design, state, applied, out, BAD_REFERENCE)
        profile = reference
    # Nobody knows how far an angle turned meanwhile: on the short way to where it shall be.
    measurement -= whole(measurement - profile[0], design.measurement_period)
    copy_vector(state.gain, out.gain)
    copy_vector(state.feedback, out.feedback)
    if design.gain_source > 0:
        begin_gain(design, measurement, profile[0], gain_variable, out)
    out.offset[2] = feed_forward
    rest(design, measurement, acting, profile[0], out)
    copy_vector(profile, out.profile)
    out.smoothed[0] = out.smoothed[1] = raw_command(design, out) - feed_forward
    out.startup[0] = state.startup[0]
    match_command(design, out, applied)
    return clamp(design, applied), RESTARTED


def _usable(reference: Vector) -> bool:
    usable = True
    for value in reference:
        usable = usable and LOWEST <= value <= HIGHEST
    return usable


def _refuse(
    design: Design, state: State, applied: float, out: State, status: int
) -> tuple[float, int]:
    copy_state(state, out)
    return clamp(design, applied), status
