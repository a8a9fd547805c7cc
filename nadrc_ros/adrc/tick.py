"""One tick: the law under the fault policy."""

from __future__ import annotations

from math import inf, isfinite

from nadrc_ros.adrc.angle import counted, receive, recentre, unwrapped, whole
from nadrc_ros.adrc.delay_line import pass_through
from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.law import step
from nadrc_ros.adrc.limiter import clamp, limit, present
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.state import average_command, match_command, raw_command, start, State
from nadrc_ros.adrc.status import (
    HOLDING,
    MODE_OK,
    NO_MEASUREMENT,
    RAMPING,
    REFERENCE_TIMEOUT,
    SATURATED,
)
from nadrc_ros.adrc.supervisor import PolicyState, supervise
from nadrc_ros.adrc.transfer import adopt_reference, restart_profile, turn_profile


def tick(
    design: Design,
    state: State,
    policy: PolicyState,
    sample: Sample,
    reference: Vector,
    referenced: bool,
    enabled: bool,
    out: State,
) -> tuple[float, int, PolicyState]:
    """
    Advance law and policy by one tick; return command, status and the policy's state.

    ``reference`` (n+1,) is the last one received, ``referenced`` whether that was in this tick;
    before the first it is written here: the first valid measurement, held. That of an angle is
    written in any case: the equivalent that the law follows.

    In this order, which is that of what is known when:

    1. The first measurement that is possible starts the state, which is written to, at rest.
    2. The law takes the sample, or refuses it and leaves the state as it was. It does so in a
       fault and while disabled too: the observers see what acts, so that to take over is no bump.
    3. Without a sample the command still goes to where the last one sent it, at the rate limit,
       and with the feed-forward.
    4. The policy decides whether the law may act, from what the law made of the sample.
    5. Derivatives of a reference that is older than ``max_dt``, or lost, count as 0 from now on.
    6. The command is the law's in OK, but what acts on entering it, and the law goes on from
       there; what acted then while holding, unless only the reference is missing: then
       the law keeps the plant at the last one; else it is on its way to ``safe_command``, and
       there at once where nothing follows it.
    """
    measurement, applied, elapsed = sample.measurement, sample.applied, sample.elapsed
    sent, downstream, feed_forward = sample.sent, sample.downstream, sample.feed_forward
    if sent != sent:
        sent = applied
    span = policy.gap + sample.span
    period, received = design.measurement_period, reference[0]
    if period > 0.0 and referenced:
        receive(design, state, reference)
    possible = design.measurement_min <= measurement <= design.measurement_max
    if possible and policy.measurement_age == inf:
        if policy.reference_age == inf and not referenced:
            _hold(reference, measurement)
        state.offset[2] = feed_forward
        start(design, measurement, applied, reference[0], state)
    command, status = step(
        design,
        state,
        reference,
        measurement,
        applied,
        span,
        out,
        sample.gain_variable,
        sent,
        downstream,
        feed_forward,
    )
    if period > 0.0 and referenced:
        out.angle[0] = received
    used = status < NO_MEASUREMENT
    if not used:
        acting = applied - state.offset[2]
        if design.input_delay > 0.0:
            line = out.delay_line
            acting = pass_through(design.input_delay, line, acting, elapsed, line)
            if design.feed_forward_timeout > 0.0:
                line = out.fed_line
                pass_through(design.input_delay, line, state.offset[2], elapsed, line)
        average_command(out, acting, elapsed)
        command = _without_sample(design, out, feed_forward, sent, elapsed, downstream)
    elif elapsed < span and status <= SATURATED:
        # The law counted the rate over the span, of which earlier ticks have had their share.
        command, limiting = limit(design, command, sent, elapsed, downstream)
        status = max(status, limiting)
    limited = status == SATURATED and command != design.safe_command
    seen, aim = measurement, out.profile[0]
    if period > 0.0:
        if used:  # a bad sample leaves the state as it is
            recentre(design, out, reference)
        measurement = unwrapped(design, out, measurement)
        seen, aim = counted(design, out, measurement), counted(design, out, out.profile[0])
    after = supervise(design, policy, sample, used, referenced, enabled, limited, aim, seen)
    mode = after.mode
    lost = after.cause == REFERENCE_TIMEOUT
    if (lost or design.max_dt < after.reference_age < inf) and _moves(reference):
        _hold(reference, reference[0])
        adopt_reference(design, reference, out, sent, elapsed, downstream)
    if mode == MODE_OK:
        if policy.mode != MODE_OK:
            # Our command is on its way to the safe one, or there, whoever is in control.
            theirs = sample.foreign and policy.mode >= RAMPING
            now = applied if theirs else present(sent, downstream)
            _take_over(design, policy, after.reference_age, measurement, now, reference, out)
            command = clamp(design, now)
    elif mode != HOLDING:
        out.resting[0] = 0.0
        command = design.safe_command
        if sample.followed:
            command = limit(design, command, sent, elapsed, downstream)[0]
    elif not lost:
        out.resting[0] = 0.0
        held = policy.mode == HOLDING and policy.cause != REFERENCE_TIMEOUT and sample.followed
        command = clamp(design, sent if held else present(sent, downstream))
    if period > 0.0:
        out.angle[1] = reference[0]
    return command, status, after


def _without_sample(
    design: Design,
    state: State,
    feed_forward: float,
    sent: float,
    elapsed: float,
    downstream: float,
) -> float:
    """Return the command of a tick without a sample: held, or still on its way to the last one."""
    fed = feed_forward != state.offset[2]
    state.offset[2] = feed_forward
    if design.command_rate_limit > 0.0 or fed:
        raw = raw_command(design, state)
        if isfinite(raw):
            return limit(design, raw, sent, elapsed, downstream)[0]
    return clamp(design, sent)


def _take_over(
    design: Design,
    before: PolicyState,
    reference_age: float,
    measurement: float,
    applied: float,
    reference: Vector,
    out: State,
) -> None:
    """
    Make the state one whose command is ``applied``.

    Where the profile of a differentiator was not followed, it starts anew from where the plant is:
    meanwhile it went to the reference, and to jump there is what it is to prevent. The reference
    of an angle goes to the equivalent nearest to the plant, which somebody may have turned.
    """
    if reference_age == inf:
        _hold(reference, measurement)
    followed = before.mode == HOLDING and before.cause == REFERENCE_TIMEOUT
    away = whole(reference[0] - measurement, design.measurement_period)
    if away != 0.0 and not followed:
        reference[0] -= away
        turn_profile(design, away, out)
    if reference_age == inf or (design.tracking_acceleration > 0.0 and not followed):
        restart_profile(design, measurement, out)
    out.resting[0] = 0.0
    match_command(design, out, applied)


def _hold(reference: Vector, value: float) -> None:
    reference[0] = value
    for i in range(1, len(reference)):
        reference[i] = 0.0


def _moves(reference: Vector) -> bool:
    moves = False
    for i in range(1, len(reference)):
        moves = moves or reference[i] != 0.0
    return moves
