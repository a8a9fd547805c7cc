"""The picture of an experiment: outputs, errors, commands and disturbance estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from math import ceil
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from nadrc_ros.records.angles import unwrapped
from nadrc_ros.records.recorded_run import Array, RecordedRun
from nadrc_ros.report.curves import frame
from nadrc_ros.report.marks import Mark
from nadrc_ros.report.roles import GREY, GRID, INK, looks
from nadrc_ros.simulation.simulate import Result
import numpy as np

# One controller's run, simulated or recorded.
Drawn = Result | RecordedRun
_THICKEST, _THINNEST = 1.8, 0.9
_LEGEND_COLUMNS = 6
_WIDTH = 10.0  # inches
_ROW, _HEAD, _LEGEND_LINE, _FOOT = 1.75, 0.75, 0.2, 0.55
STYLE = {
    'agg.path.chunksize': 10000,
    'axes.edgecolor': GREY,
    'axes.grid': True,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.titlelocation': 'left',
    'axes.titlesize': 9.5,
    'font.size': 9,
    'grid.color': GRID,
    'grid.linewidth': 0.6,
    'lines.linewidth': 1.2,
    'text.parse_math': False,  # a name may have dollars
    'xtick.color': INK,
    'ytick.color': INK,
}


def draw(traces: Mapping[str, Drawn], title: str, marks: Sequence[Mark] = ()) -> Figure:
    """
    Return a figure with a row each for output, error and command, and one per controller.

    The last rows hold the disturbance estimate of a controller against the truth, which differs
    between controllers because it depends on the command. A start that would make all the rest
    look flat runs out of its frame.
    """
    lines = {name: turning(trace) for name, trace in traces.items()}
    errors = {name: line['reference'] - line['output'] for name, line in lines.items()}
    with rc_context(STYLE):
        rows = 3 + len(traces)
        head = _HEAD + ceil((2 + len(traces)) / _LEGEND_COLUMNS) * _LEGEND_LINE
        height = head + rows * _ROW + _FOOT
        figure = Figure(figsize=(_WIDTH, height))
        axes = list(figure.subplots(rows, 1, sharex=True))
        styles = looks(traces)
        busiest_first = sorted(traces, key=lambda name: -_variation(traces[name]))
        for name, width in zip(busiest_first, np.linspace(_THICKEST, _THINNEST, len(traces))):
            # The busiest lines lie lowest and are the thickest, or they would hide the others.
            trace = traces[name]
            look = {'color': styles[name].colour, 'linestyle': styles[name].dash}
            look |= {'linewidth': width}
            axes[0].plot(trace.time, lines[name]['output'], **look)
            axes[1].plot(trace.time, errors[name], **look)
            axes[2].step(trace.time, trace.command, where='post', **look)
        first, line = next(iter(traces.values())), next(iter(lines.values()))
        axes[0].plot(
            first.time, line['reference'], color=INK, linestyle=(0, (4, 3)), linewidth=1.0
        )
        axes[0].set_title('output y and reference r')
        axes[1].set_title('tracking error r − y')
        axes[2].set_title('command u')
        _frame(axes[1], [(t.time, errors[name]) for name, t in traces.items()])
        _frame(axes[2], [(t.time, t.command) for t in traces.values()])
        truths = [(t.time, t.total_disturbance) for t in traces.values()]
        estimates = [(t.time, t.disturbance_estimate) for t in traces.values()]
        for axis, (name, trace) in zip(axes[3:], traces.items()):
            axis.plot(trace.time, trace.disturbance_estimate, color=styles[name].colour)
            axis.plot(trace.time, trace.total_disturbance, color=INK, linewidth=0.9)
            axis.set_title(f'total disturbance and its estimate: {name}')
            _frame(axis, truths + estimates)
        axes[-1].set_xlabel('time [s]')
        axes[-1].set_xlim(_span(traces))
        _mark(axes, marks)
        figure.subplots_adjust(
            left=0.08,
            right=0.985,
            top=1 - head / height,
            bottom=_FOOT / height,
            hspace=0.36,
        )
        figure.suptitle(title, x=0.08, y=1 - 0.12 / height, ha='left', va='top', weight='bold')
        handles = [Line2D([], [], color=INK, linestyle=(0, (4, 3)), linewidth=1.0)]
        handles += [Line2D([], [], color=INK, linewidth=0.9)]
        handles += [
            Line2D([], [], color=look.colour, linestyle=look.dash, linewidth=2.0)
            for look in styles.values()
        ]
        figure.legend(
            handles,
            ['reference', 'true disturbance', *traces],
            loc='upper left',
            bbox_to_anchor=(0.075, 1 - 0.33 / height),
            ncol=_LEGEND_COLUMNS,
            frameon=False,
            borderaxespad=0.0,
        )
    return figure


def render(figure: Figure, file_format: str) -> bytes:
    """Return the figure as the contents of a file of that format: png, svg, pdf."""
    buffer = BytesIO()
    with rc_context(STYLE):
        figure.savefig(buffer, format=file_format, dpi=150)
    return buffer.getvalue()


def turning(trace: Drawn) -> dict[str, Array]:
    """Return output and reference; of an angle they go on where it wraps."""
    columns = {'output': trace.output, 'reference': trace.reference}
    return unwrapped(columns | {'measurement': trace.output}, trace.measurement_period)


def _frame(axis: Any, lines: Sequence[tuple[Array, Array]]) -> None:
    """Cut such a start off, and say so."""
    limits = frame(lines)
    if limits is not None:
        axis.set_ylim(limits)
        axis.set_title(axis.get_title('left') + '  (the start is cut off)')


def _variation(trace: Drawn) -> float:
    return float(np.nansum(np.abs(np.diff(trace.command))))


def _span(traces: Mapping[str, Drawn]) -> tuple[float, float]:
    times = np.concatenate([trace.time for trace in traces.values()])
    low, high = float(times.min()), float(times.max())
    return low, high if high > low else low + 1.0


def _mark(axes: Sequence[Any], marks: Sequence[Mark]) -> None:
    for mark in marks:
        for axis in axes:
            axis.axvline(mark.time, color=INK, linewidth=0.9, linestyle=':')
        axes[0].annotate(
            mark.label,
            (mark.time, 1.0),
            xycoords=axes[0].get_xaxis_transform(),
            xytext=(3, 3),
            textcoords='offset points',
            fontsize=8.5,
            color=INK,
        )
