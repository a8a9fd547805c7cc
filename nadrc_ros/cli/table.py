"""The figures of merit of several runs, side by side."""

from __future__ import annotations

from collections.abc import Mapping

from nadrc_ros.report.figures_of_merit import ROWS, shown, wins
from nadrc_ros.simulation.metrics import MetricValues
from rich.console import Console
from rich.table import Table
from rich.text import Text

PIPE_WIDTH = 200


def print_figures_of_merit(
    title: str, metrics: Mapping[str, MetricValues], settle_time: float = 0.0
) -> None:
    """Print a row for each figure and a column for each run, the lowest value in bold."""
    table = Table(box=None, pad_edge=False)
    table.add_column('')
    table.add_column('')
    for name in metrics:
        table.add_column(Text(name), justify='right', overflow='fold')
    for key, label, meaning in ROWS:
        values = [getattr(m, key) for m in metrics.values()]
        cells = [Text(shown(key, v), 'bold' if wins(v, values) else '') for v in values]
        if key == 'peak_error' and settle_time:
            meaning += f', {settle_time:.4g} s'
        table.add_row(label, Text(meaning, 'dim'), *cells)
    screen = console()
    screen.print(Text(title, 'bold'))
    screen.print(table)


def console() -> Console:
    """Return the terminal, or what does not wrap lines where nobody is there to read them."""
    terminal = Console()
    return terminal if terminal.is_terminal else Console(width=PIPE_WIDTH)
