"""A report in words: what ran, how well, and whether anything was lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan

from nadrc_ros.records.recorded_run import RecordedRun
from nadrc_ros.report.marks import node_of, NumberedChanges, text_of
from nadrc_ros.report.tables import comparable, shown_together
import numpy as np

# More runs are only counted.
_MOST_NAMED = 3


def title_of(runs: Mapping[str, RecordedRun]) -> str:
    """Return the title."""
    names = list(runs)
    if len(names) == 1:
        return f'Run {names[0]}'
    if len(names) > _MOST_NAMED:
        return f'{len(names)} runs compared'
    return f'{", ".join(names[:-1])} and {names[-1]} compared'


def summary_of(runs: Mapping[str, RecordedRun], marked: Sequence[NumberedChanges]) -> str:
    """Return a few sentences, as many for two runs as for twenty."""
    well = _alone if len(runs) == 1 else _compared
    sentences = [_what(runs), well(runs), *_lost(runs), _changed(marked)]
    return ' '.join(filter(None, sentences))


def _what(runs: Mapping[str, RecordedRun]) -> str:
    sizes = list(dict.fromkeys(map(_size, runs.values())))
    plants = {_plant(run) for run in runs.values()}
    plant = f' on the plant {plants.pop()}' if len(plants) == 1 and '' not in plants else ''
    if len(runs) == 1:
        started = str(next(iter(runs.values())).history.about.get('started', ''))
        started = started[: len('2026-12-01T02:50')].replace('T', ' at ')
        return f'{sizes[0]}{plant}{f", started {started}" if started else ""}.'
    each = sizes[0] if len(sizes) == 1 else 'different length or rate'
    return f'{len(runs)} runs of {each}{plant}.'


def _size(run: RecordedRun) -> str:
    length = float(run.time[-1] - run.time[0]) + 1.0 / run.rate
    return f'{_round(length)} s at {_round(run.rate)} Hz'


def _round(value: float) -> str:
    return f'{value:.0f}' if value >= 1000.0 else f'{value:.3g}'


def _plant(run: RecordedRun) -> str:
    names = (v['plant'] for v in run.history.parameters.values() if 'noise_variance' in v)
    return text_of(next(names, ''))


def _alone(runs: Mapping[str, RecordedRun]) -> str:
    (run,) = runs.values()
    metrics = run.metrics
    if not metrics.samples:
        return 'No sample has both an error and a command.'
    unit = f' {run.units.output}' if run.units.output else ''
    if isnan(metrics.peak_error):
        text = f'The error stayed within {_figure(metrics.max_error)}{unit}'
    else:
        begin = f'{run.figure_settings.settle_time:.4g} s'
        text = f'From {begin} on the error stayed within {_figure(metrics.peak_error)}{unit}'
    text += f' (RMSE {_figure(metrics.rmse)}{unit} over all); ITAE is {_figure(metrics.itae)}'
    if not isnan(metrics.saturated_fraction):
        (share,) = shown_together('saturated_fraction', [metrics.saturated_fraction])
        text += f', and the command was at a limit for {share} of the time'
    return text + '.'


def _figure(value: float) -> str:
    return shown_together('', [value])[0]


def _compared(runs: Mapping[str, RecordedRun]) -> str:
    metrics = {name: run.metrics for name, run in runs.items()}
    if not all(m.samples for m in metrics.values()):
        return 'Not every run has samples with both an error and a command.'
    same = comparable(runs)
    key = 'itae' if same else 'rmse'
    before = '' if same else 'Their integrals cover different times. '
    values = {name: float(getattr(each, key)) for name, each in metrics.items()}
    best, second, *_ = sorted(values, key=values.__getitem__)
    shown = dict(zip(values, shown_together(key, list(values.values()))))
    if shown[best] == shown[second]:
        return f'{before}{best} and {second} share the lowest {key.upper()}.'
    lead = 100.0 * (1.0 - values[best] / values[second])
    text = f'{before}Lowest {key.upper()}: {best}, {lead:.2g} % below {second}'
    if same and metrics[second].isu > 0.0:
        effort = 100.0 * (metrics[best].isu / metrics[second].isu - 1.0)
        text += f', with {abs(effort):.2g} % {"less" if effort < 0.0 else "more"} effort (ISU)'
    return text + '.'


def _lost(runs: Mapping[str, RecordedRun]) -> list[str]:
    """Return what the runs lack, runs that lack the same in one sentence."""
    missing = {name: share for name, run in runs.items() if (share := missing_share(run))}
    lacking: dict[str, list[str]] = {}
    for name, run in runs.items():
        for loss in losses(run):
            lacking.setdefault(loss, []).append(name)
    if len(lacking) > _MOST_NAMED:
        every = [name for names in lacking.values() for name in names]
        lacking = {'lacks samples: see the table': list(dict.fromkeys(every))}
    found = [f'{_whose(names, runs)} {text}.' for text, names in lacking.items()]
    if missing:
        low, high = (f'{100.0 * each(missing.values()):.2g}' for each in (min, max))
        shares = low if low == high else f'{low} to {high}'
        found.insert(0, f'{_whose(list(missing), runs)} misses {shares} % of its measurements.')
    if found:
        return found
    if any(run.summary.get('samples_lost') is None for run in runs.values()):
        return ['Whether samples were lost is not known.']
    return ['Nothing was lost.']


def missing_share(run: RecordedRun) -> float:
    """Return the share of the periods that have no measurement, 0 if the recorder lost samples."""
    if run.summary.get('samples_lost') or not run.gaps:
        return 0.0
    return run.gaps / float(run.gaps + np.isfinite(run.columns['measurement']).sum())


def _whose(names: Sequence[str], runs: Mapping[str, RecordedRun]) -> str:
    if len(names) == len(runs):
        return 'The run' if len(runs) == 1 else 'Every run'
    if len(names) > _MOST_NAMED:
        return f'Of {len(runs)} runs each of {len(names)}'
    return ' and '.join(names) if len(names) == 1 else f'Each of {", ".join(names)}'


def losses(run: RecordedRun) -> list[str]:
    """Return what a run lacks, each as the end of a sentence that begins with its name."""
    found = []
    summary, metrics = run.summary, run.metrics
    lost = summary.get('samples_lost')
    by_signal = summary.get('samples_lost_by_signal')
    if isinstance(lost, int) and lost:
        signals = by_signal if isinstance(by_signal, dict) else {}
        named = ', '.join(f'{k} {n}' for k, n in signals.items())
        found.append(
            f'lacks {lost} samples that the recorder lost{f" ({named})" if named else ""}'
        )
    if isinstance(before := summary.get('commands_before'), int) and before:
        found.append(f'begins late: {before} commands were sent before the first that is recorded')
    if summary.get('complete') is not True and run.figures is not None:
        found.append('was not ended by the recorder: these are the samples that it saved')
    if run.gap_time:
        found.append(f'has {run.gap_time:.3g} s without a row, which no figure counts')
    if metrics.skipped:
        found.append(f'has {metrics.skipped} samples not finite, which no figure counts')
    return found


def _changed(marked: Sequence[NumberedChanges]) -> str:
    changes = (change for mark in marked for change, _ in mark.changes)
    count = len({(node_of(change.node), change.name) for change in changes})
    if not count:
        return ''
    what = f'{count} parameters were' if count > 1 else 'One parameter was'
    return f'{what} changed during the run.'
