"""The picture of an experiment: outputs, errors, commands and disturbance estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from textwrap import wrap
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from nadrc_ros.records.angles import unwrapped
from nadrc_ros.records.recorded_run import Array, RecordedRun
from nadrc_ros.report.curves import frame
from nadrc_ros.report.marks import Mark, numbered
from nadrc_ros.report.roles import GREY, looks_of, REFERENCE, TRUTH
from nadrc_ros.report.style import STYLE
import numpy as np

# More disturbance estimates share a panel.
_MOST_APART = 3
_THICKEST, _THINNEST = 1.8, 0.9
# All in inches.
_WIDTH, _LEFT, _RIGHT = 10.0, 0.8, 9.85
_ROW, _TITLE, _HEAD, _FOOT, _LINE = 0.78, 0.37, 0.42, 0.55, 0.17
_LETTER, _LEGEND_LINE, _LEGEND_KEY = 0.068, 0.2, 0.6
_ERROR_ROW = 1.4  # of it in rows
_OFFSET_PAD = 7.0  # points
_MOST_LISTED = 12
_REFERENCE: dict[str, Any] = {'color': REFERENCE, 'linestyle': (0, (4, 3)), 'linewidth': 1.0}
_TRUTH: dict[str, Any] = {'color': TRUTH, 'linewidth': 1.7}


def draw(traces: Mapping[str, RecordedRun], title: str) -> Figure:
    """
    Return a figure with a row each for output, error and command, and for the disturbance.

    Up to three controllers have a row each for the disturbance estimate against the truth, which
    differs between them because it depends on the command; more share one for their errors. A
    start that would make all the rest look flat runs out of its frame. Changes of parameters are
    numbered, and listed below.
    """
    marks = [each.mark() for each in numbered({name: t.changes for name, t in traces.items()})]
    with rc_context(STYLE):
        together = len(traces) > _MOST_APART
        heights = [1.0, _ERROR_ROW, 1.0, *[1.0] * (1 if together else len(traces))]
        styles = looks_of(traces)
        keys = {'reference': Line2D([], [], **_REFERENCE)}
        keys |= {} if together else {'true disturbance': Line2D([], [], **_TRUTH)}
        keys |= {
            name: Line2D([], [], color=look.colour, linestyle=look.dash, linewidth=2.0)
            for name, look in styles.items()
        }
        column = _LEGEND_KEY + _LETTER * max(map(len, keys))
        columns = max(1, int((_RIGHT - _LEFT) / column))
        listed = _listed(marks)
        head = _HEAD + ceil(len(keys) / columns) * _LEGEND_LINE + (_LINE if marks else 0.0)
        foot = _FOOT + len(listed) * _LINE
        height = head + sum(heights) * _ROW + len(heights) * _TITLE + foot
        figure = Figure(figsize=(_WIDTH, height))
        axes = list(figure.subplots(len(heights), 1, sharex=True, height_ratios=heights))
        figure.subplots_adjust(
            left=_LEFT / _WIDTH,
            right=_RIGHT / _WIDTH,
            top=1 - (head + _TITLE) / height,
            bottom=foot / height,
            hspace=_TITLE * len(heights) / (_ROW * sum(heights)),
        )
        _draw_signals(axes[:3], traces, styles)
        if together:
            _draw_together(axes[3], traces, styles)
        else:
            _draw_apart(axes[3:], traces, styles)
        for axis in axes:
            axis.yaxis.get_offset_text().set(x=-0.006, ha='right')  # not where title and marks are
            axis.yaxis.OFFSETTEXTPAD = _OFFSET_PAD
            if not any(np.isfinite(line.get_ydata()).any() for line in axis.get_lines()):
                axis.text(0.5, 0.5, 'not recorded', transform=axis.transAxes, ha='center')
        axes[-1].set_xlabel('time [s]')
        axes[-1].set_xlim(_span(traces))
        _mark(axes, marks)
        for k, line in enumerate(listed, 1):
            figure.text(_LEFT / _WIDTH, (foot - _FOOT - k * _LINE + 0.1) / height, line, size=8.5)
        figure.suptitle(
            title, x=_LEFT / _WIDTH, y=1 - 0.12 / height, ha='left', va='top', weight='bold'
        )
        figure.legend(
            [*keys.values()],
            [*keys],
            loc='upper left',
            bbox_to_anchor=(_LEFT / _WIDTH - 0.005, 1 - 0.36 / height),
            ncol=columns,
            borderaxespad=0.0,
        )
    return figure


def _draw_signals(axes: Sequence[Any], traces: Mapping[str, RecordedRun], styles: Any) -> None:
    lines = {name: turning(trace) for name, trace in traces.items()}
    errors = {name: line['reference'] - line['output'] for name, line in lines.items()}
    busiest_first = sorted(traces, key=lambda name: -_variation(traces[name]))
    for name, width in zip(busiest_first, np.linspace(_THICKEST, _THINNEST, len(traces))):
        # The busiest lines lie lowest and are the thickest, or they would hide the others.
        trace, look = traces[name], _look(styles[name], width)
        axes[0].plot(trace.time, lines[name]['output'], **look)
        axes[1].plot(trace.time, errors[name], **look)
        axes[2].step(trace.time, trace.command, where='post', **look)
    first, line = next(iter(traces.values())), next(iter(lines.values()))
    axes[0].plot(first.time, line['reference'], **_REFERENCE)
    axes[0].set_title('output y and reference r' + unit(traces, 'output'))
    axes[1].set_title('tracking error r − y' + unit(traces, 'output'))
    axes[2].set_title('command u' + unit(traces, 'command'))
    _frame(axes[1], [(t.time, errors[name]) for name, t in traces.items()])
    _frame(axes[2], [(t.time, t.command) for t in traces.values()])


def _draw_apart(axes: Sequence[Any], traces: Mapping[str, RecordedRun], styles: Any) -> None:
    truths = [(t.time, t.total_disturbance) for t in traces.values()]
    estimates = [(t.time, t.disturbance_estimate) for t in traces.values()]
    for axis, (name, trace) in zip(axes, traces.items()):
        axis.plot(trace.time, trace.total_disturbance, **_TRUTH)
        axis.plot(trace.time, trace.disturbance_estimate, **_look(styles[name], _THINNEST))
        axis.set_title(f'total disturbance and its estimate: {name}' + unit(traces, 'truth'))
        _frame(axis, truths + estimates)


def _draw_together(axis: Any, traces: Mapping[str, RecordedRun], styles: Any) -> None:
    """Draw how far the estimates are off, or the estimates where nobody knows the truth."""
    known = any(np.isfinite(t.total_disturbance).any() for t in traces.values())
    lines = {
        name: (t.time, t.disturbance_estimate - (t.total_disturbance if known else 0.0))
        for name, t in traces.items()
    }
    for name, line in lines.items():
        axis.plot(*line, **_look(styles[name], _THINNEST))
    of = ' − true disturbance' if known else ''
    axis.set_title(f'disturbance estimate{of}' + unit(traces, 'truth'))
    _frame(axis, list(lines.values()))


def unit(traces: Mapping[str, RecordedRun], column: str) -> str:
    """Return the unit of a signal as a title ends with it, '' if they have none in common."""
    units = {trace.unit(column) for trace in traces.values()}
    common = units.pop() if len(units) == 1 else ''
    return f' [{common}]' if common else ''


def _look(style: Any, width: float) -> dict[str, Any]:
    return {'color': style.colour, 'linestyle': style.dash, 'linewidth': width}


def turning(trace: RecordedRun) -> dict[str, Array]:
    """Return output and reference; of an angle they go on where it wraps."""
    columns = {'output': trace.output, 'reference': trace.reference}
    return unwrapped(columns | {'measurement': trace.output}, trace.measurement_period)


def _frame(axis: Any, lines: Sequence[tuple[Array, Array]]) -> None:
    """Cut such a start off, and say so."""
    limits = frame(lines)
    if limits is not None:
        axis.set_ylim(limits)
        axis.set_title(axis.get_title('left') + '  (the start is cut off)')


def _variation(trace: RecordedRun) -> float:
    return float(np.nansum(np.abs(np.diff(trace.command))))


def _span(traces: Mapping[str, RecordedRun]) -> tuple[float, float]:
    times = np.concatenate([trace.time for trace in traces.values()])
    low, high = float(times.min()), float(times.max())
    return low, high if high > low else low + 1.0


def _listed(marks: Sequence[Mark]) -> list[str]:
    """Return the lines below the picture that say what the numbers mean."""
    width = int((_RIGHT - _LEFT) / _LETTER)
    lines = [
        line
        for number, mark in enumerate(marks[:_MOST_LISTED], 1)
        for line in wrap(
            f'{number} at {mark.time:.4g} s: {mark.label}', width, subsequent_indent='   '
        )
    ]
    more = len(marks) - _MOST_LISTED
    return [*lines, f'and {more} more'] if more > 0 else lines


def _mark(axes: Sequence[Any], marks: Sequence[Mark]) -> None:
    """Draw lines through all panels, and numbers above: one for marks that are near."""
    for axis in axes:
        for mark in marks:
            axis.axvline(mark.time, color=GREY, linewidth=0.9, linestyle=':')
    low, high = axes[0].get_xlim()
    letter = _LETTER / (_RIGHT - _LEFT) * (high - low)
    if marks:
        axes[0].set_title(axes[0].get_title('left'), pad=6.0 + 72.0 * _LINE)
    near: list[list[int]] = []
    for number, mark in enumerate(marks, 1):
        if near:
            begin, end = marks[near[-1][0] - 1].time, near[-1][-1]
            if mark.time < begin + letter * (1.5 + len(_numbers(near[-1][0], end))):
                near[-1].append(number)
                continue
        near.append([number])
    for numbers in near:
        axes[0].annotate(
            _numbers(numbers[0], numbers[-1]),
            (marks[numbers[0] - 1].time, 1.0),
            xycoords=axes[0].get_xaxis_transform(),
            xytext=(0, 1),
            textcoords='offset points',
            fontsize=8.5,
        )


def _numbers(first: int, last: int) -> str:
    return str(first) if first == last else f'{first}–{last}'
