"""Columns over time from a CSV file, however it is written."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from math import nan
from pathlib import Path
import re

import attrs
from nadrc_ros.adrc.errors import did_you_mean, UserError
from nadrc_ros.scenario.csv_dialect import decoded, Dialect, dialect_of, is_missing, rows, SECONDS
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
DATE = re.compile(
    r'(?:(\d{4}-\d\d-\d\d)[T ])?(\d\d:\d\d:\d\d)([.,]\d+)?\s*(?:Z|UTC|[-+]\d\d:?\d\d)?'
)


@attrs.frozen(eq=False)
class Series:
    """
    Columns over time.

    Attributes
    ----------
    time
        Of the rows [s], (N,), as the file has it; it increases.
    columns
        Arrays (N,) by name, nan where a cell is empty.
    cut
        Whether the last row was cut short, and so was left out.

    """

    time: Array
    columns: dict[str, Array]
    cut: bool


@attrs.frozen(eq=False)
class CsvFile:
    """A text with columns, and how it is written."""

    text: str = attrs.field(repr=False)
    dialect: Dialect
    encoding: str

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the columns, or their numbers from 1 where there is no heading."""
        return self.dialect.names

    @property
    def told(self) -> str:
        """Return how it is written, in words."""
        return f'{self.dialect}, {self.encoding}'

    def series(self, time: str, columns: Sequence[str], unit: str = '') -> Series:
        """
        Return columns over time; its ``unit`` is by default the one of its heading, else s.

        Raises
        ------
        UserError
            For a column that does not exist, a cell that is no number, and a time that repeats or
            decreases, by their line.

        """
        places = [self.place(name) for name in (time, *columns)]
        unit = unit or self.unit_of(time)
        if unit not in SECONDS:
            raise UserError(f'the unit of time {unit!r}: must be one of {", ".join(SECONDS)}')
        lines, cells, cut = self._cells(places)
        stamps = self._times(time, cells[0], lines, SECONDS[unit])
        values = [self._numbers(n, each, lines) for n, each in zip(columns, cells[1:])]
        return Series(time=stamps, columns=dict(zip(columns, values)), cut=cut)

    def place(self, name: str) -> int:
        """Return the index of a column, from its name, with or without a unit, or its number."""
        if name in self.names:
            return self.names.index(name)
        bare = [_bare(each) for each in self.names]
        if bare.count(_bare(name)) == 1:
            return bare.index(_bare(name))
        if name.isdecimal() and 0 < int(name) <= len(self.names):
            return int(name) - 1
        raise UserError(f'there is no column {name!r}: {did_you_mean(name, self.names)}')

    def unit_of(self, time: str) -> str:
        """Return the unit of a column of times: that of its heading, else s."""
        return self.dialect.units[self.place(time)] or 's'

    def _cells(self, places: Sequence[int]) -> tuple[list[int], list[list[str]], bool]:
        """Return the lines of the rows, their cells column by column, and whether one was cut."""
        width, lines, short = len(self.names), [], 0
        cells: list[list[str]] = [[] for _ in places]
        for line, row in rows(self.text, self.dialect.separator, comments=False):
            if line < self.dialect.first_line:
                continue
            if short or not width <= len(row) <= width + (row[-1] == ''):
                if short or len(row) > width:
                    raise self._uneven(short or line)
                short = line  # the last one may be cut
                continue
            lines.append(line)
            for column, place in zip(cells, places):
                column.append(row[place])
        return lines, cells, bool(short)

    def _uneven(self, line: int) -> UserError:
        hint = '; are commas between the cells and within numbers?' * (
            self.dialect.separator == ','
        )
        return UserError(f'line {line}: has not {len(self.names)} cells as the others{hint}')

    def _numbers(self, name: str, cells: list[str], lines: list[int]) -> Array:
        try:
            return np.array([float(cell) for cell in cells])
        except ValueError:
            return np.array([self._number(name, *each) for each in zip(cells, lines)])

    def _number(self, name: str, cell: str, line: int) -> float:
        if is_missing(cell):
            return nan
        try:
            return float(cell.replace(',', '.') if self.dialect.decimal_comma else cell)
        except ValueError:
            raise UserError(f'line {line}: {name} = {cell!r} is no number') from None

    def _times(self, name: str, cells: list[str], lines: list[int], scale: float) -> Array:
        if not cells:
            raise UserError('there are no rows of numbers')
        dates = DATE.fullmatch(cells[0].strip()) is not None
        stamps = (
            np.array([_seconds(name, *each) for each in zip(cells, lines)])
            if dates
            else scale * self._numbers(name, cells, lines)
        )
        bad = np.flatnonzero(~np.isfinite(stamps))
        if bad.size:
            raise UserError(f'line {lines[bad[0]]}: {name} = {cells[bad[0]]!r} is no time')
        bad = np.flatnonzero(np.diff(stamps) <= 0.0)
        if bad.size:
            i = int(bad[0])
            how = 'repeats' if stamps[i + 1] == stamps[i] else 'is before'
            more = f'; {bad.size - 1} more such lines' if bad.size > 1 else ''
            raise UserError(
                f'line {lines[i + 1]}: {name} = {cells[i + 1]} {how} that of line {lines[i]}, '
                f'{cells[i]}, and times must increase{more}'
            )
        return stamps


def open_csv(path: Path) -> CsvFile:
    """
    Find out how a file is written.

    Raises
    ------
    UserError
        When it is no table of numbers, in one sentence without its name.
    OSError
        When it cannot be read.

    """
    text, encoding = decoded(path.read_bytes())
    return CsvFile(text, dialect_of(text), encoding)


def _bare(name: str) -> str:
    """Return a name in lower case, without what it has in brackets."""
    return re.sub(r'\s*[\[(].*[\])]$', '', name.strip()).lower()


def _seconds(name: str, cell: str, line: int) -> float:
    """Return the seconds since 1970, or of the day, of a date in the format ISO 8601."""
    found = DATE.fullmatch(cell.strip())
    try:
        if found is None:
            raise ValueError
        day, clock, fraction = found.groups()
        whole = datetime.fromisoformat(f'{day or "1970-01-01"} {clock}') - datetime(1970, 1, 1)
    except ValueError:
        raise UserError(f'line {line}: {name} = {cell!r} is no date as the first one') from None
    return whole.total_seconds() + float((fraction or '0').replace(',', '.'))
