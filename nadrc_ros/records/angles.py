"""Angles in records: errors the short way round, and columns that go on where a sensor wraps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
_OTHER_ANGLES = ('measurement', 'reference', 'tracking', 'output_estimate')


def short_way(difference: Array, period: float) -> Array:
    """Return differences within half a ``period``, as they are for a period of 0."""
    if not period > 0.0:
        return difference
    return np.asarray(difference - period * np.rint(difference / period))


def unwrapped(columns: Mapping[str, Array], period: float) -> dict[str, Array]:
    """
    Return columns in which the output turns on, and all other angles go beside it.

    The output is the measurement where no true one is known; where neither is, it lies on a line.
    """
    output = columns['measurement']
    if 'output' in columns:
        output = np.where(np.isnan(columns['output']), output, columns['output'])
    known = np.flatnonzero(np.isfinite(output))
    if not period > 0.0 or not known.size:
        return dict(columns)
    turned = np.unwrap(output[known], period=period)
    beside = np.interp(np.arange(len(output)), known, turned)
    found = dict(columns)
    for name in columns.keys() & {'output', *_OTHER_ANGLES}:
        found[name] = beside + short_way(columns[name] - beside, period)
    return found
