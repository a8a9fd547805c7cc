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

# So far, as a share of its range, the reference of two stretches may be apart (rms), but for the
# samples by which nodes that are not in step may be late.
_APART, _LATE = 0.01, 2
# Where it is not known for longer [s], nothing is compared.
_HOLE = 0.25
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
    time, reference = rows[np.isfinite(rows[:, 1]), :2].T
    inside = (time >= begin) & (time <= end)
    h = float(np.median(np.diff(time[inside]))) if inside.sum() >= _FEWEST else none
    pinned = _sampled(np.arange(begin, end, h), time, reference) if h > 0.0 else np.empty(0)
    if not (pinned.size and np.isfinite(pinned).all()):
        return none, 'the pinned stretch is not kept whole any more, or had no reference'
    if time[-1] - after < end - begin:
        return none, f'{end - begin:.3g} s with these parameters are needed to compare'
    grid = np.arange(after, time[-1], h)
    whole = _sampled(grid, time, reference)
    away = _distances(whole, pinned)
    span = max(float(np.ptp(pinned)), 1e-9 * float(np.abs(pinned).max()), 1e-12)
    step = float(np.sqrt(np.mean(np.diff(pinned) ** 2)))
    good = np.flatnonzero(away <= _APART * span + step)
    for near in reversed(np.split(good, np.flatnonzero(np.diff(good) > 1) + 1)):
        if not near.size:
            break
        best = int(near[::-1][np.argmin(away[near[::-1]])])
        if _apart(whole[best : best + len(pinned)], pinned) <= _APART * span:
            return float(grid[best]), ''
    return none, 'the reference has not been the same since'


def _sampled(at: Array, time: Array, values: Array) -> Array:
    """Return the values at other times, nan where a hole is too wide to be bridged."""
    place = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    known = (time[place] - time[place - 1] <= _HOLE) & (at >= time[0] - _HOLE)
    return np.where(known, np.interp(at, time, values), np.nan)


def _apart(part: Array, pinned: Array) -> float:
    """Return the rms distance of two stretches; each sample may be early or late."""
    padded = np.pad(pinned, _LATE, mode='edge')
    near = [padded[k : k + len(part)] for k in range(2 * _LATE + 1)]
    away = part - np.clip(part, np.min(near, axis=0), np.max(near, axis=0))
    return float(np.sqrt(np.mean(away**2)))


def _distances(whole: Array, part: Array) -> Array:
    """
    Return the rms distance of ``part`` from the ``whole`` at every place it may have there.

    It is infinite where the whole is not known.
    """
    count, n = len(whole) - len(part) + 1, len(part)
    if count < 1:
        return np.empty(0)
    middle = part.mean()  # or the squares would be large, and their difference nothing
    unknown = ~np.isfinite(whole)
    whole, part = np.where(unknown, 0.0, whole - middle), part - middle
    size = len(whole) + n
    product = np.fft.irfft(np.fft.rfft(whole, size) * np.conj(np.fft.rfft(part, size)), size)[
        :count
    ]
    sums = np.concatenate([[0.0], np.cumsum(whole**2)])
    squares = sums[n:] - sums[:-n] - 2.0 * product + (part**2).sum()
    holes = np.concatenate([[0], np.cumsum(unknown)])
    away = np.sqrt(np.maximum(squares, 0.0) / n)
    return np.where(holes[n:] > holes[:-n], np.inf, away)
