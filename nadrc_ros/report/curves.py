"""What the plots of a report show, as numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter

import attrs
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.recorded_run import Array, RecordedRun
import numpy as np
import numpy.typing as npt

# A start larger than so many times what comes later is cut off; it is that share of the time.
_CUT_OFF_RATIO, _START_SHARE = 2.5, 0.1
# Of a spectrum.
_SHORTEST_SEGMENT = 64
_SEGMENTS = 8
# A histogram ends at so many times its 99 %, or one straggler would hide its shape.
_WIDEST_RATIO = 3.0
_BINS = 60


def kept(values: Array, points: int) -> npt.NDArray[np.int64]:
    """
    Return the indices, in order, of at most ``points`` values that look like all of them.

    Of each stretch of equal length the lowest and the highest value stay, with their own times,
    and one that is not a number if there is any, so that a gap stays a gap; first and last stay.
    A line that is short enough stays whole.
    """
    size = len(values)
    if size <= points:
        return np.arange(size)
    stretches = max(1, (points - 2) // 3)
    length = -(-size // stretches)
    padded = np.full(stretches * length, np.nan)
    padded[:size] = values
    rows = padded.reshape(stretches, length)
    missing = np.isnan(rows)
    low = np.where(missing, np.inf, rows).argmin(axis=1)
    high = np.where(missing, -np.inf, rows).argmax(axis=1)
    starts = np.arange(stretches) * length
    chosen = np.concatenate(([0, size - 1], *(starts + k for k in (low, high, missing.argmax(1)))))
    return np.unique(chosen[chosen < size])


def frame(lines: Sequence[tuple[Array, Array]]) -> tuple[float, float] | None:
    """Return the range that cuts off a start that would make all the rest look flat."""
    whole = _finite(values for _, values in lines)
    begin = _START_SHARE * max(float(time[-1]) for time, _ in lines)
    late = _finite(values[time >= begin] for time, values in lines)
    if not late.size or np.abs(whole).max() <= _CUT_OFF_RATIO * np.abs(late).max():
        return None
    room = 0.15 * float(np.ptp(late))
    return (float(late.min()) - room, float(late.max()) + room) if room > 0.0 else None


def _finite(columns: Iterable[Array]) -> Array:
    return np.concatenate([values[np.isfinite(values)] for values in columns])


def command_spectrum(time: Array, command: Array, rate: float) -> tuple[Array, Array] | None:
    """
    Return frequencies [Hz] and the one-sided density [unit of u squared per Hz], by Welch.

    Hann windows that overlap by half, the mean of each taken off. What was not recorded is taken
    to be held, as the command was. None for a run too short to say anything.
    """
    from scipy.signal import welch

    held = _on_grid(time, command, rate)
    if held.size < _SHORTEST_SEGMENT:
        return None
    length = max(_SHORTEST_SEGMENT, 2 * held.size // (_SEGMENTS + 1))
    frequency, density = welch(held, rate, nperseg=length)
    return frequency[1:], density[1:]


def _on_grid(time: Array, command: Array, rate: float) -> Array:
    known = np.isfinite(command)
    if not known.any():
        return np.empty(0)
    periods = np.rint((time[known] - time[known][0]) * rate).astype(np.int64)
    newest = np.searchsorted(periods, np.arange(periods[-1] + 1), 'right') - 1
    return np.asarray(command[known][newest])


def bins(columns: Iterable[Array]) -> Array:
    """Return the edges of a histogram of all of these values, but for stragglers."""
    columns = list(columns)
    low = min(float(values.min()) for values in columns)
    last = max(float(values.max()) for values in columns)
    high = min(last, _WIDEST_RATIO * max(float(np.quantile(v, 0.99)) for v in columns))
    if high > low:
        return np.linspace(min(low, high), high, _BINS + 1)
    return np.array([low, low + 1])


@attrs.frozen
class Bandwidth:
    """A bandwidth [rad/s], since when [s], what has it, and in which runs: two ordered sets."""

    value: float
    since: float
    names: dict[str, None] = attrs.field(factory=dict)
    runs: dict[str, None] = attrs.field(factory=dict)


def bandwidths(runs: Mapping[str, RecordedRun]) -> list[Bandwidth]:
    """Return the bandwidths of the controllers, at the start and after changes."""
    found: dict[float, Bandwidth] = {}
    steps = [
        (since, name, settings)
        for name, run in runs.items()
        for since, settings in run.history.controller_settings()
    ]
    for since, name, settings in sorted(steps, key=itemgetter(0)):
        for which, value in _bandwidths(settings).items():
            known = found.setdefault(value, Bandwidth(value, since))
            known.names[which] = None
            known.runs[name] = None
    return list(found.values())


def _bandwidths(settings: ControllerSettings) -> dict[str, float]:
    levels = make_design(settings).bandwidths
    return {
        'controller': settings.controller_bandwidth,
        **{f'level {k}': bandwidth for k, bandwidth in enumerate(levels, 1)},
    }
