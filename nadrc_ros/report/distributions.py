"""Plots of a report that are not over time: the spectrum of the command, latency and period."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from math import pi

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
    figure.update_yaxes(type='log', exponentformat='power')
    for name, subject in plotter.subjects.items():
        found = command_spectrum(subject.time, subject.command, subject.run.rate)
        if found is not None and (found[1] > 0.0).any():
            figure.add_scatter(
                x=found[0],
                y=np.where(found[1] > 0.0, found[1], np.nan),
                mode='lines',
                name=escape(name),
                line={'color': plotter.colour(name), 'width': 1.5},
                hovertemplate='%{x:.4g} Hz: %{y:.4g}',
            )
    if not figure.data:
        return None
    for label, (speed, runs) in bandwidths(plotter.subjects).items():
        colour = plotter.colour(runs[0]) if len(runs) < len(plotter.subjects) else INK
        figure.add_vline(speed / (2.0 * pi), line={'color': colour, 'width': 1, 'dash': 'dash'})
        figure.add_annotation(
            x=np.log10(speed / (2.0 * pi)), y=0.02, yref='paper', text=label, showarrow=False,
            textangle=-90, xanchor='right', yanchor='bottom', font={'color': colour, 'size': 11},
        )  # fmt: skip
    return Plot(figure, timed=False)


def bandwidths(subjects: Mapping[str, Subject]) -> dict[str, tuple[float, list[str]]]:
    """Return each bandwidth of the controllers [rad/s] by what to write at it, and its runs."""
    found: dict[str, tuple[float, dict[str, list[str]]]] = {}
    for name, subject in subjects.items():
        for _, settings in subject.settings:
            for what, speed in _bandwidths(settings).items():
                _, known = found.setdefault(f'{speed:g}', (speed, {}))
                runs = known.setdefault(what, [])
                if name not in runs:
                    runs.append(name)
    return {
        f'{", ".join(known)} {text} rad/s': (
            speed,
            sorted({r for runs in known.values() for r in runs}),
        )
        for text, (speed, known) in found.items()
    }


def _bandwidths(settings: ControllerSettings) -> dict[str, float]:
    levels = make_design(settings).bandwidths
    named = {f'level {k}' if len(levels) > 1 else 'observer': w for k, w in enumerate(levels, 1)}
    return {'controller': settings.controller_bandwidth, **named}


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
            name=escape(name),
            marker={'color': plotter.colour(name), 'opacity': 0.65, 'line': {'width': 0}},
            hovertemplate='%{x:.3g} ms: %{y:.3g} %',
        )
    figure.update_layout(barmode='overlay', bargap=0)
    beyond = sum(int((values > edges[-1]).sum()) for values in columns.values())
    note = f'{beyond} beyond {edges[-1]:.3g} ms are not drawn.' if beyond else ''
    return Plot(figure, timed=False, note=note)
