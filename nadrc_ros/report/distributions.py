"""Plots of a report that are not over time: the spectrum of the command, latency and period."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from math import pi

import attrs
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.report.columns import Array
from nadrc_ros.report.figure import INK
from nadrc_ros.report.plots import base, Plot, Plotter
from nadrc_ros.report.spectrum import command_spectrum
from nadrc_ros.report.subject import Subject
import numpy as np

BINS = 60
# A histogram ends at so many times its 99 %, or one straggler would hide its shape.
WIDEST = 3.0


def spectrum(plotter: Plotter) -> Plot | None:
    """Return the spectra of the commands with the bandwidths, None where no run is long enough."""
    figure = base('density of u [u²/Hz]', 'frequency [Hz]')
    figure.update_xaxes(type='log', exponentformat='power', dtick=1)
    figure.update_yaxes(type='log', exponentformat='power', dtick=1)
    for name, subject in plotter.subjects.items():
        found = command_spectrum(subject.time, subject.command, subject.run.rate)
        if found is not None and (found[1] > 0.0).any():
            figure.add_scatter(
                x=found[0],
                y=np.where(found[1] > 0.0, found[1], np.nan),
                mode='lines',
                name=escape(name, quote=False),
                line={'color': plotter.colour(name), 'width': 1.5},
                hovertemplate='%{x:.4g} Hz: %{y:.4g}',
            )
    if not figure.data:
        return None
    for each in bandwidths(plotter.subjects):
        common = len(each.runs) == len(plotter.subjects)
        colour = INK if common else plotter.colour(next(iter(each.runs)))
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


@attrs.frozen
class Bandwidth:
    """A bandwidth [rad/s], what has it, and in which runs; the two are ordered sets."""

    value: float
    names: dict[str, None] = attrs.field(factory=dict)
    runs: dict[str, None] = attrs.field(factory=dict)


def bandwidths(subjects: Mapping[str, Subject]) -> list[Bandwidth]:
    """Return the bandwidths of the controllers, at the start and after changes."""
    found: dict[float, Bandwidth] = {}
    for run, subject in subjects.items():
        for _, settings in subject.settings:
            for name, value in _bandwidths(settings).items():
                known = found.setdefault(value, Bandwidth(value))
                known.names[name] = None
                known.runs[run] = None
    return list(found.values())


def _bandwidths(settings: ControllerSettings) -> dict[str, float]:
    levels = make_design(settings).bandwidths
    return {
        'controller': settings.controller_bandwidth,
        **{f'level {k}': bandwidth for k, bandwidth in enumerate(levels, 1)},
    }


def latency(plotter: Plotter) -> Plot | None:
    """Return histograms of the time from measurement to command, None where not recorded."""
    return _histogram(
        plotter,
        {name: 1e3 * s.latency for name, s in plotter.subjects.items()},
        'from measurement to command [ms]',
    )


def period(plotter: Plotter) -> Plot | None:
    """Return histograms of the time between measurements, None where not recorded."""
    plot = _histogram(
        plotter,
        {name: 1e3 * s.periods for name, s in plotter.subjects.items()},
        'between measurements [ms]',
    )
    if plot is not None:
        for rate in {subject.run.rate for subject in plotter.subjects.values()}:
            plot.figure.add_vline(1e3 / rate, line={'color': INK, 'width': 1, 'dash': 'dot'})
    return plot


def _histogram(plotter: Plotter, columns: Mapping[str, Array], title: str) -> Plot | None:
    columns = {name: values for name, values in columns.items() if values.size}
    if not columns:
        return None
    low = min(float(values.min()) for values in columns.values())
    last = max(float(values.max()) for values in columns.values())
    high = min(last, WIDEST * max(float(np.quantile(v, 0.99)) for v in columns.values()))
    edges = np.linspace(min(low, high), high, BINS + 1) if high > low else np.array([low, low + 1])
    figure = base('share of samples [%]', title)
    for name, values in columns.items():
        counts, _ = np.histogram(values, edges)
        figure.add_bar(
            x=0.5 * (edges[:-1] + edges[1:]),
            y=100.0 * counts / values.size,
            width=np.diff(edges),
            name=escape(name, quote=False),
            marker={'color': plotter.colour(name), 'opacity': 0.65, 'line': {'width': 0}},
            hovertemplate='%{x:.3g} ms: %{y:.3g} %',
        )
    figure.update_layout(barmode='overlay', bargap=0)
    beyond = sum(int((values > edges[-1]).sum()) for values in columns.values())
    note = f'{beyond} beyond {edges[-1]:.3g} ms are not drawn.' if beyond else ''
    return Plot(figure, timed=False, note=note)
