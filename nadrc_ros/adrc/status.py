"""What the controller says about itself: of each step, of the command, and why."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Outcome of one step; from ``NO_MEASUREMENT`` on the observers were left untouched."""

    OK = 0
    RATE_LIMITED = 1
    SATURATED = 2
    RESTARTED = 3
    NO_MEASUREMENT = 4
    BAD_REFERENCE = 5
    BAD_TIME_STEP = 6


class Mode(IntEnum):
    """What the command is: the law's, held, on its way to safe, safe. Ordered by severity."""

    OK = 0
    HOLDING = 1
    RAMPING = 2
    SAFE = 3


class Cause(IntEnum):
    """
    Why the law may not act, ranked.

    ``START`` is before ``good_samples`` measurements; ``NOT_FOLLOWED`` is of the outer loop of a
    cascade while the inner one is not in control.
    """

    NONE = 0
    NOT_FOLLOWED = 1
    REFERENCE_TIMEOUT = 2
    STALLED = 3
    MEASUREMENT_TIMEOUT = 4
    START = 5
    DISABLED = 6


# Plain integers for the functions of the loop: a member of an Enum costs more than a tick's
# arithmetic.
OK, RATE_LIMITED, SATURATED, RESTARTED, NO_MEASUREMENT, BAD_REFERENCE, BAD_TIME_STEP = map(
    int, Status
)
MODE_OK, HOLDING, RAMPING, SAFE = map(int, Mode)
NONE, NOT_FOLLOWED, REFERENCE_TIMEOUT, STALLED, MEASUREMENT_TIMEOUT, START, DISABLED = map(
    int, Cause
)
