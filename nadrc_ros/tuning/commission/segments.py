"""What of an experiment is fitted: the parts of its log in which the machine was driven."""

from __future__ import annotations

from nadrc_ros.tuning.commission.fit import Segment
from nadrc_ros.tuning.commission.machine import Array, Samples
import numpy as np

# Periods of commands before a segment, and samples that tell its initial state.
_BEFORE, _STATE = 32, 8


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
    measurement = samples.measurement - level
    commands = np.where(np.isfinite(samples.command), samples.command, center) - center
    for first, end in parts:
        if end - first < 3:
            continue
        y, v, still = state_at(measurement, first, h, noise)
        before = np.concatenate((np.zeros(_BEFORE), commands[:first]))[-_BEFORE:]
        segment = Segment(
            # the row of a tick has what was measured before its command acted
            measurement=measurement[first + 1 : end],
            commands=[*before.tolist(), *commands[first : end - 1].tolist()],
            before=_BEFORE,
            y=y,
            v=0.0 if still else v,
            resting=still,
        )
        found.append(segment)
    return found


def state_at(measurement: Array, row: int, h: float, noise: float) -> tuple[float, float, bool]:
    """Return output and speed in a row, by the line through those until then; and if it stands."""
    from_row = max(row + 1 - _STATE, 0)
    time = np.arange(from_row - row, 1) * h
    values = measurement[from_row : row + 1]
    known = np.isfinite(values)
    if known.sum() < 3:
        return float(np.nanmean(values)) if known.any() else 0.0, 0.0, True
    slope, level = np.polyfit(time[known], values[known], 1)
    error = noise / h * (12.0 / known.sum() ** 3) ** 0.5
    if abs(slope) <= 3.0 * error:
        return float(np.mean(values[known])), 0.0, True
    return float(level), float(slope), False
