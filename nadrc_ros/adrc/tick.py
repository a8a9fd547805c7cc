"""One tick: the law under the fault policy."""

from __future__ import annotations

from math import inf, isfinite, nan

from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.law import step
from nadrc_ros.adrc.limiter import clamp, limit
from nadrc_ros.adrc.settings import LARGEST, SMALLEST
from nadrc_ros.adrc.state import average_command, match_command, raw_command, start, State
from nadrc_ros.adrc.status import NO_MEASUREMENT, SATURATED
from nadrc_ros.adrc.supervisor import HOLDING, MODE_OK, REFERENCE_TIMEOUT, supervise, Watch
from nadrc_ros.adrc.transfer import adopt_reference, restart_profile


def tick(
    design: Design,
    state: State,
    watch: Watch,
    enabled: bool,
    reference: Vector,
    referenced: bool,
    measurement: float,
    applied: float,
    dt: float,
    elapsed: float,
    age: float,
    out: State,
) -> tuple[float, int, Watch]:
    """
    Advance law and policy by one tick; return command, status and the policy's state.

    ``measurement`` is nan when none came. ``reference`` (n+1,) is the last one received; before
    the first it is written here: the first valid measurement, held. ``dt`` is the time this tick's
    sample spans, ``elapsed`` the time since the last tick [s], over which the rate limit counts,
    ``age`` the time since the sample was there [s], from which its silence counts.
    On entering OK the first command equals ``applied``; the law goes on from there. Derivatives of
    a reference older than ``max_dt`` count as 0. At a start ``state`` is written to as well.
    """
    if not SMALLEST <= applied <= LARGEST:
        applied = design.safe_command
    if not elapsed > 0.0:
        elapsed = 0.0
    span = watch.gap + dt
    if not dt > 0.0:
        dt = 0.0
    possible = design.measurement_min <= measurement <= design.measurement_max
    if possible and watch.measurement_age == inf:
        if watch.reference_age == inf and not referenced:
            _hold(reference, measurement)
        start(design, measurement, applied, reference[0], state)
    command, status = step(design, state, reference, measurement, applied, span, out)
    measured = status < NO_MEASUREMENT
    if not measured:
        average_command(out, applied, elapsed)
        command = _go_on(design, out, applied, elapsed)
    elif elapsed < span and status <= SATURATED:
        command, limited = limit(design, command, applied, elapsed)
        status = max(status, limited)
    before = watch
    at_safe = applied == design.safe_command
    watch = supervise(
        design,
        watch,
        enabled,
        measurement if measured else nan,
        referenced,
        at_safe,
        status == SATURATED and command != design.safe_command,
        out.profile[0],
        dt,
        elapsed,
        age,
    )
    profiled = design.tracking_acceleration > 0.0
    stale = design.max_dt < watch.reference_age < inf or watch.cause == REFERENCE_TIMEOUT
    if stale and _moves(reference):
        _hold(reference, reference[0])
        adopt_reference(design, reference, out, applied, elapsed)
    if watch.mode == MODE_OK:
        if before.mode != MODE_OK:
            if watch.reference_age == inf:
                _hold(reference, measurement)
            followed = before.mode == HOLDING and before.cause == REFERENCE_TIMEOUT
            if watch.reference_age == inf or (profiled and not followed):
                restart_profile(design, measurement, out)
            match_command(design, out, applied)
            command = clamp(design, applied)
    elif watch.mode != HOLDING:
        command = limit(design, design.safe_command, applied, elapsed)[0]
    elif watch.cause != REFERENCE_TIMEOUT:
        command = clamp(design, applied)
    return command, status, watch


def _go_on(design: Design, state: State, applied: float, elapsed: float) -> float:
    """Return the command of a tick without a sample: held, or still on its way to the last one."""
    if design.command_rate_limit > 0.0:
        raw = raw_command(design, state)
        if isfinite(raw):
            return limit(design, raw, applied, elapsed)[0]
    return clamp(design, applied)


def _hold(reference: Vector, value: float) -> None:
    reference[0] = value
    for i in range(1, len(reference)):
        reference[i] = 0.0


def _moves(reference: Vector) -> bool:
    moves = False
    for i in range(1, len(reference)):
        moves = moves or reference[i] != 0.0
    return moves
