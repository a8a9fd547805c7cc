"""The picture of the fronts that a tuning found, and of what was taken from them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from matplotlib.transforms import Bbox
from nadrc_ros.report.roles import INK, looks
from nadrc_ros.report.style import plain_log_ticks, STYLE
from nadrc_ros.scenario.units import Units, with_unit
from nadrc_ros.tuning.search.result import Tuned
from nadrc_ros.tuning.search.settings import TuneSettings
import numpy as np

_NO_UNITS = Units()
_SIZE = (7.5, 4.6)  # inches
# A decade has these ticks on a short axis, and those on one of several decades.
_MANY_TICKS, _FEW_TICKS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0), (1.0, 2.0, 5.0)
_SEVERAL_DECADES = 30.0
# An axis whose ends differ by less than this factor says by how much.
_NARROW = 1.2
# Numbers beside points, all in points of a font.
_FONT = 7.5
_DIGIT, _HEIGHT = 0.64 * _FONT, 1.2 * _FONT
_BESIDE, _OUTSIDE_THE_RING = np.array([4.0, 3.0]), np.array([8.0, 6.0])


def draw(
    found: Sequence[Tuned], title: str, tuning: TuneSettings, units: Units = _NO_UNITS
) -> Figure:
    """
    Return a figure with the front of each controller and a ring around what was taken.

    Points have the numbers that ``--choose`` takes, as far as there is room.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=_SIZE, layout='constrained')
        axis = figure.subplots()
        styles = looks(tuned.name for tuned in found)
        for tuned in found:
            colour = styles[tuned.name].colour
            efforts, values = _curve(tuned)
            # A step: between two designs of the front, the cheaper one is what there is.
            axis.step(efforts, values, '.-', where='post', color=colour, markersize=4, lw=0.9)
            x, y = efforts[tuned.choice.index], values[tuned.choice.index]
            axis.plot([x], [y], 'o', color=colour, markersize=5)
            axis.plot([x], [y], 'o', color=INK, markersize=11, fillstyle='none')
            taken = f'{tuned.name}: point {tuned.choice.index + 1}, {tuned.choice.why}'
            axis.plot([], [], 'o-', color=colour, label=taken)
        axis.set_xscale('log')
        axis.set_yscale('log')
        for scale in (axis.xaxis, axis.yaxis):
            low, high = scale.get_view_interval()
            ticks = _FEW_TICKS if high > _SEVERAL_DECADES * low else _MANY_TICKS
            scale.set_major_locator(LogLocator(subs=ticks, numticks=12))
        plain_log_ticks(axis)
        effort, objective = labels(tuning, units)
        axis.set_xlabel(f'{effort}, integral of u²' + _width(axis.get_xlim(), 'effort'))
        axis.set_ylabel(objective + _width(axis.get_ylim(), 'error'))
        figure.suptitle(title, x=0.01, ha='left', weight='bold')
        axis.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0))  # a front may be anywhere
        _number(figure, axis, found, [styles[tuned.name].colour for tuned in found])
    return figure


def labels(tuning: TuneSettings, units: Units) -> tuple[str, str]:
    """Return effort and objective as headings."""
    effort = with_unit('ISU', units.of_figure('isu'))
    objective = with_unit(tuning.objective.upper(), units.of_figure(tuning.objective))
    return effort, objective + (' without noise' if tuning.noise_free else '')


def _curve(tuned: Tuned) -> tuple[list[float], list[float]]:
    figures = [point.figures for point in tuned.front]
    return [each.isu for each in figures], [each.objective for each in figures]


def _width(limits: tuple[float, float], of: str) -> str:
    """Return what a narrow axis says of itself: it looks like more than it is."""
    low, high = limits
    if high > _NARROW * low:
        return ''
    return f' (its whole width is {100.0 * (high / low - 1.0):.2g} % of the {of})'


def _number(figure: Figure, axis: Any, found: Sequence[Tuned], colours: Iterable[str]) -> None:
    """Write the numbers of points where they cover no other: chosen, ends, then the others."""
    figure.draw_without_rendering()
    frame = axis.get_window_extent()
    taken: list[Bbox] = []
    points = []
    for tuned, colour in zip(found, colours):
        first = [tuned.choice.index, 0, len(tuned.front) - 1]
        for i, place in enumerate(zip(*_curve(tuned))):
            points.append(((i not in first, i != first[0], i), place, colour))
    for (_, other, i), place, colour in sorted(points):
        text = str(i + 1)
        away = _BESIDE if other else _OUTSIDE_THE_RING
        size = np.array([_DIGIT * len(text), _HEIGHT])
        # A falling curve passes neither above to the right nor below to the left.
        for side, across, up in ((1.0, 'left', 'bottom'), (-1.0, 'right', 'top')):
            near = side * away
            corners = np.array([near, near + side * size]) * figure.dpi / 72.0
            box = Bbox(np.sort(corners + axis.transData.transform(place), axis=0))
            inside = frame.contains(*box.min) and frame.contains(*box.max)
            if inside and not any(map(box.overlaps, taken)):
                taken.append(box)
                axis.annotate(
                    text, place, near, textcoords='offset points', ha=across, va=up,
                    size=_FONT, color=colour,
                )  # fmt: skip
                break
