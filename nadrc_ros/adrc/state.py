"""
The state of one controller, and what can be read from it or set in it without a sample.

State is explicit: ``law.step`` reads one and writes another that never aliases it, so that replay,
rollback and a bumpless change of settings are ordinary assignments.
"""

from __future__ import annotations

from math import inf, nan
from typing import Any

import attrs
from nadrc_ros.adrc.delay_line import acting, blank_line, copy_line
from nadrc_ros.adrc.design import Design, Matrix, Vector
from nadrc_ros.adrc.feedback import fal_feedback
from nadrc_ros.adrc.limiter import clamp

# Of ``State.work``, before its two matrices.
WORK_VECTORS = 5


@attrs.frozen
class State:
    """
    State of one controller: observer ``levels`` (K, N), reference ``profile`` r, r', ... (n+1,).

    In level k (counted from 0) ``levels[k][n]`` is its disturbance estimate d_k. ``offset`` (3,)
    is what was added to the command of the law: by a bumpless transfer, decaying with the
    controller bandwidth; what of that is noise of one sample, decaying with that of the inner
    observer; and the feed-forward, without which is what is held, the mean and what is on its way.
    ``smoothed`` (2,) is the unlimited command without that, smoothed with the controller bandwidth
    once and twice. ``startup`` (1,) is how far the observers are through their rise after the
    first start, from 0 to 1. ``gain`` (3,) is b0, what it was looked up for in its table, and
    whether it was (1 or 0). ``resting`` (4,) is whether the command is held inside the deadband (1
    or 0), that command, the reference it is held for, and how long the error was small [s].
    ``since_sample`` (2,) is the mean command of the ticks without a sample that followed the last
    one, and their time [s]. ``delay_line`` is what is on its way to a plant with dead time, empty
    without one: see :mod:`~nadrc_ros.adrc.delay_line`; ``fed_line`` is the feed-forward on its
    way, if there may be any. ``angle`` (3,) is of an angle: the last reference received, nan
    before it, the equivalent of it that is followed, and the turns that were taken off all of
    these. ``scratch`` (K + 2, N) remembers the observer gains of the last time step: it changes
    the speed of a step, and nothing else.

    With known dynamics (:mod:`~nadrc_ros.adrc.internal_model`) ``ripple`` (n+1,) is what a known
    vibration makes of y, ..., y^(n-1) at the samples under the command that cancels it, and by how
    much that is another one than -d; ``feedback`` (n,) are the gains of the linear feedback for
    the last time step, which without known poles are those of the design; ``transition``,
    ``foresight`` and ``work`` are more scratch.
    """

    levels: Matrix
    profile: Vector
    offset: Vector
    smoothed: Vector
    startup: Vector
    gain: Vector
    resting: Vector
    since_sample: Vector
    delay_line: Vector
    fed_line: Vector
    angle: Vector
    scratch: Matrix
    ripple: Vector
    feedback: Vector
    transition: Matrix
    foresight: Matrix
    work: Matrix
    rows: tuple[Vector, ...] = attrs.field(init=False, eq=False, repr=False)

    @rows.default
    def _all_rows(self) -> tuple[Vector, ...]:
        """Return all vectors in the order of the fields, a matrix row by row."""
        return rows_of(self)


def rows_of(thing: Any) -> tuple[Vector, ...]:
    """Return the vectors among the fields of something, a matrix row by row."""
    rows: list[Vector] = []
    for field in attrs.fields(type(thing)):
        value = getattr(thing, field.name, None) if field.init else None
        if isinstance(value, list):
            rows += value if value and isinstance(value[0], list) else [value]
    return tuple(rows)


def blank_state(design: Design) -> State:
    """Return a state of the right shape, all zero."""
    return State(
        [[0.0] * design.states for _ in range(design.levels)],
        [0.0] * (design.order + 1),
        [0.0, 0.0, 0.0],
        [0.0, 0.0],
        [0.0],
        [design.b0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0],
        blank_line(design.input_delay),
        blank_line(design.input_delay if design.feed_forward_timeout > 0.0 else 0.0),
        [nan, 0.0, 0.0],
        [[0.0] * design.states for _ in range(design.levels + 2)],
        [0.0] * (design.order + 1),
        list(design.feedback_gains),
        *_known_matrices(design),
    )


def _known_matrices(design: Design) -> tuple[Matrix, Matrix, Matrix]:
    """Return transition, foresight and work, all zero; one entry each where nothing is known."""
    if not design.known:
        return [[0.0]], [[0.0]], [[0.0]]
    order, states = design.order, design.states
    largest = max(states, order * (states - order))
    return (
        [[0.0] * (states + 1) for _ in range(states + 1)],
        [[0.0] * (states - order) for _ in range(order + 1)],
        [[0.0] * (largest + 1) for _ in range(WORK_VECTORS + states + largest)],
    )


def start(
    design: Design, measurement: float, applied: float, reference: float, out: State
) -> None:
    """
    Write into ``out`` the state of a first start, at rest: the observers rise from here.

    The profile starts at the measurement with the tracking differentiator, at the reference
    without. What is on its way to a plant with dead time stays known.
    """
    origin = measurement if design.tracking_acceleration > 0.0 else reference
    out.gain[0], out.gain[1], out.gain[2] = design.b0, 0.0, 0.0
    driving = applied - out.offset[2]
    rest(design, measurement, acting(out.delay_line, driving), origin, out)
    out.startup[0] = 0.0
    out.angle[2] = 0.0


def rest(design: Design, measurement: float, applied: float, origin: float, out: State) -> None:
    """
    Write estimates and profile at rest: y measured, y' = 0, and the d_1 that keeps it.

    That is a_0 y - b0 u, with a_0 the product of the known poles times -1, and u what is
    ``applied`` without the feed-forward, which ``out`` knows.
    """
    for k in range(design.levels):
        for i in range(design.states):
            out.levels[k][i] = 0.0
    for i in range(design.order + 1):
        out.profile[i] = out.ripple[i] = 0.0
    out.profile[0] = origin
    for k in range(design.levels):
        out.levels[k][0] = measurement - origin if design.error_based else measurement
    out.levels[0][design.order] = -out.gain[0] * applied
    if design.known:
        out.levels[0][design.order] += design.damping[0] * out.levels[0][0]
    for i in range(len(out.resting)):
        out.resting[i] = 0.0
    out.offset[0] = out.offset[1] = 0.0
    out.since_sample[1] = 0.0
    out.smoothed[0] = out.smoothed[1] = raw_command(design, out) - out.offset[2]


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
    copy_vector(state.smoothed, out.smoothed)
    out.startup[0] = state.startup[0]
    copy_vector(state.gain, out.gain)
    copy_vector(state.resting, out.resting)
    copy_vector(state.since_sample, out.since_sample)
    if len(state.delay_line) > 0:
        copy_line(state.delay_line, out.delay_line)
        copy_line(state.fed_line, out.fed_line)
    copy_vector(state.angle, out.angle)
    copy_vector(state.ripple, out.ripple)
    copy_vector(state.feedback, out.feedback)


def average_command(state: State, applied: float, elapsed: float) -> None:
    """Take into the mean of the commands since the last sample the one of a tick without one."""
    mean, waited = state.since_sample[0], state.since_sample[1]
    total = waited + elapsed
    share = elapsed / total if waited > 0.0 and total < inf else 1.0
    state.since_sample[0] = mean + (applied - mean) * share if share < 1.0 else applied
    state.since_sample[1] = total


def calm(design: Design, x: Vector, state: State) -> float:
    """
    Write y, ..., y^(n-1) with the known vibrations left to themselves into ``work``.

    Return what b0 u has beside the feedback on it, sum_i a_i y^(i) and what ``ripple`` says.
    """
    y, i = state.work[0], design.order
    while i > 0:
        i -= 1
        y[i] = x[i] - state.ripple[i]
    return damping(design, y) - state.ripple[design.order]


def damping(design: Design, x: Vector, first: int = 0) -> float:
    """Return a_0 y + ... + a_{n-1} y^(n-1), y from ``first`` in x: L is more by that."""
    total, i = 0.0, design.order
    while i > 0:
        i -= 1
        total += design.damping[i] * x[first + i]
    return total


def raw_command(design: Design, state: State) -> float:
    """
    Return u = (v + sum_i a_i y^(i) - sum_k d_k) / b0 + offset + feed-forward, not limited.

    The feedback v = r^(n) + sum_i k_i g(r^(i) - y^(i)), g the identity or fal, is in units of
    y^(n); the paper never writes the sum. At rest u is what is held, + feed-forward.
    """
    levels = state.levels
    order = design.order
    reference = design.no_reference if design.error_based else state.profile
    x = levels[design.feedback_level]
    b0, v = design.b0, reference[order]
    gains = design.feedback_gains
    if design.special:
        if design.error_deadband > 0.0 and state.resting[0] > 0.0:
            return state.resting[1] + state.offset[2]
        b0 = state.gain[0]
        if design.known:
            v += calm(design, x, state)
            x, gains = state.work[0], state.feedback
    if design.linear:  # here, as a call would take a thirtieth of the step
        i = 0
        while i < order:
            v += gains[i] * (reference[i] - x[i])
            i += 1
    else:
        v = fal_feedback(design, x, reference, v)
    k = design.cancelled
    while k > 0:
        k -= 1
        v -= levels[k][order]
    offset = state.offset
    return v / b0 + offset[0] + offset[1] + offset[2]


def match_command(design: Design, state: State, command: float) -> None:
    """
    Set the offset so that ``state`` gives ``command`` inside the limits, if it does not anyway.

    The estimates stay what they are. A disturbance estimate made to fit instead would be wrong by
    as much, and its correction would drive the plant the wrong way first. What the law asks for
    beyond what is usual is the noise of one sample, which a slow loop would integrate for long: so
    that part decays with the inner observer.
    """
    raw = raw_command(design, state)
    if clamp(design, raw) != command:
        law = raw - state.offset[0] - state.offset[1] - state.offset[2]
        usual = 2.0 * state.smoothed[0] - state.smoothed[1]  # which does not lag a ramp
        state.offset[1] = usual - law
        state.offset[0] += command - raw_command(design, state)


def output_estimate(design: Design, state: State) -> float:
    """Return y as the level that feeds the law estimates it; of an angle without some turns."""
    estimate = state.levels[design.feedback_level][0]
    return estimate + state.profile[0] if design.error_based else estimate


def disturbance_estimate(design: Design, state: State) -> float:
    """
    Return the estimate of L = y^(n) + sum_i a_i y^(i) - b0 u.

    What the feed-forward leaves of it, and what that is there to cancel: -b0 times what of it acts
    by now.
    """
    return remainder(design, state) - state.gain[0] * acting(state.fed_line, state.offset[2])


def remainder(design: Design, state: State) -> float:
    """Return the estimate of what the feed-forward leaves of L: the sum of the levels."""
    total = 0.0
    for k in range(design.levels):
        total += state.levels[k][design.order]
    return total + reference_share(design, state.profile) if design.error_based else total


def known_before(design: Design, state: State) -> float:
    """Return what is to be taken off L before it is estimated: feed-forward and reference."""
    known = -state.gain[0] * state.offset[2]
    return known + reference_share(design, state.profile) if design.error_based else known


def reference_share(design: Design, profile: Vector) -> float:
    """Return r^(n) + sum_i a_i r^(i): by so much the L of y is more than that of y - r."""
    share = profile[design.order]
    return share + damping(design, profile) if design.known else share
