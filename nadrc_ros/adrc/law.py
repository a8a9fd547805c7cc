"""
The law as pure functions: N-ADRC from one sample to one command.

State is explicit. ``step`` reads one state and writes another that never aliases it, so that
replay, rollback and a bumpless change of settings are ordinary assignments. Nothing here raises:
bad input gives a :class:`Status`, and the state after ``step`` equals the one before to the bit.
``wait`` then takes the command of that tick into the mean that the next good sample is told.
"""

from __future__ import annotations

from math import copysign, exp, inf, isfinite

import attrs
from nadrc_ros.adrc.design import Design, Matrix, Vector
from nadrc_ros.adrc.differentiator import track
from nadrc_ros.adrc.feedback import feedback
from nadrc_ros.adrc.observer import update
from nadrc_ros.adrc.settings import LARGEST, SMALLEST
from nadrc_ros.adrc.status import (
    BAD_REFERENCE,
    BAD_TIME_STEP,
    NO_MEASUREMENT,
    OK,
    RATE_LIMITED,
    RESTARTED,
    SATURATED,
)

# Resolution of a time stamp [s].
SHORTEST = 1e-9


@attrs.frozen
class State:
    """
    State of one controller: observer ``levels`` (K, N), reference ``profile`` r, r', ... (n+1,).

    In level k (counted from 0) ``levels[k][n]`` is its disturbance estimate d_k. ``offset`` (2,)
    is what a bumpless transfer added to the command: at a takeover, decaying with the controller
    bandwidth, and what is noise of one sample, decaying with that of the inner observer.
    ``usual`` (2,) is the unlimited command without that, smoothed with the controller bandwidth
    once and twice.
    ``risen`` (1,) is how far the observers are through their rise after the first start, from 0 to
    1. ``waited`` (2,) is the mean command of the ticks without a sample that followed the last
    one, and their time [s]. ``scratch`` (K + 2, N) remembers the observer gains of the last time
    step: it changes the speed of a step, and nothing else.
    """

    levels: Matrix
    profile: Vector
    offset: Vector
    usual: Vector
    risen: Vector
    waited: Vector
    scratch: Matrix


def blank_state(design: Design) -> State:
    """Return a state of the right shape, all zero."""
    return State(
        [[0.0] * design.states for _ in range(design.levels)],
        [0.0] * (design.order + 1),
        [0.0, 0.0],
        [0.0, 0.0],
        [0.0],
        [0.0, 0.0],
        [[0.0] * design.states for _ in range(design.levels + 2)],
    )


def start(
    design: Design, measurement: float, applied: float, reference: float, out: State
) -> None:
    """
    Write into ``out`` the state of a first start, at rest: the observers rise from here.

    The profile starts at the measurement with the tracking differentiator, at the reference
    without.
    """
    origin = measurement if design.tracking_acceleration > 0.0 else reference
    rest(design, measurement, applied, origin, out)
    out.risen[0] = 0.0


def rest(design: Design, measurement: float, applied: float, origin: float, out: State) -> None:
    """Write estimates and profile at rest: y measured, y' = 0 and d_1 = -b0 u, which keeps it."""
    for k in range(design.levels):
        for i in range(design.states):
            out.levels[k][i] = 0.0
    for i in range(design.order + 1):
        out.profile[i] = 0.0
    out.profile[0] = origin
    for k in range(design.levels):
        out.levels[k][0] = measurement - origin if design.error_based else measurement
    out.levels[0][design.order] = -design.b0 * applied
    out.offset[0] = out.offset[1] = 0.0
    out.waited[1] = 0.0
    out.usual[0] = out.usual[1] = raw_command(design, out)


def init(
    design: Design, measurement: float, applied: float, reference: float | None = None
) -> State:
    """Return the state at rest at ``measurement`` under ``applied``; reference defaults to y."""
    state = blank_state(design)
    start(design, measurement, applied, measurement if reference is None else reference, state)
    return state


def copy_vector(source: Vector, out: Vector) -> None:
    """Copy ``source``; a slice would double what numba has to compile, for its error messages."""
    i, size = 0, len(source)
    while i < size:
        out[i] = source[i]
        i += 1


def copy_state(state: State, out: State) -> None:
    """Copy ``state`` into ``out``."""
    for k in range(len(state.levels)):
        copy_vector(state.levels[k], out.levels[k])
    copy_vector(state.profile, out.profile)
    copy_vector(state.offset, out.offset)
    copy_vector(state.usual, out.usual)
    out.risen[0] = state.risen[0]
    copy_vector(state.waited, out.waited)


def wait(state: State, applied: float, elapsed: float) -> None:
    """Take into the mean of the commands since the last sample the one of a tick without one."""
    mean, waited = state.waited[0], state.waited[1]
    total = waited + elapsed
    share = elapsed / total if waited > 0.0 and total < inf else 1.0
    state.waited[0] = mean + (applied - mean) * share if share < 1.0 else applied
    state.waited[1] = total


def step(
    design: Design,
    state: State,
    reference: Vector,
    measurement: float,
    applied: float,
    dt: float,
    out: State,
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

    Returns
    -------
    tuple
        b0 u = v - sum_k d_k (eq. (17) of the paper and v' = v - zh_{n+1}, which it never writes),
        limited in rate and then in magnitude. After ``dt > max_dt``, or should the estimates
        overflow, the observers restart without a bump. On bad input the applied command, brought
        inside the limits.

    """
    if not design.measurement_min <= measurement <= design.measurement_max:
        return _refuse(design, state, applied, out, NO_MEASUREMENT)
    if not dt >= SHORTEST:
        return _refuse(design, state, applied, out, BAD_TIME_STEP)
    if not SMALLEST <= applied <= LARGEST:
        applied = design.safe_command
    if not SMALLEST <= reference[0] <= LARGEST:
        return _refuse(design, state, applied, out, BAD_REFERENCE)
    if design.error_based and not _usable(reference):  # no sum below would show it
        return _refuse(design, state, applied, out, BAD_REFERENCE)
    if dt > design.max_dt:
        return _restart(design, state, reference, measurement, applied, out)
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
    risen = state.risen[0]
    if risen < 1.0:
        risen = rise(risen, dt, design.startup_time)
        speed = risen * risen * risen
    out.risen[0] = risen
    acted, waited = applied, state.waited[1]
    if waited > 0.0:
        acted = state.waited[0]
        if waited < dt:
            acted += (applied - acted) * (1.0 - waited / dt)
    out.waited[1] = 0.0
    update(design, state.levels, observed, acted, dt, speed, out.levels, out.scratch)
    offset = state.offset[0]
    out.offset[0] = offset * exp(-design.controller_bandwidth * dt) if offset != 0.0 else 0.0
    brief = state.offset[1]
    out.offset[1] = brief * exp(-design.bandwidths[0] * dt) if brief != 0.0 else 0.0
    raw = raw_command(design, out)
    if not isfinite(raw):  # a derivative of the reference, or wildly uneven dt
        return _restart(design, state, reference, measurement, applied, out)
    share = 1.0
    if state.risen[0] > 0.0:  # at the first step of all nothing was usual before
        share = design.controller_bandwidth * dt
        share /= 1.0 + share
    once, twice = state.usual[0], state.usual[1]
    once += (raw - out.offset[0] - out.offset[1] - once) * share
    out.usual[0] = once
    out.usual[1] = twice + (once - twice) * share
    if offset != 0.0:
        excess = raw - clamp(design, raw)
        if excess * offset > 0.0:  # an offset met under a bad sample must not wind up
            removed = min(abs(excess), abs(out.offset[0]))
            out.offset[0] -= copysign(removed, offset)
    return limit(design, raw, applied, dt)


def rise(risen: float, dt: float, startup_time: float) -> float:
    """
    Return how far a start is by now: the share t / T of which the cube slows the observers.

    The device against peaking of section II-C of the paper: 1/eps = 100 t^3 in the first second
    and 100 from then on. It is for the first start of all, from a state that nobody knows: what
    has risen never falls, whatever ``startup_time`` becomes, nor when the observers restart, as
    slow observers would open a loop that relies on them.
    """
    if not dt < startup_time:
        return 1.0
    return min(1.0, risen + dt / startup_time)


def raw_command(design: Design, state: State) -> float:
    """Return u = (v - sum_k d_k) / b0 + offset of a state, before the limits."""
    levels = state.levels
    order = design.order
    reference = design.no_reference if design.error_based else state.profile
    v = feedback(design, levels[design.feedback_level], reference)
    k = design.cancelled
    while k > 0:
        k -= 1
        v -= levels[k][order]
    return v / design.b0 + state.offset[0] + state.offset[1]


def output_estimate(design: Design, state: State) -> float:
    """Return y as the level that feeds the law estimates it."""
    estimate = state.levels[design.feedback_level][0]
    return estimate + state.profile[0] if design.error_based else estimate


def disturbance_estimate(design: Design, state: State) -> float:
    """Return the estimate of L = y^(n) - b0 u, the sum of the levels."""
    total = 0.0
    for k in range(design.levels):
        total += state.levels[k][design.order]
    return total + state.profile[design.order] if design.error_based else total


def clamp(design: Design, command: float) -> float:
    """Return ``command`` inside its limits, ``safe_command`` if it is not finite."""
    if not isfinite(command):
        return design.safe_command
    if command > design.command_max:
        return design.command_max
    if command < design.command_min:
        return design.command_min
    return command


def limit(design: Design, raw: float, applied: float, dt: float) -> tuple[float, int]:
    """Limit the change since ``applied`` to the rate limit times ``dt``, then the magnitude."""
    status = OK
    if design.command_rate_limit > 0.0:
        change = design.command_rate_limit * dt
        if raw > applied + change:
            raw = applied + change
            status = RATE_LIMITED
        elif raw < applied - change:
            raw = applied - change
            status = RATE_LIMITED
    if raw > design.command_max:
        return design.command_max, SATURATED
    if raw < design.command_min:
        return design.command_min, SATURATED
    return raw, status


def meet(design: Design, state: State, command: float) -> None:
    """
    Set the offset so that ``state`` gives ``command`` inside the limits, if it does not anyway.

    The estimates stay what they are. A disturbance estimate made to fit instead would be wrong by
    as much, and its correction would drive the plant the wrong way first. What the law asks for
    beyond what is usual is the noise of one sample, which a slow loop would integrate for long: so
    that part decays with the inner observer.
    """
    raw = raw_command(design, state)
    if clamp(design, raw) != command:
        law = raw - state.offset[0] - state.offset[1]
        state.offset[1] = 2.0 * state.usual[0] - state.usual[1] - law  # it does not lag a ramp
        state.offset[0] += command - raw_command(design, state)


def rejoin(design: Design, reference: Vector, state: State, applied: float, dt: float) -> None:
    """Let the profile be the reference as it is by now, without a bump."""
    if not design.tracking_acceleration > 0.0 and not design.error_based:  # else it was not used
        command = limit(design, raw_command(design, state), applied, dt)[0]
        copy_vector(reference, state.profile)
        raw = raw_command(design, state)
        if limit(design, raw, applied, dt)[0] != command:
            state.offset[0] += command - raw


def approach(design: Design, start_value: float, state: State) -> None:
    """Let the profile rest at ``start_value``; error-based estimates move along with it."""
    before = raw_command(design, state)
    for i in range(design.order + 1):
        origin = start_value if i == 0 else 0.0
        if design.error_based:  # d_1 is of L - r^(n)
            for k in range(design.levels if i < design.order else 1):
                state.levels[k][i] += state.profile[i] - origin
        state.profile[i] = origin
    change = raw_command(design, state) - before
    state.usual[0] += change
    state.usual[1] += change


def _restart(
    design: Design,
    state: State,
    reference: Vector,
    measurement: float,
    applied: float,
    out: State,
) -> tuple[float, int]:
    profile = state.profile  # of a reference that is approached: it goes on from where it is
    if design.tracking_acceleration <= 0.0:
        if not _usable(reference):
            return _refuse(design, state, applied, out, BAD_REFERENCE)
        profile = reference
    rest(design, measurement, applied, profile[0], out)
    copy_vector(profile, out.profile)
    out.usual[0] = out.usual[1] = raw_command(design, out)
    out.risen[0] = state.risen[0]
    meet(design, out, applied)
    return clamp(design, applied), RESTARTED


def _usable(reference: Vector) -> bool:
    usable = True
    for value in reference:
        usable = usable and SMALLEST <= value <= LARGEST
    return usable


def _refuse(
    design: Design, state: State, applied: float, out: State, status: int
) -> tuple[float, int]:
    copy_state(state, out)
    return clamp(design, applied), status
