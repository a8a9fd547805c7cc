"""Measurements that no plant can have had: a glitch of the sensor, or what it says for 'none'."""

from __future__ import annotations

import attrs
from nadrc_ros.records.recorded_run import Array, RecordedRun
import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

Marks = npt.NDArray[np.bool_]
# So many rows in a row may be wrong.
LONGEST_BURST = 10
# Up to that share of the rows is suspected at first.
SUSPECTED = 0.25
NAMED = 3


def outliers(values: Array) -> Marks:
    """
    Tell which of some values, all known, no value near in time allows for.

    Where the largest step of a signal is M, a value is at most K M from the median of itself and
    K neighbours on either side, however the signal moves. Outliers are those, at most K in a row,
    that are farther from it, M being the largest step of all others: what remains of the suspects
    when M grows by those that are cleared.
    """
    if len(values) <= 2 * LONGEST_BURST:
        return np.zeros(len(values), dtype=bool)
    away = np.abs(values - median_filter(values, 2 * LONGEST_BURST + 1, mode='mirror'))
    usual = LONGEST_BURST * float(np.median(np.abs(np.diff(values))))
    found: Marks = away > max(float(np.quantile(away, 1.0 - SUSPECTED)), usual)
    while found.any():
        largest = float(np.max(np.abs(np.diff(values[~found]))))
        kept = found & (away > LONGEST_BURST * largest)
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
        f'{measured[row]:.6g} at {run.columns["time"][row]:.10g} s' for row in wrong[:NAMED]
    )
    more = f' and {wrong.size - NAMED} more' if wrong.size > NAMED else ''
    measured[wrong] = np.nan
    told = (
        f'the measurement {named}{more} is farther from those before and after than all others '
        'move: left out'
    )
    return attrs.evolve(run, columns=run.columns | {'measurement': measured}), told
