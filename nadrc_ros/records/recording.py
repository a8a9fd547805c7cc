"""A recorded run: a folder with ``run.json``, ``samples.csv`` as it comes, ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
import json
from math import inf, isfinite, isnan, nan
from pathlib import Path
from shutil import rmtree
from typing import Any

import attrs
from nadrc_ros.adrc.errors import one_of, SettingError, UserError
from nadrc_ros.adrc.fields import build, choice, declared, number
from nadrc_ros.adrc.settings import HIGHEST, LONGEST, LOWEST
from nadrc_ros.atomic import content_of, write_json

SETTINGS = 'run.json'
SAMPLES = 'samples.csv'
SUMMARY = 'summary.json'
NEEDED = ('reference', 'measurement', 'command')
# What a controller may be told besides: what acts, as it was reported, and what to add.
JOINED = ('applied', 'feed_forward')
TRUTH = ('output', 'total_disturbance')
ESTIMATES = {
    'tracking': 'tracking',
    'output_estimate': 'output_estimate',
    'disturbance_estimate': 'total_disturbance',
}
# When the samples of a row left their publishers [s since the start in about.json].
STAMPED = ('reference', 'measurement', 'command')
STAMPS = tuple(f'{name}_stamp' for name in STAMPED)
# What an earlier version did not write and took for granted.
_TAKEN_FOR_GRANTED = {'settle_time': 2.0, 'measurement_period': 0.0}


class RecordingError(UserError):
    """What a folder holds is not a recorded run; the message says which file and why."""


@attrs.frozen(kw_only=True)
class FigureSettings:
    """What the figures of merit need to know besides the samples."""

    error: str = choice(
        'reference',
        ('reference', 'tracking'),
        'error of the metrics: reference - output, or ~/tracking of the controller - output',
        live=False,
    )
    command_min: float = number(
        LOWEST,
        LOWEST,
        HIGHEST,
        'command unit',
        'lower limit, for the saturated fraction; with neither, those of the controller',
        live=False,
    )
    command_max: float = number(
        HIGHEST,
        LOWEST,
        HIGHEST,
        'command unit',
        'upper limit, for the saturated fraction; with neither, those of the controller',
        live=False,
    )
    measurement_period: float = number(
        0.0,
        0.0,
        HIGHEST,
        'output unit',
        'period of an angle, whose error is the short one; 0 = that of the controller',
        live=False,
    )
    settle_time: float = number(
        0.0,
        0.0,
        LONGEST,
        's',
        'from when on peak_error counts; 0 = a tenth of duration, never without one',
        live=False,
    )

    @property
    def knows_limits(self) -> bool:
        """Tell whether a limit of the command is known."""
        return (self.command_min, self.command_max) != (LOWEST, HIGHEST)


@attrs.frozen(kw_only=True)
class RunSettings(FigureSettings):
    """What ``run.json`` has: enough to compute the figures of merit from the samples."""

    rate: float = number(
        0.0, 0.0, 1e5, 'Hz', 'rows per second where they are periods; 0 = as their times say'
    )


def topic_of(name: str, plant: str = 'plant', controller: str = 'controller') -> str:
    """
    Return the topic of a recorded signal, by its column and the names of the nodes.

    Raises
    ------
    SettingError
        For a signal that does not exist.

    """
    if name in (*NEEDED, *JOINED):
        return name
    if name in TRUTH:
        return f'{plant}/{name}'
    if name in ESTIMATES:
        return f'{controller}/{ESTIMATES[name]}'
    level = name.removeprefix('level_')
    if name != level and level.isdigit():
        return f'{controller}/level_{level}/disturbance'
    raise SettingError(
        'inputs', name, one_of(name, (*NEEDED, *JOINED, *TRUTH, *ESTIMATES, 'level_1'))
    )


class RunFolder:
    """
    A new folder for one run; an existing one is never touched.

    ``before`` is the number of folders that were there.

    Parameters
    ----------
    directory
        Where the folder is made; made itself if need be.
    columns
        Names of the numbers of a row.
    settings
        Written before the first sample, so that a run that ends badly can be summarised.

    Raises
    ------
    OSError
        When a folder or a file cannot be made, or the disk is full; nothing is left then.

    """

    def __init__(self, directory: Path, columns: Sequence[str], settings: RunSettings) -> None:
        self.before = _folders(directory)
        self.path = _new_folder(directory)
        try:
            write_json(self.path / SETTINGS, 'run', attrs.asdict(settings))
            self._file = (self.path / SAMPLES).open('x', encoding='utf-8')
            self._file.write(','.join(columns) + '\n')
            self.flush()
        except OSError:
            self.discard()
            raise

    def discard(self) -> None:
        """Remove a folder in which no run could begin."""
        rmtree(self.path, ignore_errors=True)

    def write(self, row: Sequence[float]) -> None:
        """Append one row; what is not known (nan) is left empty. Numbers read back to the bit."""
        self._file.write(','.join('' if isnan(x) else repr(x) for x in row) + '\n')

    def flush(self) -> None:
        """Hand all rows to the operating system: they survive the death of the process."""
        self._file.flush()

    def close(self) -> None:
        """Close the samples."""
        self._file.close()

    def write_summary(self, content: Mapping[str, Any]) -> None:
        """Write or replace the summary in one step: it is never half there."""
        write_json(self.path / SUMMARY, 'summary', content)


def read_samples(folder: Path) -> dict[str, list[float]]:
    """Return the columns of ``samples.csv``; a last row that was cut short is left out."""
    return _read(folder)[0]


def read_columns(folder: Path) -> tuple[dict[str, list[float]], bool]:
    """
    Return the columns of a run, and whether its last row was cut short, and so left out.

    A kill or a full disk cuts a row short.

    Raises
    ------
    RecordingError
        For samples that no recorder wrote, or none.

    """
    columns, cut = _read(folder)
    for name in ('time', *NEEDED):
        if name not in columns:
            raise RecordingError(f'{SAMPLES}: no column {name}')
    times = columns['time']
    if not times:
        raise RecordingError(f'{SAMPLES}: no samples')
    for row, (before, time) in enumerate(zip([-inf, *times], times)):
        if not isfinite(time):
            raise RecordingError(f'{SAMPLES}: the time of row {row} is not a number')
        if time <= before:
            raise RecordingError(f'{SAMPLES}: the times do not increase at {time:g} s')
    return columns, cut


def _read(folder: Path) -> tuple[dict[str, list[float]], bool]:
    with (folder / SAMPLES).open(encoding='utf-8', errors='replace') as file:
        names = file.readline().rstrip('\n').split(',')
        columns: list[list[float]] = [[] for _ in names]
        for place, line in enumerate(file, 2):
            if not line.endswith('\n'):
                return dict(zip(names, columns)), True
            try:
                row = [float(cell) if cell else nan for cell in line[:-1].split(',')]
            except ValueError:
                row = []
            if len(row) != len(names):
                raise RecordingError(f'{SAMPLES}, line {place}: not {len(names)} numbers')
            for column, sample in zip(columns, row):
                column.append(sample)
    return dict(zip(names, columns)), False


def read_summary(folder: Path) -> dict[str, Any]:
    """Return the summary of a run, empty if there is none that can be read, as JSON."""
    try:
        content = json.loads((folder / SUMMARY).read_bytes())
    except (FileNotFoundError, ValueError):
        return {}
    if not isinstance(content, dict):
        return {}
    return content_of(SUMMARY, 'summary', content)


def stop_of(content: Mapping[str, Any]) -> float | None:
    """Return when the run of a summary ended [s], None where that does not say it."""
    stop = content.get('stop')
    return float(stop) if isinstance(stop, (int, float)) and isfinite(stop) else None


def read_settings(folder: Path) -> RunSettings:
    """
    Return what ``run.json`` says.

    Raises
    ------
    RecordingError, SettingError
        When that is not what a recorder wrote.
    OSError
        When it cannot be read.

    """
    path = folder / SETTINGS
    try:
        content = json.loads(path.read_bytes())
    except ValueError as error:
        raise RecordingError(f'{path.name}: {error}') from None
    known = declared(RunSettings)
    if isinstance(content, dict):
        content = _TAKEN_FOR_GRANTED | content_of(path.name, 'run', content)
    if not isinstance(content, dict) or content.keys() != known.keys():
        raise RecordingError(f'{path.name}: must have {", ".join(known)} and nothing else')
    return build(RunSettings, content, path.name)


def _new_folder(directory: Path) -> Path:
    directory.mkdir(parents=True, exist_ok=True)
    name = datetime.now().strftime('%Y%m%d-%H%M%S')
    attempt = 1
    while True:
        path = directory / (name if attempt == 1 else f'{name}-{attempt}')
        try:
            path.mkdir()
            return path
        except FileExistsError:
            attempt += 1


def _folders(directory: Path) -> int:
    return sum(each.is_dir() for each in directory.iterdir()) if directory.is_dir() else 0
