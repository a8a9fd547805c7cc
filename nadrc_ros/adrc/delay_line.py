"""
Commands on their way to a plant with dead time: those of the last D seconds, each with its length.

What enters over some seconds pushes out as many seconds of what entered D before, whatever the
lengths are: so the mean of u over (t - D - dt, t - D] is exact for a fractional delay, for
measured time steps, for missed ticks and gaps.

A line is one vector, (count, u_1, length_1 [s], u_2, length_2, ...), oldest first. What was sent
before a line began is taken to be the first that enters. A piece grows until it is a share of D,
so that ticks of any rate fit in; that moves a command in time, by less than the share.
"""

from __future__ import annotations

from nadrc_ros.adrc.design import Vector
from nadrc_ros.adrc.rate_checks import LONGEST_DELAY
from nadrc_ros.adrc.settings import LONGEST

# So many periods of delay are exact. One piece more leaves in part, one more begins.
_PIECES = LONGEST_DELAY
_SLOTS = _PIECES + 2


def blank_line(delay: float) -> Vector:
    """Return an empty line; one without any room where there is no ``delay``."""
    return [0.0] * (1 + 2 * _SLOTS) if delay > 0.0 else []


def acting(line: Vector, applied: float) -> float:
    """Return the command that acts on the plant now: the oldest one, or ``applied`` of no line."""
    if len(line) == 0 or line[0] == 0.0:
        return applied
    return line[1]


def copy_line(line: Vector, out: Vector) -> None:
    """Copy a line, which may be one without room."""
    i = 2 * int(line[0]) if len(line) > 0 else -1
    while i >= 0:
        out[i] = line[i]
        i -= 1


def merge_short(delay: float, line: Vector) -> None:
    """
    Merge what is shorter than its share of a ``delay`` that became longer, mean-preserving.

    Else the line would be full of the pieces of the delay before. What acts now stays.
    """
    end = 1 + 2 * int(line[0])
    i = 5
    j = min(i, end)
    while i < end:
        if line[j - 1] < delay / _PIECES:
            total = line[j - 1] + line[i + 1]
            line[j - 2] += (line[i] - line[j - 2]) * (line[i + 1] / total)
            line[j - 1] = total
        else:
            line[j] = line[i]
            line[j + 1] = line[i + 1]
            j += 2
        i += 2
    line[0] = 0.5 * (j - 1)


def pass_through(delay: float, line: Vector, command: float, length: float, out: Vector) -> float:
    """
    Let ``command`` enter for ``length`` [s]; return the mean of what leaves meanwhile.

    Where nothing leaves, that is the command that acts now. ``out`` may be ``line``. A length that
    is no time counts as 0: after a reset nobody knows how long the last command acted.
    """
    if not 0.0 < length < LONGEST:
        length = 0.0
    end = 1 + 2 * int(line[0])
    leaving = length - delay
    i = 2
    while i < end:
        leaving += line[i]
        i += 2
    mean = line[1] if end > 1 else command
    gone = 0.0
    i = 1
    while i < end and line[i + 1] <= leaving:
        part = line[i + 1]
        gone += part
        mean += (line[i] - mean) * (part / gone)
        leaving -= part
        i += 2
    entering = length
    if leaving > 0.0:
        gone += leaving
        if i < end:
            mean += (line[i] - mean) * (leaving / gone)
        else:
            mean += (command - mean) * (leaving / gone)
            entering -= leaving
    j = 1
    while i < end:
        out[j] = line[i]
        out[j + 1] = line[i + 1]
        if j == 1 and leaving > 0.0:
            out[2] -= leaving
        i += 2
        j += 2
    if entering > 0.0:
        if j > 3 and (out[j - 1] < delay / _PIECES or j > 2 * _SLOTS):
            total = out[j - 1] + entering
            out[j - 2] += (command - out[j - 2]) * (entering / total)
            out[j - 1] = total
        else:
            out[j] = command
            out[j + 1] = entering
            j += 2
    out[0] = 0.5 * (j - 1)
    return mean
