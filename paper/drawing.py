"""The look of the pictures of the reproduction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from nadrc_ros.report.roles import COLOURS, GREY, INK
from nadrc_ros.report.style import STYLE
import numpy as np

Draw = Callable[[dict[str, Any]], dict[str, Figure]]
FORMATS = ('png', 'svg')
WIDTH = 8.0  # inches
POINTS = 800
DIGITS = 5
# One role, one colour, through all pictures.
NESTED, CONVENTIONAL, GREEN, PRINTED, LITERAL, SKY = COLOURS
LOOK = {
    **STYLE,
    'legend.fontsize': 8.5,
}

__all__ = [
    'CONVENTIONAL',
    'GREEN',
    'GREY',
    'INK',
    'LITERAL',
    'NESTED',
    'PRINTED',
    'SKY',
    'common_legend',
    'in_style',
    'panels',
    'thinned',
]


def in_style(draw: Draw) -> Draw:
    """Let a function that draws the result of a section do so in the style of the house."""

    @wraps(draw)
    def styled(result: dict[str, Any]) -> dict[str, Figure]:
        with rc_context(LOOK):
            return draw(result)

    return styled


def panels(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, Any]:
    """Return a figure ``height`` inches high and its axes, always as an array (rows, columns)."""
    figure = Figure(figsize=(WIDTH, height), layout='constrained')
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def common_legend(figure: Figure, side: str, columns: int) -> None:
    """Put one legend 'upper' or 'lower' than all panels; Matplotlib has 'outside' since 3.7."""
    legend = figure.legend(loc=f'{side} center', ncol=columns)
    height = legend.get_window_extent().height / figure.bbox.height
    bottom = height if side == 'lower' else 0.0
    figure.set_layout_engine('constrained', rect=(0.0, bottom, 1.0, 1.0 - height))


def thinned(columns: dict[str, Any], points: int = POINTS) -> dict[str, list[float]]:
    """
    Return arrays of equal length as short lists for a picture, peaks kept.

    Of each stretch that goes up and down the lowest and the highest value are kept, in their
    order, so that noise and chatter keep their width; of others the first and the middle one.
    """
    size = len(columns['time'])
    stretch = max(1, -(-2 * size // points))
    return {
        name: _rounded(_kept(np.asarray(values, dtype=np.float64), stretch))
        for name, values in columns.items()
    }


def _kept(values: Any, stretch: int) -> list[float]:
    if stretch <= 2:
        return list(values)
    kept: list[float] = []
    for start in range(0, len(values), stretch):
        end = start + stretch
        part = values[start:end]
        steps = np.diff(part)
        if (steps >= 0.0).all() or (steps <= 0.0).all():
            kept += [part[0], part[len(part) // 2]]
        else:
            first, last = sorted((int(np.argmin(part)), int(np.argmax(part))))
            kept += [part[first], part[last]]
    return kept


def _rounded(values: Sequence[float]) -> list[float]:
    return [float(f'{value:.{DIGITS}g}') for value in values]
