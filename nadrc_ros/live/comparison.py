"""Two stretches of a run that saw the same reference, and their figures of merit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.live.blocks import Array
from nadrc_ros.records.figures import figures_of
from nadrc_ros.records.history import about_figures, History
from nadrc_ros.records.recording import FigureSettings, RunSettings
import numpy as np

# So far, as a share of its range, the reference of two stretches may be apart (rms).
_APART = 0.01
_FEWEST = 20


def figures(
    signals: Sequence[str],
    rows: Array,
    end: float,
    recorder: Mapping[str, Any],
    controller: Mapping[str, Any],
) -> dict[str, Any]:
    """
    Return the figures of merit of rows up to ``end`` [s], as a report on that part has them.

    The parameters of the recorder say what they are asked to be, those of the controller what it
    says of its limits.
    """
    columns, history = dict(zip(('time', *signals), rows.T.tolist())), History()
    history.take(None, 'controller', about_figures(controller))
    settings = figure_settings(recorder)
    found = figures_of(columns, settings, history, float(rows[0, 0]), end)
    return found.values().as_dict()


def figure_settings(recorder: Mapping[str, Any]) -> RunSettings:
    """Return what the figures of a recorder with these parameters are asked to be."""
    names = declared(FigureSettings)
    told = {name: recorder[name] for name in names if name in recorder}
    try:
        return RunSettings(**told)
    except (UserError, TypeError):
        return RunSettings()


def same_stretch(rows: Array, begin: float, end: float, after: float) -> tuple[float, str]:
    """
    Return when the latest stretch begins that saw the reference from ``begin`` to ``end`` [s].

    ``rows`` have time and reference first; the stretch begins at ``after`` or later. Where there
    is none, that is nan, and why in words.
    """
    none = float('nan')
    time, reference = rows[:, 0], rows[:, 1]
    inside = (time >= begin) & (time <= end)
    if inside.sum() < _FEWEST or not np.isfinite(reference[inside]).all():
        return none, 'the pinned stretch is not kept whole any more, or had no reference'
    h = float(np.median(np.diff(time[inside])))
    pinned = np.interp(np.arange(begin, end, h), time, reference)
    later = time >= after
    if time[-1] - after < end - begin or not np.isfinite(reference[later]).all():
        return none, f'{end - begin:.3g} s of reference are needed with these parameters'
    grid = np.arange(after, time[-1], h)
    away = _distances(np.interp(grid, time, reference), pinned)
    span = max(float(np.ptp(pinned)), 1e-9 * float(np.abs(pinned).max()), 1e-12)
    good = np.flatnonzero(away <= _APART * span)
    if not good.size:
        return none, 'the reference has not been the same since'
    last = good[-1]
    first = last - int(np.argmin(np.diff(good)[::-1] == 1)) if len(good) > 1 else last
    near = good[(good >= first) & (good <= last)]
    best = int(near[::-1][np.argmin(away[near[::-1]])])
    return float(grid[best]), ''


def _distances(whole: Array, part: Array) -> Array:
    """Return the rms distance of ``part`` from the ``whole`` at every place it may have there."""
    count, n = len(whole) - len(part) + 1, len(part)
    if count < 1:
        return np.empty(0)
    middle = part.mean()  # or the squares would be large, and their difference nothing
    whole, part = whole - middle, part - middle
    size = len(whole) + n
    product = np.fft.irfft(np.fft.rfft(whole, size) * np.conj(np.fft.rfft(part, size)), size)[
        :count
    ]
    sums = np.concatenate([[0.0], np.cumsum(whole**2)])
    squares = sums[n:] - sums[:-n] - 2.0 * product + (part**2).sum()
    return np.asarray(np.sqrt(np.maximum(squares, 0.0) / n))
