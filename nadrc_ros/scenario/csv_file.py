"""Columns over time from a CSV file, however it is written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from gzip import decompress
from itertools import dropwhile, islice
from math import nan
from pathlib import Path
import re
from zlib import error

import attrs
from nadrc_ros.adrc.errors import did_you_mean, UserError
from nadrc_ros.adrc.settings import HIGHEST
from nadrc_ros.scenario.csv_dialect import (
    decoded,
    Dialect,
    dialect_of,
    is_missing,
    rows,
    SECONDS,
    SPELT,
)
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
_IN_BRACKETS = re.compile(r'\s*[\[(](.*)[\])]$')
_DATE = re.compile(
    r'(?:(\d{4}-\d\d-\d\d)[T ])?(\d\d:\d\d:\d\d)([.,]\d+)?\s*(?:Z|UTC|[-+]\d\d:?\d\d)?'
)
_GZIP, _ZIP = b'\x1f\x8b', b'PK\x03\x04'
# Rows that are turned into numbers at a time, for the sake of the memory.
_BLOCK = 2**16


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
    lines
        Of the file, from 1, where the rows are.
    cut
        Whether the last row was cut short, and so was left out.
    dated
        Whether the times are dates or those of a clock, which have no unit.

    """

    time: Array
    columns: dict[str, Array]
    lines: list[int]
    cut: bool
    dated: bool


@attrs.frozen(eq=False, kw_only=True)
class CsvFile(Dialect):
    """A text with columns, and how it is written."""

    text: str = attrs.field(repr=False)
    encoding: str

    @property
    def told(self) -> str:
        """Return how it is written, in words."""
        return f'{self}, {self.encoding}'

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
        unit = unit or self.unit_of(time) or 's'
        if unit not in SECONDS:
            raise UserError(f'the unit of time {unit!r}: must be one of {", ".join(SECONDS)}')
        lines: list[int] = []
        parts: list[list[Array]] = [[] for _ in places]
        cut = dated = False
        for some, cells, short in self._blocks(places):
            parts[0].append(self._times(time, cells[0], some, SECONDS[unit]))
            for name, part, column in zip(columns, parts[1:], cells[1:]):
                part.append(self._numbers(name, column, some))
            dated = dated or (bool(cells[0]) and _is_date(cells[0][0]))
            lines += some
            cut = short
        if not lines:
            raise UserError('there are no rows of numbers')
        stamps, *values = (np.concatenate(part) for part in parts)
        _check_order(time, stamps, lines)
        table = dict(zip(columns, values))
        return Series(time=stamps, columns=table, lines=lines, cut=cut, dated=dated)

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

    def unit_in_brackets(self, name: str) -> str:
        """Return what the heading of a column has in brackets (angle [rad]), '' if nothing."""
        found = _IN_BRACKETS.search(self.names[self.place(name)].strip())
        return found[1].strip() if found else ''

    def unit_of(self, time: str) -> str:
        """Return the unit of a column of times: that of its heading, '' if it names none."""
        place = self.place(time)
        return self.units[place] or SPELT.get(self.names[place].lower(), '')

    def _blocks(self, places: Sequence[int]) -> Iterator[tuple[list[int], list[list[str]], bool]]:
        """Yield lines of rows, their cells by column, and whether a cut one followed, in parts."""
        width, short = len(self.names), 0
        body = rows(self.text, self.separator, comments=False)
        body = dropwhile(lambda each: each[0] < self.first_line, body)
        while block := list(islice(body, _BLOCK)):
            for line, row in block:
                if len(row) == width and not short:
                    continue
                if short or len(row) > width + (row[-1] == ''):
                    raise self._uneven(short or line)
                short = line if len(row) < width else 0  # the last one may be cut
            if short:
                block.pop()
            cells = [[row[place] for _, row in block] for place in places]
            yield [line for line, _ in block], cells, bool(short)

    def _uneven(self, line: int) -> UserError:
        hint = '; are commas between the cells and within numbers?' * (self.separator == ',')
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
            return float(cell.replace(',', '.') if self.takes_comma else cell)
        except ValueError:
            raise UserError(f'line {line}: {name} = {cell!r} is not a number') from None

    def _times(self, name: str, cells: list[str], lines: list[int], scale: float) -> Array:
        if cells and _is_date(cells[0]):
            stamps = np.array([_seconds(name, *each) for each in zip(cells, lines)])
        else:
            with np.errstate(over='ignore'):
                stamps = scale * self._numbers(name, cells, lines)
        bad = np.flatnonzero(~(np.abs(stamps) <= HIGHEST))
        if bad.size:
            raise UserError(f'line {lines[bad[0]]}: {name} = {cells[bad[0]]!r} is no time')
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
    raw = path.read_bytes()
    if raw.startswith(_GZIP):
        try:
            raw = decompress(raw)
        except (EOFError, OSError, error) as failure:
            raise UserError(f'a gzip file that is broken: {failure}') from None
    if raw.startswith(_ZIP):
        raise UserError('this is no text but an archive, or a workbook: save its sheet as CSV')
    text, encoding = decoded(raw)
    return CsvFile(**attrs.asdict(dialect_of(text)), text=text, encoding=encoding)


def _check_order(name: str, stamps: Array, lines: list[int]) -> None:
    bad = np.flatnonzero(np.diff(stamps) <= 0.0)
    if bad.size:
        i = int(bad[0])
        how = 'repeats' if stamps[i + 1] == stamps[i] else 'is before'
        more = f'; {bad.size - 1} more such lines' if bad.size > 1 else ''
        raise UserError(
            f'line {lines[i + 1]}: {name} {how} that of line {lines[i]}, {stamps[i]:.15g} s, and '
            f'times must increase{more}'
        )


def _is_date(cell: str) -> bool:
    return _DATE.fullmatch(cell.strip()) is not None


def _bare(name: str) -> str:
    """Return a name in lower case, without what it has in brackets."""
    return _IN_BRACKETS.sub('', name.strip()).lower()


def _seconds(name: str, cell: str, line: int) -> float:
    """Return the seconds since 1970, or of the day, of a date in the format ISO 8601."""
    found = _DATE.fullmatch(cell.strip())
    try:
        if found is None:
            raise ValueError
        day, clock, fraction = found.groups()
        whole = datetime.fromisoformat(f'{day or "1970-01-01"} {clock}') - datetime(1970, 1, 1)
    except ValueError:
        raise UserError(f'line {line}: {name} = {cell!r} is no date as the first one') from None
    return whole.total_seconds() + float((fraction or '0').replace(',', '.'))
