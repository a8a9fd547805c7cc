"""The tables of a report, as HTML: whatever comes from files is escaped here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from math import isnan

import attrs
from nadrc_ros.records.history import Event
from nadrc_ros.records.recorded_run import Array, RecordedRun
from nadrc_ros.report.marks import node_of, NumberedChanges, text_of
from nadrc_ros.report.markup import table
import numpy as np

FIGURES = (
    ('itae', 'ITAE', 'integral of t |e|'),
    ('isu', 'ISU', 'integral of u²'),
    ('iae', 'IAE', 'integral of |e|'),
    ('rmse', 'RMSE', 'root mean square of e'),
    ('max_error', 'max |e|', 'largest error'),
    ('peak_error', 'peak |e|', 'largest error after the settle time'),
    ('max_command', 'max |u|', 'largest command'),
    ('total_variation', 'TV', 'total variation of u'),
    ('saturated_fraction', 'saturated', 'share of the time'),
)
# More changes are counted, not listed.
MOST_LISTED = 200
_MISSING = '–'
# Parameters named by topics, which differ between namespaces anyway.
_WIRING = 'qos_overrides.'


def wins(value: float, values: Sequence[float]) -> bool:
    """Tell whether a figure is the lowest of several that differ."""
    known = [each for each in values if not isnan(each)]
    return bool(known) and value == min(known) < max(known)


def shown(key: str, value: float) -> str:
    """Return a figure as a table shows it."""
    if isnan(value):
        return '-'
    return f'{100.0 * value:.1f} %' if key == 'saturated_fraction' else f'{value:.4g}'


def comparable(runs: Mapping[str, RecordedRun]) -> bool:
    """Tell whether integrals over the runs compare: whether these are of one length."""
    durations = [run.metrics.duration for run in runs.values()]
    return min(durations) >= 0.99 * max(durations)


def figures_of_merit(runs: Mapping[str, RecordedRun]) -> str:
    """Return a row for each figure; the lowest in bold, all digits where the pointer rests."""
    rows = []
    for key, label, meaning in FIGURES:
        values = [float(getattr(run.metrics, key)) for run in runs.values()]
        rivals = values if comparable(runs) else []
        cells = [_MISSING if isnan(value) else _figure(key, value, rivals) for value in values]
        rows.append([_labelled(f'<b>{label}</b>', meaning), *cells])
    rows += _counted(runs)
    return table(['', *map(escape, runs)], rows)


def _figure(key: str, value: float, rivals: Sequence[float]) -> str:
    text = f'<span title="{value!r}">{shown(key, value)}</span>'
    return f'<b>{text}</b>' if wins(value, rivals) else text


def _labelled(label: str, meaning: str) -> str:
    return f'{label} <span class="meaning">{meaning}</span>'


def _counted(runs: Mapping[str, RecordedRun]) -> list[list[str]]:
    every = runs.values()
    lost = (_count(run.summary.get('samples_lost')) for run in every)
    return [
        [_labelled('rows', 'samples recorded'), *(str(len(s.time)) for s in every)],
        [_labelled('missing', 'periods without a measurement'), *(str(s.gaps) for s in every)],
        [_labelled('lost', 'by the recorder, of all signals'), *lost],
        [_labelled('skipped', 'counted in no figure'), *(str(s.metrics.skipped) for s in every)],
    ]


def _count(value: object) -> str:
    return str(value) if isinstance(value, int) else _MISSING


def changes(marked: Sequence[NumberedChanges], runs: Sequence[str]) -> str:
    """Return a row for each change of a parameter, with the number of its mark in the plots."""
    rows = [
        {
            'mark': str(mark.number),
            'time': f'{mark.time:.4g}\u00a0s',
            'run': ', '.join(run for run in runs if run in names),
            'node': node_of(change.node),
            'parameter': change.name,
            'from': text_of(change.before),
            'to': text_of(change.after),
        }
        for mark in marked
        for change, names in mark.changes
    ]
    return _listing(rows, several=len(runs) > 1)


def events(runs: Mapping[str, RecordedRun]) -> str:
    """Return a row for each thing that happened during the runs, '' if nothing is known of it."""
    found = [
        (event.time, name, event)
        for name, run in runs.items()
        for event in _with_ends(run.events)
        if event.time is not None
    ]
    rows = [
        {
            'time': f'{time:.4g}\u00a0s',
            'run': name,
            'node': node_of(event.node),
            'event': event.message,
        }
        for time, name, event in sorted(found, key=lambda each: each[0])
    ]
    return _listing(rows, several=len(runs) > 1)


def _listing(rows: Sequence[Mapping[str, str]], several: bool) -> str:
    """Return a table of plain text by column, without that of the run where there is only one."""
    header = [name for name in (rows[0] if rows else ()) if several or name != 'run']
    cells = [[escape(row[name]) for name in header] for row in rows[:MOST_LISTED]]
    return table(header, cells, words=range(len(header))) if rows else ''


def _with_ends(events: Sequence[Event]) -> list[Event]:
    """Return events that say which fault has ended, where a plant tells that there is none."""
    found, before = [], 'the fault'
    for event in events:
        if event.kind == 'fault' and event.message == 'none':
            event = attrs.evolve(event, message=f'{before} ended')
        elif event.kind == 'fault':
            before = event.message
        found.append(event)
    return found


def timing(columns: Mapping[str, Array]) -> str:
    """Return median, 99 % and largest of times [s], in milliseconds, a row for each run."""
    rows = []
    for name, values in columns.items():
        found = [np.median(values), np.quantile(values, 0.99), values.max()] if values.size else []
        cells = [f'{1e3 * value:.3f}' for value in found] or [_MISSING] * 3
        rows.append([escape(name), str(values.size), *cells])
    return table(['', 'samples', 'median [ms]', '99 % [ms]', 'largest [ms]'], rows)


def parameters(runs: Mapping[str, RecordedRun], different: bool) -> str:
    """Return the first values of all parameters, or of those in which runs differ; '' if none."""
    found = {
        title: {
            (node_of(node), name): text_of(value)
            for node, values in run.history.parameters.items()
            for name, value in values.items()
        }
        for title, run in runs.items()
    }
    rows = []
    for node, name in dict.fromkeys(key for values in found.values() for key in values):
        cells = [values.get((node, name), _MISSING) for values in found.values()]
        if not different or (len(set(cells)) > 1 and not name.startswith(_WIRING)):
            rows.append([escape(node), escape(name), *map(escape, cells)])
    header = ['node', 'parameter', *map(escape, runs)]
    return table(header, rows, words=range(len(header))) if rows else ''


def origin(runs: Mapping[str, RecordedRun]) -> str:
    """Return where each run was read from, when it was started, and by what versions."""
    found = {name: _origin(run) for name, run in runs.items()}
    rows = [
        [escape(key), *(escape(values.get(key, _MISSING)) for values in found.values())]
        for key in dict.fromkeys(key for values in found.values() for key in values)
    ]
    return table(['', *map(escape, runs)], rows, words=range(1 + len(runs)))


def _origin(run: RecordedRun) -> dict[str, str]:
    about = run.history.about
    versions = about.get('versions')
    found = {'read from': str(run.path)}
    found |= {key: text_of(about[key]) for key in ('started', 'namespace') if key in about}
    for values in run.history.parameters.values():
        if 'seed' in values:  # that of the plant
            found['seed'] = text_of(values['seed'])
    if isinstance(versions, dict):
        found |= {str(key): text_of(value) for key, value in versions.items()}
    return found
