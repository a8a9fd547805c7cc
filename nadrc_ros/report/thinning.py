"""Fewer points of a long line, with every peak left where it was."""

from __future__ import annotations

from nadrc_ros.report.columns import Array
import numpy as np
import numpy.typing as npt


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
