"""The picture of the fronts: tracking against effort, with the designs that were taken."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from nadrc_ros.report.picture import COLOURS, INK, STYLE
from nadrc_ros.tuning.search.result import Tuned

SIZE = (7.5, 4.6)  # inches
# A decade has these ticks on a short axis, and those on one of several decades.
MANY, FEW = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0), (1.0, 2.0, 5.0)
SEVERAL = 30.0


def draw(found: Sequence[Tuned], title: str, objective: str) -> Figure:
    """Return a figure with the front of each controller and a ring around what was taken."""
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE, layout='constrained')
        axis = figure.subplots()
        for tuned, colour in zip(found, cycle(COLOURS)):
            efforts = [point.figures.isu for point in tuned.front]
            values = [point.figures.objective for point in tuned.front]
            # A step: between two designs of the front, the cheaper one is what there is.
            axis.step(efforts, values, '.-', where='post', color=colour, markersize=4, lw=0.9)
            x, y = efforts[tuned.choice.index], values[tuned.choice.index]
            axis.plot([x], [y], 'o', color=colour, markersize=5)
            axis.plot([x], [y], 'o', color=INK, markersize=11, fillstyle='none')
            axis.plot([], [], 'o-', color=colour, label=f'{tuned.name}: {tuned.choice.why}')
        axis.set_xscale('log')
        axis.set_yscale('log')
        for one in (axis.xaxis, axis.yaxis):
            low, high = one.get_view_interval()
            subs = FEW if high > SEVERAL * low else MANY
            one.set_major_locator(LogLocator(subs=subs, numticks=12))
            one.set_major_formatter('{x:g}')
            one.set_minor_formatter(NullFormatter())
        axis.set_xlabel('ISU, integral of u²')
        axis.set_ylabel(objective)
        axis.set_title(title, weight='bold')
        axis.legend(frameon=False)
    return figure
