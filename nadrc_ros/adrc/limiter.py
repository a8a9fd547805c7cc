"""The limits of the command: first how fast it may change, then how large it may be."""

from __future__ import annotations

from math import isfinite

from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.status import OK, RATE_LIMITED, SATURATED


def clamp(design: Design, command: float) -> float:
    """Return ``command`` inside its limits, ``safe_command`` if it is not finite."""
    if not isfinite(command):
        return design.safe_command
    if command > design.command_max:
        return design.command_max
    if command < design.command_min:
        return design.command_min
    return command


def limit(design: Design, raw: float, applied: float, dt: float) -> tuple[float, int]:
    """
    Return the command nearest to ``raw`` that the limits allow, and which of them acts.

    Its change since ``applied`` is at most the rate limit times ``dt`` [s]; then the magnitude is
    limited, so that a range which was narrowed is entered at once.
    """
    status = OK
    if design.command_rate_limit > 0.0:
        change = design.command_rate_limit * dt
        if raw > applied + change:
            raw = applied + change
            status = RATE_LIMITED
        elif raw < applied - change:
            raw = applied - change
            status = RATE_LIMITED
    if raw > design.command_max:
        return design.command_max, SATURATED
    if raw < design.command_min:
        return design.command_min, SATURATED
    return raw, status
