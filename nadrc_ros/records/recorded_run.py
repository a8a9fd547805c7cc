"""One recorded run as rows of one time: a folder of the recorder, a rosbag2 bag or a CSV file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.records.bags import is_bag, read_bag
from nadrc_ros.records.csv_log import read_csv_log
from nadrc_ros.records.recording import (
    NEEDED,
    read_samples,
    read_settings,
    read_summary,
    RecordingError,
    SAMPLES,
    stop_of,
)
from nadrc_ros.records.source import Source
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
OWN = Source()


@attrs.frozen(kw_only=True, eq=False)
class RecordedRun:
    """
    What was recorded of one loop.

    Attributes
    ----------
    path
        Where it was read from.
    rate
        Measurements per second [Hz]: the nominal rate, for a bag the one of its receipt times.
    columns
        Arrays (N,) by the names of ``samples.csv``, nan where a value is missing: ``time`` [s],
        ``reference``, ``measurement``, ``command`` always, others if they were recorded. A
        measurement that was lost leaves a gap in ``time`` and has no row.
    stop
        Until when the log goes on [s], with rows or without.
    summary
        The recorder's summary, empty if there is none.
    told
        How a file was understood that does not say so itself, '' for others.

    """

    path: Path
    rate: float
    stop: float
    columns: dict[str, Array]
    summary: dict[str, Any]
    told: str = ''


def read_run(path: Path, source: Source = OWN) -> RecordedRun:
    """
    Read a run from a folder with ``samples.csv``, a bag's folder or file, or a CSV file.

    Parameters
    ----------
    path
        Where it is.
    source
        Where its signals are, if it is not a folder of the recorder.

    Raises
    ------
    RecordingError
        When that is no run or it has no samples, in one sentence without the path.
    OSError
        For a file that cannot be read.

    """
    summary, told = {}, ''
    if (path / SAMPLES).is_file():
        if source != OWN:
            raise RecordingError(
                f'{SAMPLES} has columns of known names; topics and columns are those of other logs'
            )
        columns, summary = _columns(path), read_summary(path)
        stop = stop_of(summary) or 0.0
        rate = read_settings(path).rate or _rate(_measured(columns))
    elif path.exists() and is_bag(path):
        columns, stop = read_bag(path, source)
        rate = _rate(_measured(columns))
    elif path.is_file():
        columns, stop, told = read_csv_log(path, source)
        rate = _rate(_measured(columns))
    elif path.exists():
        raise RecordingError(
            f'neither a folder with {SAMPLES} nor a rosbag2 bag (.db3, .mcap) nor a CSV file'
        )
    else:
        raise RecordingError('there is no such file or folder')
    columns.setdefault('reference', np.full(len(columns['time']), np.nan))
    return RecordedRun(
        path=path,
        rate=rate,
        stop=max(stop, float(columns['time'][-1])),
        columns=columns,
        summary=summary,
        told=told,
    )


def _columns(folder: Path) -> dict[str, Array]:
    columns = {name: np.array(values) for name, values in read_samples(folder).items()}
    for name in ('time', *NEEDED):
        if name not in columns:
            raise RecordingError(f'{SAMPLES}: no column {name}')
    if not columns['time'].size:
        raise RecordingError(f'{SAMPLES}: no samples')
    if not (np.isfinite(columns['time']).all() and (np.diff(columns['time']) > 0.0).all()):
        raise RecordingError(f'{SAMPLES}: the times do not increase')
    return columns


def _measured(columns: Mapping[str, Array]) -> Array:
    """Return the times of rows with a measurement, of all where there are hardly any."""
    measured = columns['time'][np.isfinite(columns['measurement'])]
    return measured if measured.size > 1 else columns['time']


def _rate(time: Array) -> float:
    """Return the rate [Hz] of times with jitter and gaps: periods counted over the time taken."""
    steps = np.diff(time)
    if not steps.size or np.median(steps) <= 0.0:
        raise RecordingError('too few measurements to tell their rate')
    return float(np.rint(steps / np.median(steps)).sum() / steps.sum())
