"""
Angles: a measurement and a reference mean the same a period further.

Of all values that mean the same, the equivalents, the law is given one. The measurement becomes
the equivalent nearest to the prediction of level 1 (see ``observer``): so the observers never see
the jump of a sensor that wraps, and a gap in rotation is bridged while the prediction for its end
is off by less than half a period. The reference becomes an equivalent when it comes, and keeps it.
"""

from __future__ import annotations

from math import floor

from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.state import output_estimate, State

# A reference that changes by less than this share of a period moves on; by more, it is another.
_JUMP = 0.25
# Beyond so many periods a float hardly knows the angle. It is also far from where floor() raises.
_MOST_PERIODS = 1e15


def whole(difference: float, period: float) -> float:
    """Return the multiple of ``period`` nearest to a difference; 0 for a period of 0, or nan."""
    if not period > 0.0 or -0.5 * period <= difference <= 0.5 * period:
        return 0.0
    periods = difference / period
    if not -_MOST_PERIODS < periods < _MOST_PERIODS:
        return 0.0
    return period * floor(periods + 0.5)


def short(difference: float, period: float) -> float:
    """Return a difference the short way round, within half a ``period``; 0 = it is no angle."""
    return difference - whole(difference, period)


def receive(design: Design, state: State, reference: Vector) -> None:
    """
    Make the reference that was just received the equivalent that the law follows.

    ``state`` knows the last one, as it came in ``angle[0]``, which the caller goes on with.

    One that moves on from the last one received, by less than a quarter of a period, goes on from
    its equivalent: a trajectory keeps its turns, however far the plant lags. Any other goes to the
    equivalent nearest to the output estimate: from where the plant is, the short way. It stays
    there until the next one comes, as at half a period the noise would change the side at will.
    """
    period, raw = design.measurement_period, reference[0]
    if raw == state.angle[0]:
        reference[0] = state.angle[1]
        return
    change = short(raw - state.angle[0], period)  # nan before the first
    near = state.angle[1] + change
    if not abs(change) < _JUMP * period:
        near = output_estimate(design, state)
    reference[0] = raw - whole(raw - near, period)


def unwrapped(design: Design, state: State, measurement: float) -> float:
    """Return the equivalent of a measurement that the observers were given."""
    estimate = state.levels[0][0]  # between their prediction and the measurement
    if design.error_based:
        estimate += state.profile[0]
    return measurement - whole(measurement - estimate, design.measurement_period)


def recentre(design: Design, state: State, reference: Vector) -> None:
    """
    Take the turns off estimates, profile and ``reference`` once they are more than one period.

    So numbers stay small and precise however long the plant turns. The command sees differences
    alone. ``state.angle[2]`` counts the turns.
    """
    period = design.measurement_period
    estimate = output_estimate(design, state)
    if not abs(estimate) > period:
        return
    away = whole(estimate, period)
    if not design.error_based:
        for k in range(design.levels):
            state.levels[k][0] -= away
    state.profile[0] -= away
    state.resting[2] -= away
    reference[0] -= away
    state.angle[2] += floor(away / period + 0.5)


def counted(design: Design, state: State, angle: float) -> float:
    """Return an angle of ``state`` with the turns that were taken off."""
    if design.measurement_period > 0.0:
        return angle + design.measurement_period * state.angle[2]
    return angle
