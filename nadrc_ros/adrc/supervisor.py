"""
The fault policy: a small state machine that decides whether the law may act.

    OK -> HOLDING -> RAMPING -> SAFE, and back to OK after enough good samples.

Causes are ranked; while several are present the most severe acts, and a fault never becomes milder
before it ends. Silence and nonsense are one thing here: the age of a measurement is the age of the
last VALID one.
"""

from __future__ import annotations

from math import inf, nan
from typing import NamedTuple

from nadrc_ros.adrc.angle import short
from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.status import (
    DISABLED,
    HOLDING,
    MEASUREMENT_TIMEOUT,
    MODE_OK,
    NONE,
    NOT_FOLLOWED,
    RAMPING,
    REFERENCE_TIMEOUT,
    SAFE,
    STALLED,
    START,
)

# The mode that each cause asks for.
_ENTRY = (MODE_OK, HOLDING, HOLDING, HOLDING, HOLDING, SAFE, RAMPING)
# A step between two samples that is longer than the longest of late by this factor is odd.
_ODD = 2.0
# How much nearer to the reference counts as progress, as a share of the distance.
_PROGRESS = 0.05


class Stall(NamedTuple):
    """
    Whether the loop idles at a limit of the command, where it may do so for ever.

    ``at_limit`` [s] is how long the command has been at a limit other than ``safe_command``,
    ``stalled`` [s] how long the output has come no nearer meanwhile to the reference that was
    ``aim``, from which it was ``distance`` away.
    """

    at_limit: float = 0.0
    stalled: float = 0.0
    aim: float = 0.0
    distance: float = 0.0


class PolicyState(NamedTuple):
    """
    State of the policy: mode, cause, ages of the last valid inputs [s], inf where there was none.

    ``fault_age`` [s] counts since the fault began, ``gap`` [s] the time of samples that could not
    be used, ``good`` valid samples in a row, of which ``last`` is the last; ``spread`` is the
    longest step between two of them, halved with each since.
    """

    mode: int = SAFE
    cause: int = START
    measurement_age: float = inf
    reference_age: float = inf
    fault_age: float = 0.0
    gap: float = 0.0
    good: int = 0
    last: float = nan
    spread: float = 0.0
    stall: Stall = Stall()


def supervise(
    design: Design,
    before: PolicyState,
    sample: Sample,
    used: bool,
    referenced: bool,
    enabled: bool,
    limited: bool,
    aim: float,
    seen: float,
) -> PolicyState:
    """
    Advance the policy by one tick.

    ``used`` says whether the law took the sample, ``referenced`` whether a reference was received,
    ``limited`` whether the law asks for more than a limit that is not the safe one, on its way to
    ``aim``. ``seen`` is the measurement, that of an angle with all turns.

    The law takes over after ``good_samples`` valid samples in a row, at one that is not odd: no
    more than twice as far from the one before as those shortly before were. The step to an odd one
    counts for the next, so that no more than one is passed over, unless the steps double for ever.

    While an inner loop does not follow, the command is held where that loop is, however long. It
    is where to go on from, and needs no ramp to ``safe_command`` either, as nothing acts on it.
    """
    good, last, spread, odd = before.good, before.last, before.spread, False
    if used:
        jump = abs(seen - last)  # nan before the first
        if design.measurement_period > 0.0:
            jump = abs(short(jump, design.measurement_period))
        if good == 0:
            jump = spread = 0.0
        odd = jump > _ODD * spread
        spread *= 0.5
        if jump > spread:
            spread = jump
        last = seen
        good += 1
    elif sample.span > 0.0:  # else no sample came, which is not a bad one
        good = 0
    proven = used and good >= design.good_samples and not odd
    # Infinite until the sensor has proved itself once: then every valid sample counts.
    measurement_age = before.measurement_age + sample.elapsed
    if used and (proven or measurement_age < inf):
        measurement_age = sample.age
    reference_age = 0.0 if referenced else before.reference_age + sample.elapsed
    stall = before.stall
    if enabled:
        if before.mode == MODE_OK:
            stall = _watch_progress(stall, sample.elapsed, used, limited, aim, last)
    elif stall.at_limit > 0.0 or stall.stalled > 0.0:
        stall = Stall(0.0, 0.0, stall.aim, stall.distance)

    # The most severe cause that is present now; then whether the one from before goes on.
    cause = NONE
    if not enabled:
        cause = DISABLED
    elif measurement_age == inf:
        cause = START
    elif not used and 0.0 < design.measurement_timeout < measurement_age:
        cause = MEASUREMENT_TIMEOUT
    elif design.stall_stops and 0.0 < design.stall_time < stall.stalled:
        cause = STALLED
    elif 0.0 < design.reference_timeout < reference_age < inf:
        cause = REFERENCE_TIMEOUT
    elif not sample.followed:
        cause = NOT_FOLLOWED

    mode = max(before.mode, _ENTRY[cause])
    waiting = before.mode == MODE_OK or before.cause == NOT_FOLLOWED
    fault_age = 0.0 if waiting else before.fault_age + sample.elapsed
    if mode == HOLDING and fault_age > design.hold_time:
        mode = RAMPING
    # One tick later than it is reached, so that the safe command was sent.
    sent = sample.sent if sample.sent == sample.sent else sample.applied
    there = before.mode == RAMPING and sent == design.safe_command
    if mode == RAMPING and (there or not sample.followed):
        mode = SAFE
    if cause <= NOT_FOLLOWED and proven:
        mode = _ENTRY[cause]
    else:
        if NOT_FOLLOWED < cause < START:  # what is lost now has to prove itself anew
            good = 0
        if cause == NONE or before.cause != DISABLED:  # to be disabled ends with the switch
            cause = max(cause, before.cause)
    gap = 0.0 if used else before.gap + (sample.span if sample.span > 0.0 else 0.0)
    return PolicyState(
        mode, cause, measurement_age, reference_age, fault_age, gap, good, last, spread, stall
    )


def _watch_progress(
    stall: Stall, elapsed: float, used: bool, limited: bool, aim: float, last: float
) -> Stall:
    """
    Count how long the loop has been at a limit, and how long without progress.

    A command that only grazes its limit is no stall, nor is a loop that is on its way: the count
    begins anew whenever the output came nearer to what was aimed at then by a share of that
    distance, or went past what is aimed at now. The distance is to the aim of the last such
    moment, so that a loop is on its way too that trails a ramp and comes no nearer to its end.
    """
    at_limit, stalled = stall.at_limit + elapsed, stall.stalled + elapsed
    if used:
        if not limited:
            at_limit = stalled = 0.0
        distance = stall.distance
        nearer = abs(stall.aim - last) <= (1.0 - _PROGRESS) * abs(distance)
        beyond = (aim - last) * distance < 0.0
        if stalled == 0.0 or distance == 0.0 or nearer or beyond:
            return Stall(at_limit, 0.0, aim, aim - last)
    return Stall(at_limit, stalled, stall.aim, stall.distance)
