"""Tables on a terminal: no number and no word is broken, however narrow it is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import sys
from typing import NamedTuple

from nadrc_ros.report.tables import FIGURES, shown_together, winners
from nadrc_ros.scenario.units import Units, with_unit
from nadrc_ros.simulation.metrics import MetricValues
from nadrc_ros.terminal import columns, wrapped
from rich.console import Console
from rich.text import Text

_PIPE_WIDTH = 200
_NO_UNITS = Units()
_GAP = 2
Column = list[Text]


class Row(NamedTuple):
    """What a row is called, what that means, and a cell for each column, plain or in a style."""

    label: str
    meaning: str
    cells: Sequence[str | Text]


def print_figures_of_merit(
    title: str,
    metrics: Mapping[str, MetricValues],
    settle_time: float = 0.0,
    units: Units = _NO_UNITS,
) -> None:
    """Print a row for each figure and a column for each run, the lowest value in bold."""
    rows = []
    for key, label, meaning in FIGURES:
        values = [getattr(m, key) for m in metrics.values()]
        texts = shown_together(key, values, plain=True)
        best = winners(texts, values)
        cells = [Text(text, 'bold' if wins else '') for text, wins in zip(texts, best)]
        if key == 'peak_error' and settle_time:
            meaning += f', {settle_time:.4g} s'
        rows.append(Row(with_unit(label, units.of_figure(key)), meaning, cells))
    print_columns(title, list(metrics), rows)


def print_columns(
    title: str, heads: Sequence[str | Text], rows: Sequence[Row], corner: str = ''
) -> None:
    """
    Print columns of numbers under their heads, beside the labels of the rows and what these mean.

    Where that is too wide, the meanings come first, in lines of their own. Where it still is, the
    table is turned, and what does not fit either way is printed in parts, one below the other.
    ``corner`` is the head of the labels.
    """
    screen = console()
    print_text(title, 'bold')
    lines = [list(map(_text, line)) for line in (heads, *(row.cells for row in rows))]
    table = [list(column) for column in zip(*lines)]
    labels = [Text(corner), *(Text(row.label) for row in rows)]
    meanings = [Text(), *(Text(row.meaning, 'dim') for row in rows)]
    if not any(row.meaning for row in rows):
        meanings = []
    if meanings and _span([labels, meanings, *table]) <= screen.width:
        _print(screen, [labels, meanings], table)
        return
    if meanings:
        _print_meanings(screen, rows)
    if _span([labels, *table]) > screen.width:
        names = [Text(corner), *lines[0]]
        turned = [[label, *line] for label, line in zip(labels[1:], lines[1:])]
        if _span([names, *turned]) <= screen.width:
            labels, table = names, turned
    for part in _parts(table, screen.width - _span([labels])):
        _print(screen, [labels], part)


def print_text(text: str, style: str = '') -> None:
    """Print text whose lines break between words."""
    screen = console()
    if text:
        width = screen.width if screen.is_terminal else None
        screen.print(Text(wrapped(text, width), style), soft_wrap=True)


def _print_meanings(screen: Console, rows: Sequence[Row]) -> None:
    label = max(len(row.label) for row in rows) + _GAP
    for row in rows:
        if row.meaning:
            line = wrapped(f'{row.label:{label}}{row.meaning}', screen.width, ' ' * label)
            screen.print(Text(line, 'dim'), soft_wrap=True)


def _print(screen: Console, left: Sequence[Column], right: Sequence[Column]) -> None:
    """Print columns, some to the left and the others to the right."""
    begin = not any(column[0] for column in (*left, *right))  # heads that are all empty
    for i in range(begin, len(right[0])):
        line = Text()
        for column in (*left, *right):
            cell = column[i].copy()
            cell.align('left' if any(column is each for each in left) else 'right', _width(column))
            line += cell + Text(' ' * _GAP)
        line.rstrip()
        screen.print(line, soft_wrap=True)


def _width(column: Column) -> int:
    return max(cell.cell_len for cell in column)


def _span(columns: Sequence[Column]) -> int:
    return sum(map(_width, columns)) + _GAP * (len(columns) - 1)


def _text(cell: str | Text) -> Text:
    return cell if isinstance(cell, Text) else Text(cell)


def console() -> Console:
    """Return the terminal, or what does not wrap lines where nobody is there to read them."""
    wide = columns(sys.stdout) or _PIPE_WIDTH
    # With a height too, or rich takes any dumb terminal to have 80 columns.
    return Console(width=wide, height=25, markup=False, emoji=False, highlight=False)


def _parts(columns: Sequence[Column], room: int) -> Iterator[list[Column]]:
    """Yield the columns that fit beside each other, at least one at a time."""
    part: list[Column] = []
    for column in columns:
        if part and _span([*part, column]) + _GAP > room:
            yield part
            part = []
        part.append(column)
    yield part
