"""One recorded run on a common time grid: a folder of the recorder, or a rosbag2 bag."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.records.bags import is_bag, read_bag
from nadrc_ros.records.recording import (
    NEEDED,
    read_samples,
    read_settings,
    read_summary,
    RecordingError,
    SAMPLES,
)
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


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
    summary
        The recorder's summary, empty if there is none.

    """

    path: Path
    rate: float
    columns: dict[str, Array]
    summary: dict[str, Any]


def read_run(
    path: Path, topics: Mapping[str, str] | None = None, namespace: str = ''
) -> RecordedRun:
    """
    Read a run from a folder with ``samples.csv``, a bag's folder, or a .db3 or .mcap file.

    Parameters
    ----------
    path
        Where it is.
    topics, namespace
        For a bag: the topic of a signal by its column, and the namespace of the loop; see
        :func:`nadrc_ros.records.bags.read_bag`.

    Raises
    ------
    RecordingError
        When that is no run or it has no samples, in one sentence without the path.
    OSError
        For a file that cannot be read.

    """
    if (path / SAMPLES).is_file():
        if topics or namespace:
            raise RecordingError(f'{SAMPLES} has columns; topics and namespaces are those of bags')
        rate, columns, summary = read_settings(path).rate, _columns(path), read_summary(path)
    elif path.exists() and is_bag(path):
        columns = read_bag(path, topics, namespace)
        rate, summary = _rate(columns['time']), {}
    elif path.exists():
        raise RecordingError(f'neither a folder with {SAMPLES} nor a rosbag2 bag (.db3, .mcap)')
    else:
        raise RecordingError('there is no such file or folder')
    columns.setdefault('reference', np.full(len(columns['time']), np.nan))
    return RecordedRun(path=path, rate=rate, columns=columns, summary=summary)


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


def _rate(time: Array) -> float:
    """Return the rate [Hz] of times with jitter and gaps: periods counted over the time taken."""
    steps = np.diff(time)
    if not steps.size or np.median(steps) <= 0.0:
        raise RecordingError('too few measurements to tell their rate')
    periods = np.maximum(np.rint(steps / np.median(steps)), 1.0)
    return float(periods.sum() / steps.sum())
