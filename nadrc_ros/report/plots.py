"""The interactive plots of a report, as figures of Bokeh that ``report.js`` fills."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import inf, log10, pi

import attrs
from bokeh.models import ColumnDataSource, HoverTool, LogAxis, Range1d
from bokeh.models.annotations import BoxAnnotation
from bokeh.plotting import figure
from nadrc_ros.records.recorded_run import Array, RecordedRun
from nadrc_ros.records.states import IN_CONTROL
from nadrc_ros.report.canvas import across, axis_look, base, letter, line_look
from nadrc_ros.report.curves import Bandwidth, bandwidths, bins, command_spectrum
from nadrc_ros.report.marks import NumberedChanges
from nadrc_ros.report.roles import (
    GREY,
    GRID,
    JOINED_LOOKS,
    level_looks,
    Look,
    looks_of,
    REFERENCE,
    STATES,
    TRUTH,
)
from nadrc_ros.report.traces import Trace
from nadrc_ros.scenario.units import bracketed
import numpy as np

_MOST_MARKED = 40
_LONGEST_NAME = 9
# Decades of a spectrum, and above it those for the marks of bandwidths.
_DEEPEST, _HEADROOM = 8.0, 1.0
_MOST_BANDWIDTHS = 8
_LETTERS = 'ABCDEFGH'
# The height of a text [px]; from that share of the width on texts are on the left of their mark.
_ROW, _RIGHT_OF = 15, 0.7
_TWO_MARKS = 0.03  # of the width of a spectrum are too near to each other for two letters
# What is drawn beside a command.
_JOINED = {'applied': 'what acted, as reported', 'feed_forward': 'the feed-forward in it'}


@attrs.frozen
class Plot:
    """A figure, whether it is over the time of all others, and what to say below it."""

    figure: figure
    caption: str
    timed: bool = True


class Plotter:
    """Draws runs, each in its look, with marks where something was changed."""

    def __init__(
        self,
        runs: Mapping[str, RecordedRun],
        traces: Mapping[str, Trace],
        marked: Sequence[NumberedChanges],
    ) -> None:
        self.runs = runs
        self.looks = looks_of(runs)
        self._traces = traces
        self._marked = marked[:_MOST_MARKED]
        starts = [float(run.time[0]) for run in runs.values()]
        ends = [max(float(run.time[-1]), run.stop) for run in runs.values()]
        self.span = min(starts), max(*ends, min(starts) + 1e-3)

    def strip(self) -> Plot | None:
        """Return a row for each run with what its controller did, None where none told it."""
        rows = {name: trace.states for name, trace in self._traces.items()}
        if not any(rows.values()):
            return None
        names = list(rows)
        made = base('', 'time [s]', x_range=self._time(), y_range=Range1d(start=len(rows), end=0))
        made.height = 56 + 20 * len(rows)
        for i, spans in enumerate(rows.values()):
            for state in STATES:
                mine = [each for each in spans if each.state == state]
                made.quad(
                    left=[each.begin for each in mine],
                    right=[each.end for each in mine],
                    top=i + 0.1,
                    bottom=i + 0.9,
                    fill_color=STATES[state],
                    line_color=None,
                )
        made.yaxis.ticker = [i + 0.5 for i in range(len(names))]
        made.yaxis.major_label_overrides = {
            i + 0.5: _short(name) for i, name in enumerate(names) if len(names) > 1
        } or {0.5: 'state'}
        made.ygrid.visible = False
        self._mark(made)
        return Plot(made, 'State of the controller, as it reported it.')

    def output(self) -> Plot:
        """Return outputs, references and, hidden at first, measurements."""
        made = self._timed(self._with_unit('output y', 'output'))
        for name in self.runs:
            self._line(made, name, 'reference', Look(REFERENCE, 'dotted'), 1.4)
            self._line(made, name, 'measurement', self.looks[name], 0.7)
        for name in self.runs:
            self._line(made, name, 'output', self.looks[name])
        return Plot(made, 'Output y and the reference r that it is to follow.')

    def error(self, caption: str) -> Plot:
        """Return the errors that the figures of merit are made of."""
        return self._each('error', 'error e', caption)

    def command(self) -> Plot:
        """Return the commands, what acted and the feed-forward, with the limits that all have."""
        made = self._each('command', 'command u', '').figure
        caption = 'Command u, held until the next one.'
        for column, what in _JOINED.items():
            dash = JOINED_LOOKS[column].dash
            for name in self.runs:
                self._line(made, name, column, Look(self.looks[name].colour, dash), 1.2)
            if any(column in trace.columns for trace in self._traces.values()):
                caption += f' {dash.title()}: {what}.'
        limits = {run.history.command_limits() for run in self.runs.values()}
        for limit in limits.pop() or () if len(limits) == 1 else ():
            made.add_layout(across(limit, 'width'))
        return Plot(made, caption)

    def disturbance(self, name: str, caption: str) -> Plot | None:
        """Return the estimate of a run, level by level, over the truth; None without either."""
        run = self.runs[name]
        made = self._timed(self._with_unit('disturbance', 'truth'), [name])
        self._line(made, name, 'truth', Look(TRUTH, 'solid'), 2.4)
        levels = run.levels if len(run.levels) > 1 else []
        for level, look in zip(levels, level_looks(len(levels))):
            self._line(made, name, level, look, 1.1)
        self._line(made, name, 'estimate', self.looks[name])
        return Plot(made, caption) if made.renderers else None

    def miss(self) -> Plot | None:
        """Return the errors of the estimates of the disturbance, None where no truth is known."""
        plot = self._each('miss', 'estimate − truth', 'Error of the estimated disturbance.')
        return plot if plot.figure.renderers else None

    def spectrum(self) -> Plot | None:
        """Return the spectra of the commands with the bandwidths, None where runs are short."""
        found = {
            name: (2.0 * pi * spectrum[0][above], spectrum[1][above] / (2.0 * pi))
            for name, run in self.runs.items()
            if (spectrum := command_spectrum(run.time, run.command, run.rate)) is not None
            and (above := spectrum[1] > 0.0).any()
        }
        if not found:
            return None
        marks = [np.array([each.value]) for each in bandwidths(self.runs)]
        low, high = _extent([*(omega for omega, _ in found.values()), *marks])
        bottom, top = _extent(density for _, density in found.values())
        bottom = max(bottom, top * 10.0**-_DEEPEST)
        made = base(
            f'density of u [{bracketed(self.unit("command") or "u")}² / (rad/s)]',
            'frequency [rad/s]; above: [Hz]',
            x_range=Range1d(start=low, end=high),
            y_range=Range1d(start=0.7 * bottom, end=top * 10.0**_HEADROOM),
            x_axis_type='log',
            y_axis_type='log',
        )
        made.extra_x_ranges = {'hertz': Range1d(start=low / (2.0 * pi), end=high / (2.0 * pi))}
        made.add_layout(LogAxis(x_range_name='hertz', **axis_look()), 'above')
        for name, (omega, density) in found.items():
            source = ColumnDataSource({'x': omega, 'y': density})
            line = made.line('x', 'y', source=source, **line_look(self.looks[name]))
            line.tags = [list(self.runs).index(name)]
        made.add_tools(HoverTool(tooltips=[('', '@x{0.0000 a} rad/s: @y')], mode='mouse'))
        said = self._mark_bandwidths(made, log10(low), log10(high))
        text = 'Power spectral density of the command (Welch) on logarithmic axes.'
        return Plot(made, f'{text} {said}'.strip(), timed=False)

    def _mark_bandwidths(self, made: figure, low: float, high: float) -> str:
        """
        Mark bandwidths by letters above the curve, those near to each other by one; list them.

        Of many those of one run are marked while it stands out.
        """
        found = sorted(bandwidths(self.runs), key=lambda one: one.value)
        if len(found) <= _MOST_BANDWIDTHS:
            marks = _grouped(found, self.runs, low, high)
            for letter_, (value, _) in zip(_LETTERS, marks):
                made.add_layout(across(value, 'height'))
                made.add_layout(letter(value, letter_))
            named = (f'{name} {", ".join(texts)}' for name, (_, texts) in zip(_LETTERS, marks))
            return f'Bandwidths: {"; ".join(named)}.' if marks else ''
        for i, (name, run) in enumerate(self.runs.items()):
            own = sorted(bandwidths({name: run}), key=lambda one: one.value)
            for k, (value, texts) in enumerate(_grouped(own, [name], low, high)):
                said = letter(value, ', '.join(texts))
                said.y_offset = -_ROW * k
                if log10(value) - low > _RIGHT_OF * (high - low):
                    said.text_align, said.x_offset = 'right', -said.x_offset
                for mark in (across(value, 'height'), said):
                    mark.tags, mark.visible = ['of', i], False
                    made.add_layout(mark)
        return 'Point at the name of a run to see its bandwidths marked.'

    def latency(self) -> Plot | None:
        """Return histograms of the time from measurement to command, None where not recorded."""
        return self._histogram(
            {name: 1e3 * s.latency for name, s in self.runs.items()},
            'from measurement to command [ms]',
            'Share of the samples with this time from a measurement to the command in reply.',
        )

    def period(self) -> Plot | None:
        """Return histograms of the time between measurements, None where not recorded."""
        plot = self._histogram(
            {name: 1e3 * s.periods for name, s in self.runs.items()},
            'between measurements [ms]',
            'Share of the samples with this time from a measurement to the next; dotted: nominal.',
        )
        if plot is not None:
            for rate in {run.rate for run in self.runs.values()}:
                plot.figure.add_layout(across(1e3 / rate, 'height'))
        return plot

    def _histogram(self, columns: Mapping[str, Array], title: str, caption: str) -> Plot | None:
        columns = {name: values for name, values in columns.items() if values.size}
        if not columns:
            return None
        edges = bins(columns.values())
        made = base(
            'share of samples [%]',
            title,
            x_range=Range1d(start=edges[0], end=edges[-1]),
            x_axis_type='linear',
        )
        for name, values in columns.items():
            share = 100.0 * np.histogram(values, edges)[0] / values.size
            # An outline: bars of twelve runs would hide each other.
            x, y = np.repeat(edges, 2), np.concatenate(([0.0], np.repeat(share, 2), [0.0]))
            source = ColumnDataSource({'x': x, 'y': y})
            look = self.looks[name]
            area = {'fill_color': look.colour, 'fill_alpha': 0.2}
            for drawn in (
                made.varea('x', y2='y', y1=0.0, source=source, **area),
                made.line('x', 'y', source=source, **line_look(look)),
            ):
                drawn.tags = [list(self.runs).index(name)]
        beyond = sum(int((values > edges[-1]).sum()) for values in columns.values())
        more = f' {beyond} samples above {edges[-1]:.3g} ms are not shown.' if beyond else ''
        return Plot(made, caption + more, timed=False)

    def _each(self, column: str, title: str, caption: str) -> Plot:
        made = self._timed(self._with_unit(title, column))
        for name in self.runs:
            self._line(made, name, column, self.looks[name])
        return Plot(made, caption)

    def unit(self, column: str) -> str:
        """Return the unit of a signal, if it is the same in all runs."""
        units = {run.unit(column) for run in self.runs.values()}
        return units.pop() if len(units) == 1 else ''

    def _with_unit(self, title: str, column: str) -> str:
        unit = self.unit(column)
        return f'{title} [{unit}]' if unit else title

    def _line(self, made: figure, name: str, column: str, look: Look, width: float = 1.5) -> None:
        """Add a line that the page fills with a column of a run, if it has that."""
        if column in self._traces[name].columns:
            source = ColumnDataSource({'x': [], 'y': []})
            line = made.line('x', 'y', source=source, **line_look(look, width))
            line.tags = [list(self.runs).index(name), column, column in ('command', *JOINED_LOOKS)]
            line.visible = column != 'measurement'

    def _timed(self, title: str, shaded: Iterable[str] = ()) -> figure:
        """Return a figure over time; behind it is what the controllers of runs did."""
        made = base(title, 'time [s]', x_range=self._time(), y_range=Range1d(start=0.0, end=1.0))
        for name in shaded if len(self.runs) > 1 else self.runs:
            for each in self._traces[name].states:
                if each.state != IN_CONTROL:
                    made.add_layout(
                        BoxAnnotation(
                            left=each.begin, right=each.end, line_color=None, level='underlay',
                            fill_color=STATES[each.state], fill_alpha=0.5,
                        )
                    )  # fmt: skip
        gaps = (gap for trace in self._traces.values() for gap in trace.gaps)
        for begin, end in dict.fromkeys((gap.begin, gap.end) for gap in gaps):
            made.add_layout(
                BoxAnnotation(
                    left=begin, right=end, line_color=None, level='underlay', fill_color=GRID,
                    fill_alpha=0.5, hatch_pattern='/', hatch_color=GREY, hatch_alpha=0.35,
                    hatch_weight=0.5,
                )
            )  # fmt: skip
        self._mark(made)
        return made

    def _time(self) -> Range1d:
        return Range1d(start=self.span[0], end=self.span[1])

    def _mark(self, made: figure) -> None:
        for mark in self._marked:
            made.add_layout(across(mark.time, 'height'))
            made.add_layout(letter(mark.time, str(mark.number)))


def _grouped(
    found: Sequence[Bandwidth], runs: Collection[str], low: float, high: float
) -> list[tuple[float, list[str]]]:
    """Return where to mark bandwidths, and the texts of those that are marked there."""
    marks: list[tuple[float, list[str]]] = []
    for each in found:
        whose = '' if len(each.runs) >= len(runs) else f' of {", ".join(each.runs)}'
        begin = f' from {each.since:.4g} s' if each.since else ''
        text = f'{", ".join(each.names)}{whose} at {each.value:g} rad/s{begin}'
        if marks and log10(each.value / marks[-1][0]) < _TWO_MARKS * (high - low):
            marks[-1][1].append(text)
        else:
            marks.append((each.value, [text]))
    return marks


def _short(name: str) -> str:
    half = _LONGEST_NAME // 2  # names often begin, or end, alike
    return name if len(name) <= _LONGEST_NAME else f'{name[:half]}…{name[-half:]}'


def _extent(columns: Iterable[Array]) -> tuple[float, float]:
    low, high = inf, -inf
    for values in columns:
        low, high = min(low, float(values.min())), max(high, float(values.max()))
    return low, high if high > low else 2.0 * low
