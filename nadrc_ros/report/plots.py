"""The interactive plots of a report, as figures of Plotly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import cycle
from math import pi
from typing import Any

import attrs
from nadrc_ros.records.recorded_run import Array, RecordedRun
from nadrc_ros.report.curves import bandwidths, bins, command_spectrum, frame, kept
from nadrc_ros.report.marks import NumberedChanges
from nadrc_ros.report.roles import COLOURS, GREY, INK
import numpy as np
from plotly import graph_objects as go

# Points of all lines of a page together, some 21 bytes each.
_MOST_POINTS = 150_000
_FEWEST_POINTS = 1_000
_MOST_MARKED = 40
_HEIGHT = 300  # px
_GRID_COLOUR = '#e4e4e4'
_FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"
_DASHES = ('solid', 'solid', 'dash', 'dash', 'dashdot', 'dashdot')
_REFERENCE_LINE = {'color': INK, 'width': 1.2, 'dash': 'dot'}
_LEVEL_DASHES = ('dot', 'dash', 'dashdot', 'longdash', 'longdashdot', 'solid')
_LEVEL_COLOURS = ('#56B4E9', '#D55E00', '#CC79A7', '#004D40', '#E69F00', '#0072B2')


@attrs.frozen
class Plot:
    """A figure, whether its x axis is the time of all others, and what to say below it."""

    figure: go.Figure
    timed: bool = True
    note: str = ''


class Plotter:
    """Draws runs, each in its colour, with marks where something was changed."""

    def __init__(self, runs: Mapping[str, RecordedRun], marked: Sequence[NumberedChanges]) -> None:
        self.runs = runs
        self._marked = marked[:_MOST_MARKED]
        self._looks = {
            name: {'color': colour, 'dash': dash, 'width': 1.5}
            for name, colour, dash in zip(runs, cycle(COLOURS), cycle(_DASHES))
        }
        lines = sum(6 + len(run.levels) for run in runs.values())
        self._points = max(_FEWEST_POINTS, _MOST_POINTS // lines)
        ends = [float(run.time[-1]) for run in runs.values()]
        starts = [float(run.time[0]) for run in runs.values()]
        self._span = min(starts), max(*ends, min(starts) + 1e-3)

    def colour(self, name: str) -> str:
        """Return the colour of a run."""
        return str(self._looks[name]['color'])

    def output(self) -> Plot:
        """Return outputs, references and, hidden at first, measurements."""
        figure = self._timed('output y and reference r')
        first = next(iter(self.runs))
        for name, run in self.runs.items():
            one = {'legendgroup': 'reference', 'showlegend': name == first}
            self._line(figure, run, 'reference', run.column('reference'), _REFERENCE_LINE, **one)
        true = [name for name, run in self.runs.items() if run.knows_output]
        for name, run in self.runs.items():
            label = name if name in true else f'{name}, measurement'
            self._line(figure, run, label, run.output, self._looks[name])
        for name, run in self.runs.items():
            if name not in true:
                continue  # the measurement is there already
            one = {'legendgroup': 'measurement', 'showlegend': name == true[0]}
            thin = {'color': self.colour(name), 'width': 0.8}
            measured = run.columns['measurement']
            self._line(figure, run, 'measurement', measured, thin, visible='legendonly', **one)
        return Plot(figure)

    def error(self) -> Plot:
        """Return the errors that the figures of merit are made of."""
        return self._each('error e', {name: s.error for name, s in self.runs.items()})

    def command(self) -> Plot:
        """Return the commands, held over each period."""
        return self._each(
            'command u', {name: s.command for name, s in self.runs.items()}, shape='hv'
        )

    def disturbance(self, name: str) -> Plot:
        """Return the estimate of a run, level by level, and the truth where there is one."""
        run = self.runs[name]
        figure = self._timed('total disturbance')
        lines = {
            'truth': (run.total_disturbance, {'color': INK, 'width': 1.2}),
            'estimate': (run.column('disturbance_estimate'), self._looks[name]),
        }
        if len(run.levels) > 1:
            for level, colour, dash in zip(
                run.levels, cycle(_LEVEL_COLOURS), cycle(_LEVEL_DASHES)
            ):
                look = {'color': colour, 'width': 1.2, 'dash': dash}
                lines[level.replace('_', ' ')] = run.columns[level], look
        shown = {label: line for label, line in lines.items() if np.isfinite(line[0]).any()}
        for label, (values, look) in shown.items():
            self._line(figure, run, label, values, look)
        return self._framed(figure, [(run.time, values) for values, _ in shown.values()])

    def spectrum(self) -> Plot | None:
        """Return the spectra of the commands with the bandwidths, None where runs are short."""
        figure = base('density of u [u²/Hz]', 'frequency [Hz]')
        figure.update_xaxes(type='log', exponentformat='power', dtick=1)
        figure.update_yaxes(type='log', exponentformat='power', dtick=1)
        for name, run in self.runs.items():
            found = command_spectrum(run.time, run.command, run.rate)
            if found is not None and (found[1] > 0.0).any():
                figure.add_scatter(
                    x=found[0],
                    y=np.where(found[1] > 0.0, found[1], np.nan),
                    mode='lines',
                    name=escape(name, quote=False),
                    line={'color': self.colour(name), 'width': 1.5},
                    hovertemplate='%{x:.4g} Hz: %{y:.4g}',
                )
        if not figure.data:
            return None
        for each in bandwidths(self.runs):
            common = len(each.runs) == len(self.runs)
            colour = INK if common else self.colour(next(iter(each.runs)))
            frequency = each.value / (2.0 * pi)
            figure.add_vline(frequency, line={'color': colour, 'width': 1, 'dash': 'dash'})
            figure.add_annotation(
                x=np.log10(frequency),
                y=0.02,
                yref='paper',
                text=f'{", ".join(each.names)}: {each.value:g} rad/s',
                font={'color': colour, 'size': 11},
                bgcolor='rgba(255,255,255,0.8)',
                textangle=-90,
                xanchor='right',
                yanchor='bottom',
                showarrow=False,
            )
        return Plot(figure, timed=False)

    def latency(self) -> Plot | None:
        """Return histograms of the time from measurement to command, None where not recorded."""
        return self._histogram(
            {name: 1e3 * s.latency for name, s in self.runs.items()},
            'from measurement to command [ms]',
        )

    def period(self) -> Plot | None:
        """Return histograms of the time between measurements, None where not recorded."""
        plot = self._histogram(
            {name: 1e3 * s.periods for name, s in self.runs.items()},
            'between measurements [ms]',
        )
        if plot is not None:
            for rate in {run.rate for run in self.runs.values()}:
                plot.figure.add_vline(1e3 / rate, line={'color': INK, 'width': 1, 'dash': 'dot'})
        return plot

    def _histogram(self, columns: Mapping[str, Array], title: str) -> Plot | None:
        columns = {name: values for name, values in columns.items() if values.size}
        if not columns:
            return None
        edges = bins(columns.values())
        figure = base('share of samples [%]', title)
        for name, values in columns.items():
            counts, _ = np.histogram(values, edges)
            figure.add_bar(
                x=0.5 * (edges[:-1] + edges[1:]),
                y=100.0 * counts / values.size,
                width=np.diff(edges),
                name=escape(name, quote=False),
                marker={'color': self.colour(name), 'opacity': 0.65, 'line': {'width': 0}},
                hovertemplate='%{x:.3g} ms: %{y:.3g} %',
            )
        figure.update_layout(barmode='overlay', bargap=0)
        beyond = sum(int((values > edges[-1]).sum()) for values in columns.values())
        note = f'{beyond} beyond {edges[-1]:.3g} ms are not drawn.' if beyond else ''
        return Plot(figure, timed=False, note=note)

    def _each(self, title: str, columns: Mapping[str, Array], shape: str = 'linear') -> Plot:
        figure = self._timed(title)
        for name, values in columns.items():
            look = {**self._looks[name], 'shape': shape}
            self._line(figure, self.runs[name], name, values, look)
        lines = [(self.runs[name].time, values) for name, values in columns.items()]
        return self._framed(figure, lines)

    def _framed(self, figure: go.Figure, lines: Sequence[tuple[Array, Array]]) -> Plot:
        limits = frame(lines) if lines else None
        if limits is None:
            return Plot(figure)
        figure.update_yaxes(range=limits)
        return Plot(figure, note='The start is cut off; a double click shows all of it.')

    def _line(
        self, figure: go.Figure, run: RecordedRun, name: str, values: Array, look: Any, **more: Any
    ) -> None:
        chosen = kept(values, self._points)
        figure.add_scatter(
            x=run.time[chosen],
            y=values[chosen],
            mode='lines' if len(chosen) > 1 else 'markers',
            name=escape(name, quote=False),
            line=look,
            hovertemplate='%{y:.6g}',
            **more,
        )

    def _timed(self, title: str) -> go.Figure:
        figure = base(title, 'time [s]')
        figure.update_xaxes(range=self._span)
        figure.update_layout(hovermode='x unified')
        for mark in self._marked:
            figure.add_vline(mark.time, line={'color': INK, 'width': 1, 'dash': 'dot'})
            figure.add_annotation(
                x=mark.time, y=1.0, yref='paper', text=str(mark.number), showarrow=False,
                xanchor='left', yanchor='top', xshift=2, bgcolor='rgba(255,255,255,0.8)',
            )  # fmt: skip
        return figure


def base(y: str, x: str) -> go.Figure:
    """Return an empty figure in the style of the house."""
    figure = go.Figure()
    figure.update_layout(
        template='none',
        height=_HEIGHT,
        margin={'l': 62, 'r': 8, 't': 34, 'b': 44},
        font={'family': _FONT, 'size': 12, 'color': INK},
        legend={'orientation': 'h', 'x': 0, 'y': 1.02, 'yanchor': 'bottom', 'xanchor': 'left'},
        showlegend=True,
        dragmode='zoom',
        hoverlabel={'font': {'family': _FONT}},
    )
    axis = {'gridcolor': _GRID_COLOUR, 'zeroline': False, 'linecolor': GREY, 'showline': True}
    figure.update_xaxes(title={'text': x, 'standoff': 6}, **axis)
    figure.update_yaxes(title={'text': y, 'standoff': 4}, automargin=True, **axis)
    return figure
