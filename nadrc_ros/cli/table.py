"""Tables on a terminal: no number is broken, however narrow it is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from nadrc_ros.report.tables import FIGURES, shown, wins
from nadrc_ros.simulation.metrics import MetricValues
from rich.console import Console
from rich.table import Table
from rich.text import Text

_PIPE_WIDTH = 200
_BETWEEN_COLUMNS = 2


class Row(NamedTuple):
    """What a row is called, what that means, and a cell for each column, plain or in a style."""

    label: str
    meaning: str
    cells: Sequence[str | Text]


def print_figures_of_merit(
    title: str, metrics: Mapping[str, MetricValues], settle_time: float = 0.0
) -> None:
    """Print a row for each figure and a column for each run, the lowest value in bold."""
    rows = []
    for key, label, meaning in FIGURES:
        values = [getattr(m, key) for m in metrics.values()]
        cells = [Text(shown(key, v), 'bold' if wins(v, values) else '') for v in values]
        if key == 'peak_error' and settle_time:
            meaning += f', {settle_time:.4g} s'
        rows.append(Row(label, meaning, cells))
    print_columns(title, list(metrics), rows)


def print_columns(title: str, heads: Sequence[str | Text], rows: Sequence[Row]) -> None:
    """
    Print columns of numbers under their heads, beside the labels of the rows and what these mean.

    Where that is too wide, the meanings come first, in lines of their own, and the columns that do
    not fit beside the others below them.
    """
    heads, *cells = ([_text(cell) for cell in line] for line in (heads, *(r.cells for r in rows)))
    screen = console()
    if title:
        screen.print(Text(title, 'bold'), soft_wrap=True)
    labels = max(len(row.label) for row in rows)
    widths = [
        _BETWEEN_COLUMNS + max(cell.cell_len for cell in (head, *(line[i] for line in cells)))
        for i, head in enumerate(heads)
    ]
    screen.width = max(screen.width, labels + max(widths))  # one column there must be
    meanings = max(len(row.meaning) for row in rows)
    beside = labels + _BETWEEN_COLUMNS + meanings + sum(widths) <= screen.width
    if meanings and not beside:
        for row in rows:
            screen.print(Text(f'{row.label:{labels}}  {row.meaning}', 'dim'), soft_wrap=True)
    for part in _parts(widths, screen.width - labels):
        table = Table(box=None, pad_edge=False, header_style='')
        table.add_column('', no_wrap=True)
        if meanings and beside:
            table.add_column('', no_wrap=True, style='dim')
        for i in part:
            table.add_column(heads[i], justify='right', no_wrap=True)
        for row, line in zip(rows, cells):
            about = [row.meaning] if meanings and beside else []
            table.add_row(row.label, *about, *(line[i] for i in part))
        screen.print(table, crop=False, no_wrap=True)


def _text(cell: str | Text) -> Text:
    return cell if isinstance(cell, Text) else Text(cell)


def console() -> Console:
    """Return the terminal, or what does not wrap lines where nobody is there to read them."""
    screen = Console(markup=False, emoji=False, highlight=False)
    if not screen.is_terminal:
        screen.width = _PIPE_WIDTH
    return screen


def _parts(widths: Sequence[int], room: int) -> Iterator[list[int]]:
    """Yield the columns that fit beside each other, at least one at a time."""
    part: list[int] = []
    for i, width in enumerate(widths):
        if part and sum(widths[k] for k in part) + width > room:
            yield part
            part = []
        part.append(i)
    yield part
