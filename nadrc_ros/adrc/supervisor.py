"""
The fault policy: a small state machine that decides whether the law may act.

    OK -> HOLDING -> RAMPING -> SAFE, and back to OK after enough good samples.

Causes are ranked; while several are present the most severe acts, and a fault never becomes milder
before it ends. Silence and nonsense are one thing here: the age of a measurement is the age of the
last VALID one.
"""

from __future__ import annotations

from enum import IntEnum
from math import inf
from typing import NamedTuple

from nadrc_ros.adrc.design import Design


class Mode(IntEnum):
    """What the command is: the law's, held, on its way to safe, safe. Ordered by severity."""

    OK = 0
    HOLDING = 1
    RAMPING = 2
    SAFE = 3


class Cause(IntEnum):
    """Why the law may not act, ranked; ``START`` is before the first valid measurement."""

    NONE = 0
    REFERENCE_TIMEOUT = 1
    MEASUREMENT_TIMEOUT = 2
    START = 3
    DISABLED = 4


# Plain integers, for the functions of the control loop.
MODE_OK = int(Mode.OK)
HOLDING = int(Mode.HOLDING)
RAMPING = int(Mode.RAMPING)
SAFE = int(Mode.SAFE)
NONE = int(Cause.NONE)
REFERENCE_TIMEOUT = int(Cause.REFERENCE_TIMEOUT)
MEASUREMENT_TIMEOUT = int(Cause.MEASUREMENT_TIMEOUT)
START = int(Cause.START)
DISABLED = int(Cause.DISABLED)
_ENTRY = (MODE_OK, HOLDING, HOLDING, SAFE, RAMPING)


class Watch(NamedTuple):
    """
    State of the policy: mode, cause, ages of the last valid inputs [s], inf where there was none.

    ``fault_age`` [s] counts since the fault began, ``good`` valid samples in a row since its cause
    went away, ``gap`` [s] the time of samples that could not be used. ``lost`` says that something
    was lost in control, also if another cause acts by now.
    """

    mode: int = SAFE
    cause: int = START
    measurement_age: float = inf
    reference_age: float = inf
    fault_age: float = 0.0
    good: int = 0
    gap: float = 0.0
    lost: bool = False


def supervise(
    design: Design,
    watch: Watch,
    enabled: bool,
    measured: bool,
    referenced: bool,
    at_safe: bool,
    dt: float,
    elapsed: float,
    age: float,
) -> Watch:
    """
    Advance the policy by one tick.

    ``measured`` and ``referenced`` say whether a valid sample was used or received, ``at_safe``
    whether the last command was ``safe_command``; ``dt`` is the time this tick's sample spans,
    ``elapsed`` the time since the last tick and ``age`` that since the sample was there [s].
    """
    measurement_age = age if measured else watch.measurement_age + elapsed
    reference_age = 0.0 if referenced else watch.reference_age + elapsed
    cause = NONE
    if not enabled:
        cause = DISABLED
    elif measurement_age == inf:
        cause = START
    elif not measured and 0.0 < design.measurement_timeout < measurement_age:
        cause = MEASUREMENT_TIMEOUT
    elif 0.0 < design.reference_timeout < reference_age < inf:
        cause = REFERENCE_TIMEOUT

    mode = max(watch.mode, _ENTRY[cause])
    fault_age = watch.fault_age + elapsed if watch.mode != MODE_OK else 0.0
    good = 0
    faulty = cause != NONE or watch.cause != NONE  # else the observers restart, and that is all
    if mode == HOLDING and faulty and fault_age > design.hold_time:
        mode = RAMPING
    if mode == RAMPING and watch.mode == RAMPING and at_safe:
        mode = SAFE
    if cause == NONE and watch.mode != MODE_OK:
        if measured:
            good = watch.good + 1
        elif dt <= 0.0:  # no sample came, which is not a bad one
            good = watch.good
        if measured and good >= (design.good_samples if watch.lost else 1):
            mode = MODE_OK
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
        good,
        0.0 if measured else watch.gap + max(dt, 0.0),
        mode != MODE_OK and (watch.lost or cause in (MEASUREMENT_TIMEOUT, REFERENCE_TIMEOUT)),
    )
