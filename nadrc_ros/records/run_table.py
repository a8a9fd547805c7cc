"""The table of a sweep on the disk: a row per run, in order, so that a prefix of it is a state."""

from __future__ import annotations

from collections.abc import Iterable
import csv
import fcntl
from importlib.util import find_spec
import io
import os
from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.atomic import write_whole
from nadrc_ros.extras import MissingPackage
from nadrc_ros.scenario.sweep import cell, Extent, Sweep
from nadrc_ros.simulation.metrics import MetricValues

_METRICS = tuple(field.name for field in attrs.fields(MetricValues))
# A scenario has a duration too.
_COLUMN_NAMES = {'duration': 'duration_used'}


class RunTable:
    """
    The rows of a sweep, appended as the runs are done, and found again by the next start.

    Beside ``path`` lies ``<path>.yaml``, which says what it is a table of. A parquet file is made
    when all rows are there; until then they are in ``<path>.csv``. A killed process loses the rows
    that were not appended, and leaves whole lines but perhaps the last.

    Raises
    ------
    UserError
        When the table is one of another sweep, or not one at all, or another process writes it.

    """

    def __init__(self, path: Path, sweep: Sweep, extent: Extent) -> None:
        self.path = path
        self.sweep = sweep
        self.runs = extent.runs
        self.done = 0
        self._rows = path if path.suffix == '.csv' else path.with_name(path.name + '.csv')
        self._file: io.BufferedRandom | None = None
        if path != self._rows and find_spec('pyarrow') is None:
            raise MissingPackage(str(path), 'pyarrow', 'sweep', '.csv needs nothing')
        self._claim(sweep.describe(extent.files))
        if path != self._rows and path.exists():
            self._rows.unlink(missing_ok=True)
            self.done = self.runs
            return
        self._file = self._rows.open('a+b')
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.close()
            raise UserError(f'{self._rows}: another sweep is writing it') from None
        self.done = self._resume()

    def append(self, found: Iterable[MetricValues]) -> None:
        """Hand the rows of the next runs to the system, all at once."""
        assert self._file is not None
        text = ''
        for metrics in found:
            figures = (repr(getattr(metrics, name)) for name in _METRICS)
            text += _line([*self._key(self.done), *figures])
            self.done += 1
        self._file.write(text.encode())
        self._file.flush()

    def finish(self) -> None:
        """Make the table what it was asked to be, after the last run."""
        if self._file is not None and self.path != self._rows:
            self._file.flush()
            _to_parquet(self._rows, self.path, self.sweep)
            self._rows.unlink()

    def close(self) -> None:
        """Let others write the table."""
        if self._file is not None:
            self._file.close()

    def _claim(self, described: str) -> None:
        claim = self.path.with_name(self.path.name + '.yaml')
        if claim.exists():
            if claim.read_text(encoding='utf-8') != described:
                raise UserError(
                    f'{self.path}: {claim.name} beside it says that it is the table of another '
                    'sweep; delete both, or choose another table'
                )
        elif self.path.exists() or self._rows.exists():
            raise UserError(f'{self.path}: exists, and no {claim.name} says what it is a table of')
        else:
            write_whole(claim, described.encode())

    def _resume(self) -> int:
        """Cut off a row that was not written whole, check the keys, return how many there are."""
        assert self._file is not None
        header = _line(
            [*self.sweep.vary, 'controller', 'seed', *(_COLUMN_NAMES.get(m, m) for m in _METRICS)]
        )
        self._file.seek(0)
        rows, end = -1, 0
        for line in self._file:
            if not line.endswith(b'\n'):
                break
            if rows < 0:
                expected = header
            else:
                expected = _line(self._key(rows))[:-1] + ',' if rows < self.runs else '\n'
            if not line.startswith(expected.encode()):
                raise UserError(f'{self._rows}: line {rows + 2} is not that of this sweep')
            rows, end = rows + 1, end + len(line)
        if end < self._file.seek(0, os.SEEK_END):
            os.truncate(self._file.fileno(), end)
        if rows < 0:
            self._file.write(header.encode())
            self._file.flush()
        return max(rows, 0)

    def _key(self, run: int) -> list[str]:
        point, controller, seed = self.sweep.key(run)
        return [*map(cell, self.sweep.values(point).values()), controller, str(seed)]


def _line(cells: Iterable[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator='\n').writerow(cells)
    return text.getvalue()


def _to_parquet(rows: Path, path: Path, sweep: Sweep) -> None:
    """Convert block by block: the memory is that of a block."""
    from pyarrow import csv as reader
    from pyarrow import parquet

    part = path.with_name(f'.{path.name}.part')
    options = reader.ConvertOptions(column_types=_types(sweep), null_values=[])
    with (
        reader.open_csv(rows, convert_options=options) as blocks,
        parquet.ParquetWriter(part, blocks.schema) as writer,
    ):
        for block in blocks:
            writer.write_batch(block)
    os.replace(part, path)


def _types(sweep: Sweep) -> dict[str, str]:
    counts = {'seed', 'samples', 'skipped'}
    return {
        **{path: _type(values) for path, values in sweep.vary.items()},
        'controller': 'string',
        'seed': 'int64',
        **{_COLUMN_NAMES.get(m, m): 'int64' if m in counts else 'float64' for m in _METRICS},
    }


def _type(values: Iterable[Any]) -> str:
    """Return the narrowest type of column that holds the values; text if they are of many."""
    kinds = {type(value) for value in values}
    for known, name in (({bool}, 'bool'), ({int}, 'int64'), ({int, float}, 'float64')):
        if kinds <= known:
            return name
    return 'string'
