"""What is made of a recorded run before it is used: a part of it, a turning angle, fewer rows."""

from __future__ import annotations

from math import ceil, pi

import attrs
from nadrc_ros.records.recorded_run import Array, RecordedRun
from nadrc_ros.records.recording import RecordingError
import numpy as np

# What a reading that starts again counts to: rad, degrees, turns, encoders.
PERIODS = {2.0 * pi: '6.283185307179586', 360.0: '360', 1.0: '1'} | {
    float(2**bits): str(2**bits) for bits in range(8, 25)
}
# A wrap fills its period, jumps over nearly all of it, otherwise moves by little of it, and stays
# on either side of the middle for some of the time, which a spike does not.
FILLED, JUMP, STEP, STAYS = 0.9, 0.8, 0.1, 0.01
FEWEST_VALUES = 20
ANGLES = ('reference', 'output', 'tracking', 'output_estimate')
# Between two rows that are kept the output may miss their straight line by that share of its span
# and that of its noise: with five times more, b0 of a plant of order 2 was off by half a percent.
BEND, BEND_IN_NOISE = 2e-4, 0.2


def window(run: RecordedRun, begin: float | None, end: float | None) -> RecordedRun:
    """
    Return the rows from ``begin`` to ``end`` [s], with their times.

    Raises
    ------
    RecordingError
        When there are none.

    """
    time = run.columns['time']
    low, high = time[0] if begin is None else begin, run.stop if end is None else end
    inside = (time >= low) & (time <= high)
    if not inside.any():
        raise RecordingError(
            f'no row from {low:g} to {high:g} s: the run has {time[0]:g} to {time[-1]:g} s'
        )
    columns = {name: column[inside] for name, column in run.columns.items()}
    return attrs.evolve(run, stop=min(run.stop, high), columns=columns)


def wrap_of(values: Array) -> float | None:
    """Return the period of a reading that starts again where it was full, None for any other."""
    known = values[np.isfinite(values)]
    steps = np.abs(np.diff(known))
    span = float(np.ptp(known)) if known.size else 0.0
    if span == 0.0 or len(np.unique(known)) < FEWEST_VALUES:
        return None
    jumps = steps > JUMP * span
    above = float(np.mean(known > known.min() + 0.5 * span))
    if not (jumps.any() and STAYS < above < 1.0 - STAYS) or steps[~jumps].max() > STEP * span:
        return None
    return next((each for each in PERIODS if FILLED * each <= span <= 1.001 * each), None)


def unwrapped(run: RecordedRun, period: float) -> RecordedRun:
    """Return the run with an angle that goes on where it wrapped, and a reference beside it."""
    columns = dict(run.columns)
    y = columns['measurement']
    known = np.isfinite(y)
    turned = y.copy()
    turned[known] = np.unwrap(y[known], period=period)
    columns['measurement'] = turned
    for name in (name for name in ANGLES if name in columns):
        columns[name] = columns[name] + period * np.rint((turned - columns[name]) / period)
    return attrs.evolve(run, columns=columns)


def thinned(run: RecordedRun, most: int, every: int | None = None) -> tuple[RecordedRun, int]:
    """
    Return a run of every q-th row, and q: if ``every`` does not say it, ``most`` rows do.

    These are more where the motion needs them.

    The measurement is that of every q-th row, the command the mean of those until the next: a held
    command moves a plant of order 1 as its mean does, and others nearly so as long as the output
    between two rows is nearly a straight line, see ``BEND``.
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
    allowed = (BEND * span) ** 2 + BEND_IN_NOISE**2 * noise
    return float(np.mean(bend**2)) - 1.5 * noise > allowed
