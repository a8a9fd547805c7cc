"""What is made of a log before a plant is sought: wrong rows, turning angles, fewer rows."""

from __future__ import annotations

from math import ceil, pi

import attrs
from nadrc_ros.records.recorded_run import Array, RecordedRun
import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

Marks = npt.NDArray[np.bool_]
# So many rows in a row may be wrong.
_LONGEST_BURST = 10
# Up to that share of the rows is suspected at first.
_SUSPECTED_SHARE = 0.25
_MOST_NAMED = 3
# What a reading that starts again counts to: rad, degrees, turns, encoders.
PERIODS = {2.0 * pi: '6.283185307179586', 360.0: '360', 1.0: '1'} | {
    float(2**bits): str(2**bits) for bits in range(8, 25)
}
# A wrap fills its period, jumps over nearly all of it, otherwise moves by little of it, and stays
# on either side of the middle for some of the time, which a spike does not.
_FILLED_SHARE, _JUMP_SHARE, _STEP_SHARE, _STAYING_SHARE = 0.9, 0.8, 0.1, 0.01
_FEWEST_VALUES = 20
# Between two rows that are kept the output may miss their straight line by that share of its span
# and that of its noise: with five times more, b0 of a plant of order 2 was off by half a percent.
_BEND, _BEND_IN_NOISE = 2e-4, 0.2


def wrap_of(values: Array) -> float | None:
    """Return the period of a reading that starts again where it was full, None for any other."""
    known = values[np.isfinite(values)]
    steps = np.abs(np.diff(known))
    span = float(np.ptp(known)) if known.size else 0.0
    if span == 0.0 or len(np.unique(known)) < _FEWEST_VALUES:
        return None
    jumps = steps > _JUMP_SHARE * span
    above = float(np.mean(known > known.min() + 0.5 * span))
    if (
        not (jumps.any() and _STAYING_SHARE < above < 1.0 - _STAYING_SHARE)
        or steps[~jumps].max() > _STEP_SHARE * span
    ):
        return None
    return next((each for each in PERIODS if _FILLED_SHARE * each <= span <= 1.001 * each), None)


def thinned(run: RecordedRun, most: int, every: int | None = None) -> tuple[RecordedRun, int]:
    """
    Return a run of every q-th row, and q: if ``every`` does not say it, ``most`` rows do.

    These are more where the motion needs them.

    The measurement is that of every q-th row, the command the mean of those until the next: a held
    command moves a plant of order 1 as its mean does, and others nearly so as long as the output
    between two rows is nearly a straight line, see ``_BEND``.
    """
    place = np.rint((run.columns['time'] - run.columns['time'][0]) * run.rate).astype(np.int64)
    if every is None:
        every = ceil((place[-1] + 1) / most)
        motion = np.full(place[-1] + 1, np.nan)
        motion[place] = run.columns['measurement']
        while every > 1 and _bends(motion, every):
            every = every * 3 // 4
    if every == 1:
        return run, 1
    kept = np.flatnonzero(place % every == 0)
    group = place // every
    count = np.bincount(group)
    command = np.bincount(group, run.columns['command']) / np.maximum(count, 1)
    columns = {name: column[kept] for name, column in run.columns.items()}
    columns['command'] = command[group[kept]]
    return attrs.evolve(run, rate=run.rate / every, columns=columns), every


def _bends(motion: Array, every: int) -> bool:
    """Tell whether it leaves the straight lines between every so many of its values, (N,)."""
    kept = motion[::every]
    bend = 0.5 * (kept[:-2] + kept[2:]) - kept[1:-1]
    steps = np.diff(motion, 2)
    bend, steps = bend[np.isfinite(bend)], steps[np.isfinite(steps)]
    if not (bend.size and steps.size):
        return True
    noise = float(np.mean(steps**2)) / 6.0
    span = float(np.nanmax(motion) - np.nanmin(motion))
    allowed = (_BEND * span) ** 2 + _BEND_IN_NOISE**2 * noise
    return float(np.mean(bend**2)) - 1.5 * noise > allowed


def outliers(values: Array) -> Marks:
    """
    Tell which of some values, all known, no value near in time allows for.

    Where the largest step of a signal is M, a value is at most K M from the median of itself and
    K neighbours on either side, however the signal moves. Outliers are those, at most K in a row,
    that are farther from it, M being the largest step of all others: what remains of the suspects
    when M grows by those that are cleared.
    """
    if len(values) <= 2 * _LONGEST_BURST:
        return np.zeros(len(values), dtype=bool)
    away = np.abs(values - median_filter(values, 2 * _LONGEST_BURST + 1, mode='mirror'))
    usual = _LONGEST_BURST * float(np.median(np.abs(np.diff(values))))
    found: Marks = away > max(float(np.quantile(away, 1.0 - _SUSPECTED_SHARE)), usual)
    while found.any():
        largest = float(np.max(np.abs(np.diff(values[~found]))))
        kept = found & (away > _LONGEST_BURST * largest)
        if (kept == found).all():
            break
        found = kept
    return found


def without_outliers(run: RecordedRun) -> tuple[RecordedRun, str]:
    """Return the run with outliers of the measurement as unknown, and which they are, in words."""
    measured = run.columns['measurement'].copy()
    known = np.flatnonzero(np.isfinite(measured))
    wrong = known[outliers(measured[known])]
    if not wrong.size:
        return run, ''
    named = ', '.join(
        f'{measured[row]:.6g} at {run.columns["time"][row]:.10g} s' for row in wrong[:_MOST_NAMED]
    )
    more = f' and {wrong.size - _MOST_NAMED} more' if wrong.size > _MOST_NAMED else ''
    measured[wrong] = np.nan
    told = (
        f'the measurement {named}{more} is farther from those before and after than all others '
        'move: left out'
    )
    return attrs.evolve(run, columns=run.columns | {'measurement': measured}), told
