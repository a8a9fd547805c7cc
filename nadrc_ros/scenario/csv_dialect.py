"""
How a CSV file is written, found out from its first rows.

Cells between commas, semicolons, tabs, bars or blanks; decimal points or commas; UTF-8, UTF-16 or
Latin-1, with a byte order mark or without; quotes; a heading, one in a comment, or none; lines
before it, and one of units below it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
import csv
from io import StringIO
from itertools import islice, takewhile
import re

import attrs
from nadrc_ros.adrc.errors import UserError

_SEPARATORS = {';': 'semicolons', '\t': 'tabs', ',': 'commas', '|': 'bars', ' ': 'blanks'}
_ENCODINGS = (
    (b'\xef\xbb\xbf', 'utf-8-sig', 'UTF-8 with a byte order mark'),
    (b'\xff\xfe', 'utf-16', 'UTF-16'),
    (b'\xfe\xff', 'utf-16', 'UTF-16'),
    (b'', 'utf-8', 'UTF-8'),
)
SECONDS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9, 'min': 60.0, 'h': 3600.0}
SPELT = {'sec': 's', 'second': 's', 'seconds': 's', 'msec': 'ms', 'µs': 'us', 'μs': 'us'}
_NUMBER = re.compile(r'\s*[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?\s*')
_MISSING = {'', '-', 'na', 'n/a', 'nan', 'null', 'none'}
_COMMENT_MARKS = ('#', '%', '//')
# A name with its unit: time [ms], time (ms), time_ms, time/ms.
_NAME_WITH_UNIT = re.compile(r'.+?\s*(?:\[(.*)\]|\((.*)\)|[_/]\s*(\w+))')
# So many rows tell how a file is written.
_ROWS_LOOKED_AT = 1000

Rows = list[tuple[int, list[str]]]


@attrs.frozen(kw_only=True)
class Dialect:
    """
    How a text is written.

    Attributes
    ----------
    names
        Of the columns; their numbers from 1 where there is no heading.
    units
        Of time, of the columns whose heading says so, else ''.
    separator, decimal
        What is between the cells and within numbers, '' if the first ones are whole.
    first_line
        Of the numbers.

    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    heading: bool
    separator: str
    decimal: str
    first_line: int

    @property
    def takes_comma(self) -> bool:
        """Tell whether a comma in a cell is that of a number."""
        return self.decimal == ',' or (self.decimal == '' and self.separator != ',')

    def __str__(self) -> str:
        """Say it in words."""
        words = [f'{_SEPARATORS[self.separator]} between cells']
        words += ['decimal commas'] if self.decimal == ',' else []
        words += [] if self.heading else ['no heading, so columns have numbers']
        return ', '.join(words)


def dialect_of(text: str) -> Dialect:
    """
    Find out how a text is written.

    Raises
    ------
    UserError
        When it is no table of numbers, or cannot be told.

    """
    separator, head = _separated(text)
    width = len(head[-1][1])
    even = [row for _, row in head if len(row) == width]
    counts = [sum(map(is_number, column)) for column in zip(*even)]
    numbers = [i for i, count in enumerate(counts) if count > 0.5 * max(counts)]
    first = next(i for i, (_, row) in enumerate(head) if _is_data(row, width, numbers))
    above = head[:first]
    bare = rows(text, separator, comments=False)
    plain = list(takewhile(lambda each: each[0] < head[first][0], bare))
    last = len((plain or above)[-1][1]) if above else 0
    if separator == ',' and last > 1 and width == 2 * last:
        raise UserError(
            f'{last} names and {width} numbers in a row: commas between cells and within numbers '
            'cannot be distinguished'
        )
    # a comment with fewer cells is a remark
    names, units = _heading([e[1] for e in above if e in plain or len(e[1]) == width], width)
    body = [cell for _, row in head[first:] for cell in row if is_number(cell)]
    return Dialect(
        names=names if any(names) else tuple(str(k + 1) for k in range(width)),
        units=units,
        heading=any(names),
        separator=separator,
        decimal=next((mark for mark in '.,' if any(mark in cell for cell in body)), ''),
        first_line=head[first][0],
    )


def decoded(raw: bytes) -> tuple[str, str]:
    """Return the text, and how it is encoded, in words."""
    encoding, told = next((name, said) for mark, name, said in _ENCODINGS if raw.startswith(mark))
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError:
        text, told = raw.decode('latin-1'), 'Latin-1'
    if '\0' in text:
        raise UserError('this is not text')
    return text, told


def _separated(text: str) -> tuple[str, Rows]:
    """Return the separator, and the first rows by it, the last of which has the usual width."""
    best: tuple[float, str, Rows] = (0.0, '', [])
    for separator in _SEPARATORS:
        found = list(islice(rows(text, separator, comments=True), _ROWS_LOOKED_AT))
        widths = Counter(len(row) for _, row in found if any(map(is_number, row)))
        if not widths:
            continue
        width, count = widths.most_common(1)[0]
        while len(found[-1][1]) != width:
            found.pop()
        cells = [cell for _, row in found if len(row) == width for cell in row]
        score = sum(map(is_number, cells)) / len(cells) * count / len(found)
        if width > 1 and score > best[0]:
            best = (score, separator, found)
    if not best[1]:
        raise UserError('this is no table of at least two columns of numbers')
    return best[1:]


def rows(text: str, separator: str, comments: bool) -> Iterator[tuple[int, list[str]]]:
    """Yield line and cells of what is not blank, and of comments, if asked for, without a mark."""
    reader = csv.reader(StringIO(text, newline=None), delimiter=separator, skipinitialspace=True)
    try:
        for row in reader:
            if row and row[0].startswith(_COMMENT_MARKS):
                if not comments:
                    continue
                row[0] = row[0].lstrip('#%/ ')
                del row[: separator == ' ' and not row[0]]
            while separator == ' ' and row and not row[-1]:
                row.pop()
            if any(row):
                yield reader.line_num, row
    except csv.Error as error:
        raise UserError(f'line {reader.line_num}: {error}') from None


def is_number(cell: str) -> bool:
    """Tell whether a cell is a number, with a point or a comma."""
    return _NUMBER.fullmatch(cell) is not None


def is_missing(cell: str) -> bool:
    """Tell whether a cell says that there is no number."""
    return cell.strip().lower() in _MISSING


def _is_data(row: list[str], width: int, numbers: list[int]) -> bool:
    """Tell whether there are numbers where most rows have them."""
    if len(row) != width or not any(is_number(row[k]) for k in numbers):
        return False
    return all(is_number(row[k]) or is_missing(row[k]) for k in numbers)


def _heading(above: list[list[str]], width: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names and units of the columns, from the rows before the first of numbers."""
    fitting = [
        [cell.strip() for cell in [*row, ''][:width]] for row in above if 0 <= width - len(row) < 2
    ]
    below = [''] * width
    if len(fitting) > 1 and any(_unit(cell.strip('[]()')) for cell in fitting[-1]):
        below = [_unit(cell.strip('[]()')) for cell in fitting.pop()]
    names = fitting[-1] if fitting else [''] * width
    own = [_NAME_WITH_UNIT.fullmatch(name) for name in names]
    units = [next(filter(None, match.groups()), '') if match else '' for match in own]
    return tuple(names), tuple(map(lambda a, b: _unit(a) or b, units, below))


def _unit(text: str) -> str:
    unit = SPELT.get(text.lower(), text.lower())
    return unit if unit in SECONDS else ''
