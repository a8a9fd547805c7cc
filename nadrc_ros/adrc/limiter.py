"""The limits of the command: first how fast it may change, then how large it may be."""

from __future__ import annotations

from math import isfinite, nan

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


def limit(
    design: Design, raw: float, sent: float, dt: float, downstream: float = nan
) -> tuple[float, int]:
    """
    Return the command nearest to ``raw`` that the limits allow, and which of them acts.

    Its change since the last one, ``sent``, is at most the rate limit times ``dt`` [s]; then the
    magnitude is limited, so that a range which was narrowed is entered at once. Where another
    command acts ``downstream``, the change may as well count from there or from anywhere between
    the two: a command that went on behind another limit comes back from that limit at once.
    """
    status = OK
    if design.command_rate_limit > 0.0:
        change = design.command_rate_limit * dt
        if raw > sent + change:
            highest = (downstream if downstream > sent else sent) + change
            if raw > highest:
                raw = highest
                status = RATE_LIMITED
        elif raw < sent - change:
            lowest = (downstream if downstream < sent else sent) - change
            if raw < lowest:
                raw = lowest
                status = RATE_LIMITED
    if raw > design.command_max:
        return design.command_max, SATURATED
    if raw < design.command_min:
        return design.command_min, SATURATED
    return raw, status


def present(sent: float, downstream: float) -> float:
    """Return the command that acts now, as far as it is known: where another may, that one."""
    return downstream if downstream == downstream else sent
