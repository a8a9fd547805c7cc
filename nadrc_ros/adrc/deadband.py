"""
Rest: inside a deadband of the error the command is held, and nothing hunts.

A plant with stiction, or a sensor of coarse counts, never stops exactly at the reference: the
disturbance estimate builds up until the plant breaks loose and goes past it, for ever. At rest the
observers go on with the held command, so that to leave it is no bump and what began to act
meanwhile is known.
"""

from __future__ import annotations

from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.limiter import clamp
from nadrc_ros.adrc.state import (
    copy_vector,
    match_command,
    output_estimate,
    remainder,
    State,
)

# So long has it to be near, counted in 1 / wc: a plant that slides on is elsewhere by then.
_PATIENCE = 1.0


def mind_deadband(
    design: Design,
    state: State,
    reference: Vector,
    sent: float,
    acting: float,
    dt: float,
    out: State,
) -> None:
    """
    Let ``out``, which follows ``state``, begin to rest, go on, or wake.

    With the error e = r - y, as estimated, of a reference that stands still, rest begins when |e|
    has been below half of the deadband for 1 / wc, and so is now

        |e| + |e'| / wc + |b0 (u - usual)| / wc^n:

    not on the way through, and not at a peak of the command u, what is usual being smoothed with
    the controller bandwidth wc. That u, which was ``sent`` last, is held; a feed-forward is still
    added. Rest ends, first with the held command, once |e| exceeds the deadband, the reference
    moves, or the limits exclude that command.
    """
    error = reference[0] - output_estimate(design, out)
    still = True
    if not design.tracking_acceleration > 0.0:
        for i in range(1, len(reference)):
            still = still and reference[i] == 0.0
    held = state.resting[1] + out.offset[2]
    same = still and reference[0] == state.resting[2]
    out.resting[0], out.resting[2], out.resting[3] = 0.0, reference[0], 0.0
    if state.resting[0] > 0.0:
        if same and abs(error) <= design.error_deadband and clamp(design, held) == held:
            _hold(state.resting[1], out)
            return
        copy_vector(state.smoothed, out.smoothed)
        match_command(design, out, clamp(design, held))
        return
    half = 0.5 * design.error_deadband
    if not (same and abs(error) < half):
        return
    out.resting[3] = state.resting[3] + dt
    if out.resting[3] * design.controller_bandwidth < _PATIENCE:
        return
    driving = sent - state.offset[2]
    away = abs(state.gain[0] * (driving - state.smoothed[0]))
    for _ in range(design.order - 1):
        away /= design.controller_bandwidth
    away = abs(error) + (abs(_speed(design, acting, out)) + away) / design.controller_bandwidth
    if away < half:
        _hold(clamp(design, sent) - state.offset[2], out)


def _hold(command: float, out: State) -> None:
    out.resting[0], out.resting[1] = 1.0, command
    out.offset[0] = out.offset[1] = 0.0


def _speed(design: Design, acting: float, state: State) -> float:
    """Return y' - r1' as estimated."""
    if design.order == 1:  # there is no state of that name: y' + a_0 y = b0 u + L
        speed = state.gain[0] * acting + remainder(design, state)
        if design.known:
            speed -= design.damping[0] * output_estimate(design, state)
        return speed - state.profile[1]
    speed = state.levels[design.feedback_level][1]
    return speed if design.error_based else speed - state.profile[1]
