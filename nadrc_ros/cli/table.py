"""The figures of merit of several runs, side by side."""

from __future__ import annotations

from collections.abc import Mapping

from nadrc_ros.simulation.metrics import MetricValues, SETTLE_TIME
from rich.console import Console
from rich.table import Table
from rich.text import Text

ROWS = (
    ('itae', 'ITAE', 'integral of t |e|'),
    ('isu', 'ISU', 'integral of u²'),
    ('iae', 'IAE', 'integral of |e|'),
    ('rmse', 'RMSE', 'root mean square of e'),
    ('max_error', 'max |e|', 'largest error'),
    ('peak_error', 'peak |e|', f'largest error from {SETTLE_TIME:g} s on'),
    ('total_variation', 'TV', 'total variation of u'),
    ('saturated_fraction', 'saturated', 'share of the time'),
)
PIPE_WIDTH = 200


def print_figures_of_merit(title: str, metrics: Mapping[str, MetricValues]) -> None:
    """Print a row for each figure and a column for each run, the lowest value in bold."""
    table = Table(box=None, pad_edge=False)
    table.add_column('')
    table.add_column('')
    for name in metrics:
        table.add_column(Text(name), justify='right', overflow='fold')
    for key, label, meaning in ROWS:
        values = [getattr(m, key) for m in metrics.values()]
        cells = [Text(_shown(key, v), 'bold' if _wins(v, values) else '') for v in values]
        table.add_row(label, Text(meaning, 'dim'), *cells)
    screen = console()
    screen.print(Text(title, 'bold'))
    screen.print(table)


def console() -> Console:
    """Return the terminal, or what does not wrap lines where nobody is there to read them."""
    terminal = Console()
    return terminal if terminal.is_terminal else Console(width=PIPE_WIDTH)


def _wins(value: float, values: list[float]) -> bool:
    return value == min(values) < max(values)


def _shown(key: str, value: float) -> str:
    return f'{100.0 * value:.1f} %' if key == 'saturated_fraction' else f'{value:.4g}'
