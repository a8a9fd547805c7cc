"""What one step of the law says about itself."""

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


# Plain integers for the step functions: an attribute of an Enum costs more than a tick's
# arithmetic.
OK = int(Status.OK)
RATE_LIMITED = int(Status.RATE_LIMITED)
SATURATED = int(Status.SATURATED)
RESTARTED = int(Status.RESTARTED)
NO_MEASUREMENT = int(Status.NO_MEASUREMENT)
BAD_REFERENCE = int(Status.BAD_REFERENCE)
BAD_TIME_STEP = int(Status.BAD_TIME_STEP)
