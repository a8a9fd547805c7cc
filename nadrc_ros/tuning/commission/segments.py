"""What of an experiment is fitted: the parts of its log in which the machine was driven."""

from __future__ import annotations

from math import inf

from nadrc_ros.tuning.commission.fit import Segment
from nadrc_ros.tuning.commission.machine import Array, Samples
import numpy as np

# Samples that tell the initial state of a segment.
_STATE = 8


def pulses(samples: Samples) -> list[tuple[int, int]]:
    """Return where each pulse of a staircase begins and where the next one does, in rows."""
    starts = np.flatnonzero((samples.stage[1:] == 'pulse') & (samples.stage[:-1] != 'pulse')) + 1
    ends = np.append(starts[1:], len(samples.stage))
    return list(zip(starts.tolist(), ends.tolist()))


def doublets(samples: Samples) -> list[tuple[int, int]]:
    """Return where each doublet begins after a rest, and where the next one does, in rows."""
    driven = (samples.stage == 'doublet') & (samples.excitation != 0.0)
    starts = np.flatnonzero(driven[1:] & ~driven[:-1]) + 1
    ends = np.append(starts[1:], len(driven))
    return list(zip(starts.tolist(), ends.tolist()))


def segments(
    samples: Samples,
    parts: list[tuple[int, int]],
    h: float,
    center: float,
    noise: float,
    level: float,
) -> list[Segment]:
    """Return those parts for a fit, relative to the output ``level`` at rest."""
    found = []
    measurement, measured = samples.measurement - level, taken(samples)
    known = np.isfinite(measurement)
    commands = np.where(np.isfinite(samples.command), samples.command, center) - center
    sent = np.concatenate(([0.0], np.cumsum(commands[:-1] * np.diff(samples.time))))
    for first, end in parts:
        begin = samples.time[first]
        rows = np.flatnonzero(known & (measured > begin) & (np.arange(len(measured)) < end))
        if len(rows) < 3:
            continue
        before = np.flatnonzero(known & (measured <= begin))[-_STATE:]
        y, v, still = state_at(measurement[before], measured[before] - begin, h, noise)
        segment = Segment(
            time=measured[rows] - begin,
            measurement=measurement[rows],
            edges=samples.time[:end] - begin,
            sent=sent[:end],
            size=float(np.max(np.abs(commands[first:end]))),
            y=y,
            v=0.0 if still else v,
            resting=still,
        )
        found.append(segment)
    return found


def taken(samples: Samples) -> Array:
    """
    Return when the samples were taken by the clock of the ticks: (N,), as late as can be.

    Those that were the shortest on their way count as taken in their tick: what is left is a part
    of the dead time that a controller has to do with.
    """
    age = samples.time - samples.stamp
    known = np.isfinite(samples.measurement)
    if not np.isfinite(age[known]).all():
        return samples.time
    taken: Array = samples.stamp + np.min(age[known], initial=inf)
    return taken


def state_at(values: Array, time: Array, h: float, noise: float) -> tuple[float, float, bool]:
    """Return output and speed at time 0, by the line through those until then; if it stands."""
    if len(values) < 3:
        return float(np.mean(values)) if len(values) else 0.0, 0.0, True
    slope, level = np.polyfit(time, values, 1)
    error = noise / h * (12.0 / len(values) ** 3) ** 0.5
    if abs(slope) <= 3.0 * error:
        return float(np.mean(values)), 0.0, True
    return float(level), float(slope), False
