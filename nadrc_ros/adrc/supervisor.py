"""
The fault policy: a small state machine that decides whether the law may act.

    OK -> HOLDING -> RAMPING -> SAFE, and back to OK after enough good samples.

Causes are ranked; while several are present the most severe acts, and a fault never becomes milder
before it ends. Silence and nonsense are one thing here: the age of a measurement is the age of the
last VALID one.
"""

from __future__ import annotations

from enum import IntEnum
from math import inf, isfinite, nan
from typing import NamedTuple

from nadrc_ros.adrc.design import Design


class Mode(IntEnum):
    """What the command is: the law's, held, on its way to safe, safe. Ordered by severity."""

    OK = 0
    HOLDING = 1
    RAMPING = 2
    SAFE = 3


class Cause(IntEnum):
    """Why the law may not act, ranked; ``START`` is before ``good_samples`` measurements."""

    NONE = 0
    REFERENCE_TIMEOUT = 1
    STALLED = 2
    MEASUREMENT_TIMEOUT = 3
    START = 4
    DISABLED = 5


# Plain integers, for the functions of the control loop.
MODE_OK = int(Mode.OK)
HOLDING = int(Mode.HOLDING)
RAMPING = int(Mode.RAMPING)
SAFE = int(Mode.SAFE)
NONE = int(Cause.NONE)
REFERENCE_TIMEOUT = int(Cause.REFERENCE_TIMEOUT)
STALLED = int(Cause.STALLED)
MEASUREMENT_TIMEOUT = int(Cause.MEASUREMENT_TIMEOUT)
START = int(Cause.START)
DISABLED = int(Cause.DISABLED)
_ENTRY = (MODE_OK, HOLDING, HOLDING, HOLDING, SAFE, RAMPING)
# A step between two samples that is longer than the longest of late by this factor is odd.
ODD = 2.0
# How much nearer to the reference counts as progress, as a share of the distance.
PROGRESS = 0.05


class Watch(NamedTuple):
    """
    State of the policy: mode, cause, ages of the last valid inputs [s], inf where there was none.

    ``fault_age`` [s] counts since the fault began, ``gap`` [s] the time of samples that could not
    be used, ``good`` valid samples in a row, of which ``last`` is the last; ``spread`` is the
    longest step between two of them, halved with each since. ``limited`` [s] is how long the
    command has been at a limit other than ``safe_command``, where a loop may idle for ever,
    ``stalled`` [s] how long the output has come no nearer meanwhile to the reference that was
    ``aim``, from which it was ``distance`` away.
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
    limited: float = 0.0
    stalled: float = 0.0
    aim: float = 0.0
    distance: float = 0.0


def supervise(
    design: Design,
    watch: Watch,
    enabled: bool,
    measurement: float,
    referenced: bool,
    at_safe: bool,
    limited: bool,
    aim: float,
    dt: float,
    elapsed: float,
    age: float,
) -> Watch:
    """
    Advance the policy by one tick.

    ``measurement`` is nan unless a valid sample was used, ``referenced`` says whether a reference
    was received, ``at_safe`` whether the last command was ``safe_command``, ``limited`` whether
    the law asks for more than a limit that is not the safe one, on its way to ``aim``; ``dt`` is
    the time this tick's sample spans, ``elapsed`` the time since the last tick and ``age`` that
    since the sample was there [s].

    The law takes over after ``good_samples`` valid samples in a row, at one that is not odd: no
    more than twice as far from the one before as those shortly before were. The step to an odd one
    counts for the next, so that no more than one is passed over, unless the steps double for ever.
    """
    measured = isfinite(measurement)
    good, last, spread, odd = watch.good, watch.last, watch.spread, False
    if measured:
        jump = abs(measurement - last)  # nan before the first
        if good == 0:
            jump = spread = 0.0
        odd = jump > ODD * spread
        spread *= 0.5
        if jump > spread:
            spread = jump
        last = measurement
        good += 1
    elif dt > 0.0:  # else no sample came, which is not a bad one
        good = 0
    proven = measured and good >= design.good_samples and not odd
    measurement_age = watch.measurement_age + elapsed
    if measured and (proven or measurement_age < inf):
        measurement_age = age
    reference_age = 0.0 if referenced else watch.reference_age + elapsed

    at_limit, stalled, start, distance = watch.limited, watch.stalled, watch.aim, watch.distance
    if not enabled:
        at_limit = stalled = 0.0
    elif watch.mode == MODE_OK:
        at_limit += elapsed
        stalled += elapsed
        if measured and not limited:
            at_limit = stalled = 0.0
        nearer = abs(start - last) <= (1.0 - PROGRESS) * abs(distance)
        beyond = (aim - last) * distance < 0.0
        if measured and (stalled == 0.0 or distance == 0.0 or nearer or beyond):
            stalled, start, distance = 0.0, aim, aim - last

    cause = NONE
    if not enabled:
        cause = DISABLED
    elif measurement_age == inf:
        cause = START
    elif not measured and 0.0 < design.measurement_timeout < measurement_age:
        cause = MEASUREMENT_TIMEOUT
    elif design.stall_stops and 0.0 < design.stall_time < stalled:
        cause = STALLED
    elif 0.0 < design.reference_timeout < reference_age < inf:
        cause = REFERENCE_TIMEOUT

    mode = max(watch.mode, _ENTRY[cause])
    fault_age = watch.fault_age + elapsed if watch.mode != MODE_OK else 0.0
    if mode == HOLDING and fault_age > design.hold_time:
        mode = RAMPING
    if mode == RAMPING and watch.mode == RAMPING and at_safe:
        mode = SAFE
    if cause == NONE and proven:
        mode = MODE_OK
    elif NONE < cause < START:
        good = 0
    if mode == MODE_OK:
        cause = NONE
    elif cause == NONE or watch.cause != DISABLED:
        cause = max(cause, watch.cause)
    return Watch(
        mode,
        cause,
        measurement_age,
        reference_age,
        fault_age,
        0.0 if measured else watch.gap + max(dt, 0.0),
        good,
        last,
        spread,
        at_limit,
        stalled,
        start,
        distance,
    )
