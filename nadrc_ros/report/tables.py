"""The tables of a report, as text: the template escapes what comes from files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import floor, inf, isfinite, isnan, log10, nan
import re
from typing import NamedTuple

from nadrc_ros.records.history import LASTING
from nadrc_ros.records.recorded_run import Array, RecordedRun
from nadrc_ros.report.marks import node_of, NumberedChanges, text_of
from nadrc_ros.report.unused import unused
from nadrc_ros.scenario.units import with_unit
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
_IGNORED = 'ignored'
# Parameters named by topics, which differ between namespaces anyway.
_WIRING = 'qos_overrides.'


def winners(texts: Sequence[str], values: Sequence[float]) -> list[bool]:
    """Tell which figures are the lowest: all that read as the lowest one, if not all do."""
    lowest = min((value for value in values if not isnan(value)), default=nan)
    known = [text for text, value in zip(texts, values) if not isnan(value)]
    best = {text for text, value in zip(texts, values) if value == lowest}
    return [text in best and best != set(known) for text in texts]


def comparable(runs: Mapping[str, RecordedRun]) -> bool:
    """Tell whether integrals over the runs compare: whether these are of one length."""
    durations = [run.metrics.duration for run in runs.values()]
    return min(durations) >= 0.99 * max(durations)


class Cell(NamedTuple):
    """A cell of a table: its text, what explains it, all digits, and whether it wins."""

    text: str
    note: str = ''
    title: str = ''
    wins: bool = False


class Table(NamedTuple):
    """A table; columns before ``words`` hold words, the others numbers."""

    header: list[str]
    rows: list[list[Cell]]
    words: int = 1


def figures_of_merit(runs: Mapping[str, RecordedRun]) -> Table:
    """Return a row for each figure; the lowest wins, all digits where the pointer rests."""
    rows = []
    for key, label, meaning in FIGURES:
        values = [float(getattr(run.metrics, key)) for run in runs.values()]
        texts = shown_together(key, values)
        best = winners(texts, values) if comparable(runs) else [False] * len(texts)
        cells = [
            Cell(text, title='' if isnan(value) else repr(value), wins=wins)
            for text, value, wins in zip(texts, values, best)
        ]
        units = {run.units.of_figure(key) for run in runs.values()}
        unit = units.pop() if len(units) == 1 else ''
        rows.append([Cell(with_unit(label, unit), meaning), *cells])
    return Table(['', *runs], rows + _counted(runs))


def shown_together(key: str, values: Sequence[float], plain: bool = False) -> list[str]:
    """
    Return figures that are read beside each other, with the same decimals.

    The largest shows at least three digits, the smallest two; the smallest difference two, or
    one where that needs more than six digits, unless it is less than 1e-5 of what differs: such
    figures read the same. What is 100,000 times the smallest has no say in this, and if need be
    a power of its own. A power of ten is ``plain`` e-5, or as one writes it.
    """
    share = key == 'saturated_fraction'
    shown = [100.0 * value if share else value for value in values]
    smallest = min((abs(value) for value in shown if value and isfinite(value)), default=0.0)
    alike = sorted({value for value in shown if abs(value) <= 1e5 * smallest} | {0.0} & {*shown})
    leading = _leading(max(map(abs, alike), default=0.0))
    shift = 0 if share or -4 <= leading < 12 else leading
    least = 1 if share else 2 - leading if smallest else -1
    pairs = pairwise([0.0] * share + alike)
    gaps = [high - low for low, high in pairs if high - low >= max(1e-5 * abs(high), 1e-300)]
    finest = least + (not share)
    if gaps:
        differ = -_leading(min(gaps))
        finest = max(differ, min(differ + 1, least + 3))
    if smallest and not share:
        finest = max(finest, 1 - _leading(smallest))
    places = max(0, max(least, finest) + shift)

    def text(value: float) -> str:
        scaled = value / 10.0**shift
        fits = value in alike or abs(scaled) < 1e7
        if fits and (not value or 2.0 * abs(scaled) >= 10.0**-places):
            return f'{scaled:.{places}f}' + _power(shift, plain)
        return f'{value / 10.0 ** _leading(value):.2f}' + _power(_leading(value), plain)

    unit = ' %' if share else ''
    return [text(value) + unit if isfinite(value) else _MISSING for value in shown]


def _leading(value: float) -> int:
    """Return the power of ten of the first digit."""
    return floor(log10(abs(value))) if value else 0


def _power(number: int, plain: bool) -> str:
    if not number:
        return ''
    return f'e{number}' if plain else f'\u2009·\u200910{_superscript(number)}'


def _superscript(number: int) -> str:
    return str(number).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))


def _counted(runs: Mapping[str, RecordedRun]) -> list[list[Cell]]:
    every = runs.values()
    lost = (_count(run.summary.get('samples_lost')) for run in every)
    found = {
        ('rows', 'samples recorded'): (str(len(s.time)) for s in every),
        ('missing', 'periods without a measurement'): (str(s.gaps) for s in every),
        ('lost', 'by the recorder, of all signals'): lost,
        ('skipped', 'counted in no figure'): (str(s.metrics.skipped) for s in every),
    }
    return [[Cell(*label), *map(Cell, counts)] for label, counts in found.items()]


def _count(value: object) -> str:
    return str(value) if isinstance(value, int) else _MISSING


def happened(
    runs: Mapping[str, RecordedRun], marked: Sequence[NumberedChanges]
) -> tuple[Table | None, int]:
    """
    Return what happened during the runs, in order, and how much of it is left out.

    States, faults and gaps have their duration, changes of parameters the number of their mark.
    """
    every = [each for name, run in runs.items() for each in _of_events(name, run)]
    found = []
    for one in dict.fromkeys(each._replace(run='') for each in every):  # the same in several runs
        names = [each.run for each in every if each._replace(run='') == one]
        found.append(one._replace(run=', '.join(dict.fromkeys(names))))
    for mark in marked:
        for change, names in mark.changes:
            what = f'{change.name}: {text_of(change.before)} → {text_of(change.after)}'
            whose = ', '.join(run for run in runs if run in names)
            found.append(_Happened(mark.time, '', whose, node_of(change.node), what, mark.number))
    if not found:
        return None, 0
    found.sort(key=lambda each: each.time)
    several = len(runs) > 1
    rows = [
        [
            Cell(str(each.mark or '')),
            Cell(f'{each.time:.3f}'),
            Cell(each.duration),
            *([Cell(each.run)] if several else []),
            Cell(each.node),
            Cell(each.what),
        ]
        for each in found[:MOST_LISTED]
    ]
    header = ['mark', 'time [s]', 'for [s]', *(['run'] if several else []), 'node', 'what']
    return Table(header, rows, words=len(header)), len(found[MOST_LISTED:])


class _Happened(NamedTuple):
    time: float
    duration: str
    run: str
    node: str
    what: str
    mark: int = 0


def _of_events(name: str, run: RecordedRun) -> list[_Happened]:
    """Return the events during a run, and the state in which it begins."""
    found = []
    begin, end = float(run.time[0]), run.end
    events = sorted(run.history.events, key=lambda e: -inf if e.time is None else e.time)
    for i, event in enumerate(events):
        following = (e for e in events[i + 1 :] if (e.node, e.kind) == (event.node, event.kind))
        until = next(following, None)
        stop = end if until is None else -inf if until.time is None else until.time
        time = begin if event.kind == 'late' else event.time
        if event.kind in LASTING and (time is None or time < begin) and stop > begin:
            time = begin
        none = event.kind == 'fault' and event.message == 'none'
        if time is None or none or not begin <= time <= end or stop < begin:
            continue
        duration = ''
        if event.kind in LASTING:
            duration = f'{min(stop, end) - time:.3f}'
        elif event.kind == 'gap':
            duration = _length_of(event.message)
        what = f'refused: {event.message}' if event.kind == 'refused' else event.message
        found.append(_Happened(time, duration, name, node_of(event.node), what))
    return found


def _length_of(gap: str) -> str:
    """Return how long a gap was, by what a recorder says of it; '' for other words."""
    found = re.match(r'no \w+ for ([\d.]+) s', gap)
    return f'{float(found[1]):.3f}' if found else ''


def timing(columns: Mapping[str, Array]) -> Table:
    """Return median, 99 % and largest of times [s], in milliseconds, a row for each run."""
    rows = []
    for name, values in columns.items():
        found = [np.median(values), np.quantile(values, 0.99), values.max()] if values.size else []
        cells = [f'{1e3 * value:.3f}' for value in found] or [_MISSING] * 3
        rows.append(list(map(Cell, [name, str(values.size), *cells])))
    return Table(['', 'samples', 'median [ms]', '99 % [ms]', 'largest [ms]'], rows)


def parameters(runs: Mapping[str, RecordedRun], different: bool) -> Table | None:
    """Return the first values of all parameters, or of those in which runs differ."""
    found = {title: _first_values(run) for title, run in runs.items()}
    rows = []
    for node, name in dict.fromkeys(key for values in found.values() for key in values):
        cells = [values.get((node, name), Cell(_MISSING)) for values in found.values()]
        if different and (len(set(cells)) == 1 or name.startswith(_WIRING)):
            continue
        if not different or any(cell.note != _IGNORED for cell in cells):
            rows.append([Cell(node), Cell(name), *cells])
    header = ['node', 'parameter', *runs]
    return Table(header, rows, words=len(header)) if rows else None


def _first_values(run: RecordedRun) -> dict[tuple[str, str], Cell]:
    found = {}
    for node, values in run.history.parameters.items():
        ignored = unused(values)
        for name, value in values.items():
            note = _IGNORED if name in ignored else ''
            found[node_of(node), name] = Cell(text_of(value), note)
    return found


def origin(runs: Mapping[str, RecordedRun]) -> Table:
    """Return where each run was read from, when it was started, and by what versions."""
    found = {name: _origin(run) for name, run in runs.items()}
    keys = list(dict.fromkeys(key for values in found.values() for key in values))
    rows = [
        list(map(Cell, [name, *(values.get(key, _MISSING) for key in keys)]))
        for name, values in found.items()
    ]
    return Table(['', *keys], rows, words=1 + len(keys))


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
