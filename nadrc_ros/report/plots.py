"""The interactive plots of a report, as figures of Plotly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import cycle
from typing import Any

import attrs
from nadrc_ros.report.columns import Array
from nadrc_ros.report.figure import COLOURS, frame, GREY, INK
from nadrc_ros.report.moments import Moment
from nadrc_ros.report.subject import Subject
from nadrc_ros.report.thinning import kept
import numpy as np
from plotly import graph_objects as go

# Points of all lines of a page together, some 21 bytes each.
POINTS = 150_000
FEWEST = 1_000
MARKED = 40
HEIGHT = 300  # px
GRID = '#e4e4e4'
FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"
DASHES = ('solid', 'solid', 'dash', 'dash', 'dashdot', 'dashdot')
REFERENCE = {'color': INK, 'width': 1.2, 'dash': 'dot'}
LEVELS = ('dot', 'dash', 'dashdot', 'longdash', 'longdashdot', 'solid')
LEVEL_COLOURS = ('#56B4E9', '#D55E00', '#CC79A7', '#004D40', '#E69F00', '#0072B2')


@attrs.frozen
class Plot:
    """A figure, whether its x axis is the time of all others, and what to say below it."""

    figure: go.Figure
    timed: bool = True
    note: str = ''


class Plotter:
    """Draws runs, each in its colour, with the moments at which something was changed."""

    def __init__(self, subjects: Mapping[str, Subject], moments: Sequence[Moment]) -> None:
        self.subjects = subjects
        self._moments = moments[:MARKED]
        self._looks = {
            name: {'color': colour, 'dash': dash, 'width': 1.5}
            for name, colour, dash in zip(subjects, cycle(COLOURS), cycle(DASHES))
        }
        lines = sum(6 + len(subject.levels) for subject in subjects.values())
        self._points = max(FEWEST, POINTS // lines)
        ends = [float(subject.time[-1]) for subject in subjects.values()]
        starts = [float(subject.time[0]) for subject in subjects.values()]
        self._span = min(starts), max(*ends, min(starts) + 1e-3)

    def colour(self, name: str) -> str:
        """Return the colour of a run."""
        return str(self._looks[name]['color'])

    def output(self) -> Plot:
        """Return outputs, references and, hidden at first, measurements."""
        figure = self._timed('output y and reference r')
        first = next(iter(self.subjects))
        for name, subject in self.subjects.items():
            one = {'legendgroup': 'reference', 'showlegend': name == first}
            self._line(figure, subject, 'reference', subject.column('reference'), REFERENCE, **one)
        true = [name for name, subject in self.subjects.items() if subject.knows_output]
        for name, subject in self.subjects.items():
            label = name if name in true else f'{name}, measurement'
            self._line(figure, subject, label, subject.output, self._looks[name])
        for name, subject in self.subjects.items():
            if name not in true:
                continue  # the measurement is there already
            one = {'legendgroup': 'measurement', 'showlegend': name == true[0]}
            thin = {'color': self.colour(name), 'width': 0.8}
            measured = subject.run.columns['measurement']
            self._line(figure, subject, 'measurement', measured, thin, visible='legendonly', **one)
        return Plot(figure)

    def error(self) -> Plot:
        """Return the errors that the figures of merit are made of."""
        return self._each('error e', {name: s.error for name, s in self.subjects.items()})

    def command(self) -> Plot:
        """Return the commands, held over each period."""
        return self._each(
            'command u', {name: s.command for name, s in self.subjects.items()}, shape='hv'
        )

    def disturbance(self, name: str) -> Plot:
        """Return the estimate of a run, level by level, and the truth where there is one."""
        subject = self.subjects[name]
        figure = self._timed('total disturbance')
        lines = {
            'truth': (subject.truth, {'color': INK, 'width': 1.2}),
            'estimate': (subject.column('disturbance_estimate'), self._looks[name]),
        }
        if len(subject.levels) > 1:
            for level, colour, dash in zip(subject.levels, cycle(LEVEL_COLOURS), cycle(LEVELS)):
                look = {'color': colour, 'width': 1.2, 'dash': dash}
                lines[level.replace('_', ' ')] = subject.run.columns[level], look
        shown = {label: line for label, line in lines.items() if np.isfinite(line[0]).any()}
        for label, (values, look) in shown.items():
            self._line(figure, subject, label, values, look)
        return self._framed(figure, [(subject.time, values) for values, _ in shown.values()])

    def _each(self, title: str, columns: Mapping[str, Array], shape: str = 'linear') -> Plot:
        figure = self._timed(title)
        for name, values in columns.items():
            look = {**self._looks[name], 'shape': shape}
            self._line(figure, self.subjects[name], name, values, look)
        lines = [(self.subjects[name].time, values) for name, values in columns.items()]
        return self._framed(figure, lines)

    def _framed(self, figure: go.Figure, lines: Sequence[tuple[Array, Array]]) -> Plot:
        limits = frame(lines) if lines else None
        if limits is None:
            return Plot(figure)
        figure.update_yaxes(range=limits)
        return Plot(figure, note='The start is cut off; a double click shows all of it.')

    def _line(
        self, figure: go.Figure, subject: Subject, name: str, values: Array, look: Any, **more: Any
    ) -> None:
        chosen = kept(values, self._points)
        figure.add_scatter(
            x=subject.time[chosen],
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
        for moment in self._moments:
            figure.add_vline(moment.time, line={'color': INK, 'width': 1, 'dash': 'dot'})
            figure.add_annotation(
                x=moment.time, y=1.0, yref='paper', text=str(moment.number), showarrow=False,
                xanchor='left', yanchor='top', xshift=2, bgcolor='rgba(255,255,255,0.8)',
            )  # fmt: skip
        return figure


def base(y: str, x: str) -> go.Figure:
    """Return an empty figure in the style of the house."""
    figure = go.Figure()
    figure.update_layout(
        template='none',
        height=HEIGHT,
        margin={'l': 62, 'r': 8, 't': 34, 'b': 44},
        font={'family': FONT, 'size': 12, 'color': INK},
        legend={'orientation': 'h', 'x': 0, 'y': 1.02, 'yanchor': 'bottom', 'xanchor': 'left'},
        showlegend=True,
        dragmode='zoom',
        hoverlabel={'font': {'family': FONT}},
    )
    axis = {'gridcolor': GRID, 'zeroline': False, 'linecolor': GREY, 'showline': True}
    figure.update_xaxes(title={'text': x, 'standoff': 6}, **axis)
    figure.update_yaxes(title={'text': y, 'standoff': 4}, automargin=True, **axis)
    return figure
