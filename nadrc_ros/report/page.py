"""The report: one HTML file on one or several runs that needs nothing else, not even a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
import json
from pathlib import Path
from typing import Any

import attrs
from bokeh.document import Document
from bokeh.resources import INLINE
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from nadrc_ros.records.recorded_run import RecordedRun
from nadrc_ros.records.states import IN_CONTROL
from nadrc_ros.report import roles, tables
from nadrc_ros.report.marks import numbered
from nadrc_ros.report.packed import Columns, packed
from nadrc_ros.report.plots import Plot, Plotter
from nadrc_ros.report.summary import summary_of, title_of
from nadrc_ros.report.traces import Gap, MOST_OF_ALL, MOST_ROWS, Trace, trace_of
import numpy as np

# So many gaps are told with their causes.
_MOST_GAPS = 5
_HERE = Path(__file__).parent
# Columns of the read-out: what it calls them, and the column of a trace.
_READ_OUT = {
    'r': 'reference',
    'y': 'output',
    'e': 'error',
    'u': 'command',
    'd': 'truth',
    'd est.': 'estimate',
}


@attrs.frozen
class Timing:
    """A histogram with its table."""

    title: str
    plot: Plot
    table: tables.Table


def page(runs: Mapping[str, RecordedRun]) -> str:
    """Return the whole page on these runs, by name."""
    marked = numbered({name: run.changes for name, run in runs.items()})
    turning = {name: run.unwrapped() for name, run in runs.items()}
    most = min(MOST_ROWS, MOST_OF_ALL // len(runs))
    traces = {name: trace_of(run, most) for name, run in turning.items()}
    plotter = Plotter(turning, traces, marked)
    disturbances = {
        name: plot
        for name, run in turning.items()
        if (plot := plotter.disturbance(name, _which_truth(run))) is not None
    }
    strip = plotter.strip()
    timed = [plotter.output(), plotter.error(_which_error(runs)), plotter.command()]
    miss = plotter.miss()
    timing = [
        Timing(title, plot, tables.timing(columns))
        for title, plot, columns in (
            (
                'Latency: measurement to command',
                plotter.latency(),
                {name: run.latency for name, run in runs.items()},
            ),
            (
                'Period: measurement to measurement',
                plotter.period(),
                {name: run.periods for name, run in runs.items()},
            ),
        )
        if plot is not None
    ]
    spectrum = plotter.spectrum()
    plots = [
        *([strip] if strip else []),
        *timed,
        *disturbances.values(),
        *([miss] if miss else []),
    ]
    plots += [*([spectrum] if spectrum else []), *(each.plot for each in timing)]
    gaps = _gaps(traces)
    columns = {name for trace in traces.values() for name in trace.columns}
    return _environment().get_template('report.html').render(
        title=title_of(runs),
        summary=summary_of(runs, marked),
        runs=list(runs),
        looks=plotter.looks,
        figures=tables.figures_of_merit(runs),
        happened=tables.happened(runs, marked),
        strip=strip,
        timed=timed,
        disturbances=disturbances,
        miss=miss,
        spectrum=spectrum,
        timing=timing,
        number={plot.figure.id: i for i, plot in enumerate(plots)},
        columns=columns,
        units={name: plotter.unit(name) for name in _READ_OUT.values()},
        read_out={sign: name for sign, name in _READ_OUT.items() if name in columns},
        levels=sorted(name for name in columns if name.startswith('level_')),
        level_looks=roles.level_looks(len(columns)),
        thinned={name: trace.every for name, trace in traces.items() if trace.every > 1},
        gaps=gaps[:_MOST_GAPS],
        more_gaps=len(gaps[_MOST_GAPS:]),
        parameters=tables.parameters(runs, different=False),
        different=tables.parameters(runs, different=True) if len(runs) > 1 else None,
        origin=tables.origin(runs),
        roles=roles,
        style=Markup(_text('report.css')),
        scripts=[Markup(_text(f'{name}.js')) for name in ('samples', 'report')],
        packed={'bokeh': _bokeh(), **_data(plots, traces, plotter.span)},
    )  # fmt: skip


@cache
def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


@cache
def _text(name: str) -> str:
    return (_HERE / name).read_text(encoding='utf-8')


def _gaps(traces: Mapping[str, Trace]) -> list[tuple[str, Gap]]:
    """Return the gaps, each with the names of the runs that have it."""
    found: dict[Gap, list[str]] = {}
    for name, trace in traces.items():
        for gap in trace.gaps:
            found.setdefault(gap, []).append(name)
    return [(', '.join(names), gap) for gap, names in found.items()]


@cache
def _bokeh() -> str:
    """Return the script that draws; of its parts none but the plots."""
    return packed(INLINE.js_raw[0])


def _data(
    plots: Sequence[Plot], traces: Mapping[str, Trace], span: tuple[float, float]
) -> dict[str, str]:
    """Return all that the script draws: each plot is a document of its own, made when seen."""
    columns = Columns()
    content: dict[str, Any] = {
        'plots': [_document(each) for each in plots],
        'timed': [each.timed for each in plots],
        'span': span,
        'dark': roles.DARK,
        'runs': [
            {
                'name': name,
                'columns': {
                    key: columns.add(values, key == 'time')
                    for key, values in trace.columns.items()
                },
                'gaps': trace.gaps,
                'states': [each for each in trace.states if each.state != IN_CONTROL],
            }
            for name, trace in traces.items()
        ],
        'columns': columns.kinds,
    }
    text = json.dumps(content, allow_nan=False, separators=(',', ':'))
    return {'data': packed(text), 'samples': packed(columns.data)}


def _document(plot: Plot) -> Any:
    document = Document()
    document.add_root(plot.figure)
    return document.to_json(deferred=False)


def _which_error(runs: Mapping[str, RecordedRun]) -> str:
    kinds = {run.figure_settings.error for run in runs.values()}
    if kinds == {'reference'}:
        return 'Error e: reference minus output, as in the figures of merit.'
    if kinds == {'tracking'}:
        return 'Error e: output of the tracking differentiator minus output, as in the figures.'
    return 'Error e as in the figures of merit, not of the same kind in all runs.'


def _which_truth(run: RecordedRun) -> str:
    what = 'Estimate of the total disturbance over the truth'
    if not np.isfinite(run.total_disturbance).any():
        what = 'Estimate of the total disturbance'
        if np.isfinite(run.column('total_disturbance')).any():
            return (
                f'{what}. The truth is not known: with plant_poles it is y⁽ⁿ⁾ + aₙ₋₁ y⁽ⁿ⁻¹⁾ + … '
                '− b₀ u, with b0_source: topic b₀ varies, and neither the derivatives of y nor '
                'that b₀ were recorded.'
            )
        return f'{what}. The truth is not known (a real plant, or not recorded).'
    if run.referred:
        return f'{what}, y⁽ⁿ⁾ − b₀ u for b₀ of the controller.'
    return (
        f'{what}, y⁽ⁿ⁾ − b₀ u for b₀ of the plant; whether the controller has the same is not '
        'known.'
    )
