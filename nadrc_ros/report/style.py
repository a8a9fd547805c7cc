"""The look of pictures drawn by matplotlib, their logarithmic axes, and their files."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from math import floor, log10
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter, NullFormatter
from nadrc_ros.report.roles import GREY, GRID, INK

STYLE = {
    'agg.path.chunksize': 10000,
    'axes.edgecolor': GREY,
    'axes.grid': True,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.titlelocation': 'left',
    'axes.titlesize': 9.5,
    'font.family': 'DejaVu Sans',
    'font.size': 9,
    'grid.color': GRID,
    'grid.linewidth': 0.6,
    'legend.frameon': False,
    'lines.linewidth': 1.2,
    'svg.fonttype': 'none',  # text stays text: it can be searched, read aloud and compared
    'svg.hashsalt': 'nadrc',
    'text.parse_math': False,  # a name may have dollars
    'xtick.color': INK,
    'ytick.color': INK,
}
# What a file says besides the picture; without a date the same picture is the same bytes.
_METADATA: dict[str, dict[str, Any]] = {
    'png': {'Software': None},
    'svg': {'Date': None, 'Creator': None},
    'pdf': {'CreationDate': None},
}
_SUPERSCRIPTS = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')
# Ticks of an axis that are all between these are plain numbers.
_PLAIN = 1e-3, 1e4


class PowerTicks(Formatter):
    """Ticks of a logarithmic axis as text: 0.01, 1, 100, or powers as 10⁻⁵ if some need them."""

    def __call__(self, value: float, pos: int | None = None) -> str:
        """Return the text of one tick."""
        return _power(value)

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """Return the texts of all ticks: all plain, or all powers if one that is seen needs it."""
        assert self.axis is not None
        begin, end = sorted(self.axis.get_view_interval())
        low, high = _PLAIN
        seen = [abs(value) for value in values if value and begin <= value <= end]
        plain = all(low <= value <= high for value in seen)
        return [f'{value:g}' if plain else _power(value) for value in values]


def plain_log_ticks(*axes: Any) -> None:
    """Let the logarithmic axes among x and y of these panels have ticks that need no markup."""
    for panel in axes:
        for axis in (panel.xaxis, panel.yaxis):
            if axis.get_scale() != 'linear':
                axis.set_major_formatter(PowerTicks())
                axis.set_minor_formatter(NullFormatter())


def render(figure: Figure, file_format: str) -> bytes:
    """Return the figure as the contents of a file of that format: png, svg, pdf."""
    buffer = BytesIO()
    with rc_context(STYLE):
        figure.savefig(buffer, format=file_format, dpi=150, metadata=_METADATA[file_format])
    return buffer.getvalue()


def _power(value: float) -> str:
    if value == 0.0:
        return '0'
    exponent = floor(log10(abs(value)) + 1e-9)
    factor = value / 10.0**exponent
    power = '10' + str(exponent).translate(_SUPERSCRIPTS)
    if abs(abs(factor) - 1.0) < 1e-6:
        return power if value > 0.0 else f'−{power}'
    return f'{factor:g}·{power}'.replace('-', '−')
