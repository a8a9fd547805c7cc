"""
The law over one period, with all that goes in, and out, in one vector: what the loop calls.

``told`` is a sample and what the period before gave; what this one gives goes into another vector,
so that a period may be done again. These functions are evaluated for the shape of a design
(``adrc.specialise``) and then compiled.
"""

from __future__ import annotations

from nadrc_ros.adrc.angle import counted
from nadrc_ros.adrc.design import Design, Vector
from nadrc_ros.adrc.realised import realised_reference
from nadrc_ros.adrc.reference import ESTIMATED, estimated, follow
from nadrc_ros.adrc.sample import regular, Sample
from nadrc_ros.adrc.settings import MAX_LEVELS
from nadrc_ros.adrc.state import disturbance_estimate, known_before, output_estimate, State
from nadrc_ros.adrc.supervisor import PolicyState, Stall
from nadrc_ros.adrc.tick import tick

# Where what is, in the vector: a sample,
MEASUREMENT, SPAN, ELAPSED, AGE, APPLIED, FOLLOWED, GAIN_VARIABLE, APPLIED_AGE = range(8)
SENT, FEED_FORWARD, DOWNSTREAM, FOREIGN, REFERENCED, ENABLED = range(8, 14)
# the state of the policy, before and after,
MODE, CAUSE, MEASUREMENT_AGE, REFERENCE_AGE, FAULT_AGE, GAP, GOOD, LAST, SPREAD = range(14, 23)
AT_LIMIT, STALLED, AIM, DISTANCE = range(23, 27)
# what came of it,
COMMAND, STATUS, TRACKED, ESTIMATE, DISTURBANCE, KNOWN, B0 = range(27, 34)
FIRST_LEVEL = 34
# and of the reference.
REALISED = FIRST_LEVEL + MAX_LEVELS
CHANGED = REALISED + 1
# Whether the period was left undone.
LEFT = CHANGED + 1 + ESTIMATED
SIZE = LEFT + 1


def regular_period(
    design: Design, state: State, reference: Vector, told: Vector, out: State, gives: Vector
) -> None:
    """Advance by a period like all others, of which the measurement, span and load are told."""
    sample = regular(told[MEASUREMENT], told[SPAN], told[COMMAND], told[FEED_FORWARD])
    command, status, policy = tick(
        design, state, _policy(told), sample, reference, True, True, out
    )
    _tell(design, out, command, status, policy, gives)


def period(
    design: Design, state: State, reference: Vector, told: Vector, out: State, gives: Vector
) -> None:
    """Advance by any period."""
    sample = Sample(
        told[MEASUREMENT],
        told[SPAN],
        told[ELAPSED],
        told[AGE],
        told[APPLIED],
        told[FOLLOWED] > 0.0,
        told[GAIN_VARIABLE],
        told[APPLIED_AGE],
        told[SENT],
        told[FEED_FORWARD],
        told[DOWNSTREAM],
        told[FOREIGN] > 0.0,
    )
    referenced, enabled = told[REFERENCED] > 0.0, told[ENABLED] > 0.0
    command, status, policy = tick(
        design, state, _policy(told), sample, reference, referenced, enabled, out
    )
    _tell(design, out, command, status, policy, gives)


def realise(design: Design, state: State, told: Vector, unknown: float) -> None:
    """Tell what an inner loop made of its reference, see ``adrc.realised``."""
    told[REALISED] = realised_reference(design, state, _policy(told), told[COMMAND], unknown)


def estimate_derivatives(
    design: Design, memory: Vector, told: Vector, value: float, span: float
) -> None:
    """Tell the derivatives of a reference that comes alone, and whether they are another."""
    told[CHANGED] = 0.0
    if follow(design, memory, value, True, span, 0.0):
        told[CHANGED] = 1.0
        for i in range(1, 1 + ESTIMATED):
            told[CHANGED + i] = estimated(memory, i)


def _policy(told: Vector) -> PolicyState:
    return PolicyState(
        int(told[MODE]),
        int(told[CAUSE]),
        told[MEASUREMENT_AGE],
        told[REFERENCE_AGE],
        told[FAULT_AGE],
        told[GAP],
        int(told[GOOD]),
        told[LAST],
        told[SPREAD],
        Stall(told[AT_LIMIT], told[STALLED], told[AIM], told[DISTANCE]),
    )


def _tell(
    design: Design, out: State, command: float, status: int, policy: PolicyState, gives: Vector
) -> None:
    gives[LEFT] = 0.0
    gives[MODE], gives[CAUSE] = policy.mode, policy.cause
    gives[MEASUREMENT_AGE], gives[REFERENCE_AGE] = policy.measurement_age, policy.reference_age
    gives[FAULT_AGE], gives[GAP], gives[GOOD] = policy.fault_age, policy.gap, policy.good
    gives[LAST], gives[SPREAD] = policy.last, policy.spread
    gives[AT_LIMIT], gives[STALLED] = policy.stall.at_limit, policy.stall.stalled
    gives[AIM], gives[DISTANCE] = policy.stall.aim, policy.stall.distance
    gives[COMMAND], gives[STATUS] = command, status
    gives[TRACKED] = counted(design, out, out.profile[0])
    gives[ESTIMATE] = counted(design, out, output_estimate(design, out))
    gives[B0] = out.gain[0]
    gives[KNOWN] = known_before(design, out)
    gives[DISTURBANCE] = disturbance_estimate(design, out)
    for k in range(design.levels):
        gives[FIRST_LEVEL + k] = out.levels[k][design.order]
