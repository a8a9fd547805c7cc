"""The report: one HTML file on one or several runs that needs nothing else, not even a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from nadrc_ros.records.recorded_run import RecordedRun
from nadrc_ros.report import tables
from nadrc_ros.report.marks import numbered, NumberedChanges
from nadrc_ros.report.markup import document, heading, paragraph, verdict
from nadrc_ros.report.plots import Plot, Plotter
from nadrc_ros.report.summary import summary_of, title_of
import numpy as np
from plotly.offline import get_plotlyjs

_HERE = Path(__file__).parent
_NO_DISTURBANCE = 'Neither an estimate of the disturbance nor its true value was recorded.'
_NO_SPECTRUM = 'There are too few samples for a spectrum.'
_NO_STAMPS = (
    'Nothing here tells when samples left their publishers; the recorder keeps that of runs in '
    'real time.'
)
_NO_PARAMETERS = 'The parameters of the nodes were not recorded.'


def page(runs: Mapping[str, RecordedRun]) -> str:
    """Return the whole page on these runs, by name."""
    marked = numbered({name: run.changes for name, run in runs.items()})
    plotter = Plotter({name: run.unwrapped() for name, run in runs.items()}, marked)
    sections = {
        'figures': ('Figures of merit', tables.figures_of_merit(runs)),
        'changes': ('Changes on the way', _changes(marked, list(runs))),
        'events': ('What happened', tables.events(runs)),
        'output': ('Output and reference', _plot(plotter.output())),
        'error': ('Error', _note(_which_error(runs)) + _plot(plotter.error())),
        'command': ('Command', _plot(plotter.command())),
        'disturbance': ('Disturbance', _disturbance(plotter)),
        'spectrum': ('Spectrum of the command', _spectrum(plotter)),
        'timing': ('Latency and period', _timing(plotter)),
        'parameters': ('Parameters', _parameters(runs)),
        'origin': ('Origin', tables.origin(runs)),
    }
    there = {name: section for name, section in sections.items() if section[1]}
    links = (f'<a href="#{name}">{title}</a>' for name, (title, _) in there.items())
    title = title_of(runs)
    body = [f'<h1>{escape(title)}</h1>\n', verdict(summary_of(runs, marked))]
    body += [f'<nav>{" ".join(links)}</nav>\n']
    body += [heading(title, name) + content for name, (title, content) in there.items()]
    return document(title, ''.join(body) + _scripts(), f'<style>{_text("report.css")}</style>\n')


def _text(name: str) -> str:
    return (_HERE / name).read_text(encoding='utf-8')


def _scripts() -> str:
    return f'<script>{get_plotlyjs()}</script>\n<script>{_text("report.js")}</script>'


def _note(text: str) -> str:
    return f'<p class="note">{text}</p>\n' if text else ''


def _plot(plot: Plot) -> str:
    """Return a plot as data, which the script at the end of the page draws."""
    timed = ' data-timed="1"' if plot.timed else ''
    data = plot.figure.to_json()  # without <, > and /
    return (
        f'<div class="plot"{timed}><script type="application/json">{data}</script></div>\n'
        + _note(plot.note)
    )


def _changes(marked: Sequence[NumberedChanges], runs: Sequence[str]) -> str:
    if not marked:
        return ''
    count = sum(len(mark.changes) for mark in marked)
    more = count - tables.MOST_LISTED
    return (
        _note('The plots over time mark each by its number.')
        + tables.changes(marked, runs)
        + _note(f'{more} more are not listed.' if more > 0 else '')
    )


def _which_error(runs: Mapping[str, RecordedRun]) -> str:
    kinds = {run.figure_settings.error for run in runs.values()}
    if kinds == {'reference'}:
        return 'Reference minus output, as in the figures of merit.'
    if kinds == {'tracking'}:
        return 'Output of the tracking differentiator minus output, as in the figures of merit.'
    return 'As in the figures of merit, and not of the same kind in all runs.'


def _disturbance(plotter: Plotter) -> str:
    parts = []
    for name, run in plotter.runs.items():
        plot = plotter.disturbance(name)
        if plot.figure.data:
            parts.append(f'<h3>{escape(name)}</h3>\n' if len(plotter.runs) > 1 else '')
            parts += [_plot(plot), _note(_which_truth(run))]
    return ''.join(parts) or paragraph(_NO_DISTURBANCE)


def _which_truth(run: RecordedRun) -> str:
    if not np.isfinite(run.total_disturbance).any():
        if np.isfinite(run.column('total_disturbance')).any():
            return (
                'The true disturbance is not known: with <code>plant_poles</code> it is y<sup>(n)'
                '</sup> + a<sub>n−1</sub> y<sup>(n−1)</sup> + … − b<sub>0</sub> u, with <code>'
                'b0_source: topic</code> b<sub>0</sub> is another one at each time, and no record '
                'has the derivatives of y or that b<sub>0</sub>.'
            )
        return 'Nobody published the true disturbance.'
    if run.referred:
        return (
            'The truth is y<sup>(n)</sup> − b<sub>0</sub> u for b<sub>0</sub> of the controller.'
        )
    return (
        'The truth is y<sup>(n)</sup> − b<sub>0</sub> u for b<sub>0</sub> of the plant; whether '
        'the controller has the same is not known.'
    )


def _spectrum(plotter: Plotter) -> str:
    plot = plotter.spectrum()
    if plot is None:
        return paragraph(_NO_SPECTRUM)
    known = any(run.gains[1] for run in plotter.runs.values())
    marks = 'The bandwidths of controller and observers are marked.' if known else ''
    return _note(f'Power spectral density by Welch, on logarithmic axes. {marks}') + _plot(plot)


def _timing(plotter: Plotter) -> str:
    runs = plotter.runs.items()
    kinds = (
        (
            'From a measurement to the command in reply',
            plotter.latency(),
            {name: run.latency for name, run in runs},
        ),
        (
            'From a measurement to the next',
            plotter.period(),
            {name: run.periods for name, run in runs},
        ),
    )
    parts = [
        f'<h3>{title}</h3>\n{_plot(plot)}{tables.timing(columns)}'
        for title, plot, columns in kinds
        if plot is not None
    ]
    if not parts:
        return paragraph(_NO_STAMPS)
    return ''.join(parts) + _note('By the stamps with which the samples left their publishers.')


def _parameters(runs: Mapping[str, RecordedRun]) -> str:
    everything = tables.parameters(runs, different=False)
    if not everything:
        return paragraph(_NO_PARAMETERS)
    different = tables.parameters(runs, different=True) if len(runs) > 1 else ''
    intro = 'Those in which the runs differ at their start:' if different else ''
    folded = f'<details><summary>All parameters</summary>{everything}</details>\n'
    return _note(intro) + different + folded
