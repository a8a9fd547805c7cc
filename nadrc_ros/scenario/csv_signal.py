"""A column of a CSV file as a signal."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from functools import lru_cache
import os
from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.adrc.fields import build, choice, number, text
from nadrc_ros.adrc.settings import HIGHEST, LONGEST
from nadrc_ros.scenario.csv_file import open_csv
from nadrc_ros.scenario.user_code import ScenarioError
from nadrc_ros.simulation.signals import Table
import numpy as np

# Rows that are nearer in time [s] have no slope that can be counted with.
_SHORTEST_STEP = 1e-9
# Files that are kept read: a sweep makes the same signals at every point.
_FILES_KEPT = 8


@attrs.frozen(kw_only=True)
class CsvColumn:
    """Which column of a CSV file is a signal, and over which time."""

    time: str = text('1', 'column of the times, by name or by number from 1', live=False)
    column: str = text('2', 'column of the signal, by name or by number from 1', live=False)
    unit: str = text('', 'unit of the times; empty = that of the heading, else s', live=False)
    between: str = choice(
        'linear', ('linear', 'hold'), 'between two rows: a straight line, or the earlier one held'
    )
    start: float = number(
        0.0, 0.0, LONGEST, 's', 'time of the first row in the run; its value holds before'
    )


def load_column(path: str, values: Mapping[str, Any]) -> Table:
    """
    Return a column of a CSV file as a signal; ``values`` are fields of :class:`CsvColumn`.

    Raises
    ------
    ScenarioError, SettingError
        What is wrong with the file or a value.

    """
    wanted = build(CsvColumn, values)
    try:
        stat = os.stat(path)
        return _table(path, stat.st_mtime_ns, stat.st_size, wanted)
    except OSError as error:
        raise SettingError('csv', path, f'a CSV file ({error.strerror})') from None
    except UserError as error:
        raise ScenarioError(f'{path}: {error}') from None


@lru_cache(_FILES_KEPT)
def _table(path: str, changed: int, size: int, wanted: CsvColumn) -> Table:
    """Read a column; what the file system says of the file tells one state of it from another."""
    series = open_csv(Path(path)).series(wanted.time, (wanted.column,), wanted.unit)
    values = series.columns[wanted.column]
    there = ~np.isnan(values)  # an empty cell is nan
    if not there.any():
        raise UserError(f'{wanted.column}: it has no numbers in it')
    large = np.flatnonzero(np.abs(values) > HIGHEST)
    if large.size:
        raise UserError(
            f'line {series.lines[large[0]]}: {wanted.column} = {values[large[0]]:g} must be '
            f'within +-{HIGHEST:g}'
        )
    near = np.flatnonzero(np.diff(series.time) < _SHORTEST_STEP)
    if near.size:
        raise UserError(
            f'line {series.lines[near[0] + 1]}: {wanted.time} is less than '
            f'{_SHORTEST_STEP:g} s after that of line {series.lines[near[0]]}'
        )
    times = series.time[there] - series.time[there][0] + wanted.start
    return Table(
        times=array('d', times),
        values=array('d', values[there]),
        linear=wanted.between == 'linear',
    )
