"""Reads runs: folders of the recorder, rosbag2 bags, CSV files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.records.bags import is_bag, read_bag
from nadrc_ros.records.csv_log import read_csv_log
from nadrc_ros.records.history import read_history
from nadrc_ros.records.recorded_run import Array, RecordedRun, window
from nadrc_ros.records.recording import (
    read_columns,
    read_settings,
    read_summary,
    RecordingError,
    SAMPLES,
    stop_of,
)
from nadrc_ros.records.source import Source
import numpy as np

_OWN_NAMES = Source()


def read_runs(
    paths: Sequence[Path],
    source: Source = _OWN_NAMES,
    begin: float | None = None,
    end: float | None = None,
) -> dict[str, RecordedRun]:
    """
    Read runs, and name them by what tells them apart.

    ``source`` is for bags and CSV files, and of several runs for these alone.

    Of each counts what is from ``begin`` to ``end`` [s]; the figures of merit count the time from
    there.

    Raises
    ------
    UserError
        For what is not a run; the message begins with its path.
    OSError
        For a file that cannot be read.

    """
    runs = []
    for path in dict.fromkeys(paths):
        own = len(paths) > 1 and (path / SAMPLES).is_file()
        try:
            runs.append(window(read_run(path, _OWN_NAMES if own else source), begin, end))
        except UserError as error:
            raise RecordingError(f'{path}: {error}') from None
    return dict(zip(_names(runs), runs))


def read_run(path: Path, source: Source = _OWN_NAMES) -> RecordedRun:
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
    figures, summary, told, history = None, {}, '', read_history(path)
    if (path / SAMPLES).is_file():
        if source != _OWN_NAMES:
            raise RecordingError(
                f'{SAMPLES} has columns of known names; topics and columns are those of other logs'
            )
        figures, summary = read_settings(path), read_summary(path)
        columns = {name: np.array(values) for name, values in read_columns(path)[0].items()}
        stop = stop_of(summary) or 0.0
    elif path.exists() and is_bag(path):
        columns, stop = read_bag(path, source)
    elif path.is_file():
        columns, stop, told, history.about['units'] = read_csv_log(path, source)
    elif path.exists():
        raise RecordingError(
            f'neither a folder with {SAMPLES} nor a rosbag2 bag (.db3, .mcap) nor a CSV file'
        )
    else:
        raise RecordingError('there is no such file or folder')
    columns.setdefault('reference', np.full(len(columns['time']), np.nan))
    return RecordedRun(
        path=path,
        rate=(figures.rate if figures else 0.0)
        or history.plant_rate()
        or _rate(_measured(columns)),
        stop=max(stop, float(columns['time'][-1])),
        columns=columns,
        summary=summary,
        told=told,
        figures=figures,
        history=history,
    )


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


def _names(runs: Sequence[RecordedRun]) -> list[str]:
    """Return the first kind of name that is there for all and different for each."""
    kinds: list[Callable[[RecordedRun], str]] = [
        _namespace,
        lambda run: run.path.resolve().name,
        lambda run: f'{_namespace(run)} {run.path.resolve().name}',
        lambda run: str(run.path),
    ]
    for kind in kinds:
        names = [kind(run) for run in runs]
        if all(names) and len(set(names)) == len(names):
            break
    return names


def _namespace(run: RecordedRun) -> str:
    return str(run.history.about.get('namespace', '')).strip('/')
