"""A report in words: what ran, how well, and whether anything was lost."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from math import isnan

from nadrc_ros.records.recorded_run import RecordedRun
from nadrc_ros.report.marks import NumberedChanges, text_of
from nadrc_ros.report.tables import comparable, shown

# More runs are only counted in the title.
_MOST_NAMED = 3


def title_of(runs: Mapping[str, RecordedRun]) -> str:
    """Return the title, as plain text."""
    names = list(runs)
    if len(names) == 1:
        return f'Run {names[0]}'
    if len(names) > _MOST_NAMED:
        return f'{len(names)} runs compared'
    return f'{", ".join(names[:-1])} and {names[-1]} compared'


def summary_of(runs: Mapping[str, RecordedRun], marked: Sequence[NumberedChanges]) -> str:
    """Return a paragraph of HTML."""
    well = _alone if len(runs) == 1 else _compared
    sentences = [_what(runs), well(runs), *_lost(runs), _changed(marked)]
    return ' '.join(filter(None, sentences))


def _what(runs: Mapping[str, RecordedRun]) -> str:
    names = [f'<b>{escape(name)}</b> ({_size(run)})' for name, run in runs.items()]
    plants = {_plant(run) for run in runs.values()}
    plant = (
        f' on the plant {escape(plants.pop())}' if len(plants) == 1 and '' not in plants else ''
    )
    started = [str(s.history.about.get('started', '')) for s in runs.values()]
    when = f', started {escape(started[0])}' if len(started) == 1 and started[0] else ''
    return f'{_listed(names)} ran{plant}{when}.'


def _size(run: RecordedRun) -> str:
    length = float(run.time[-1] - run.time[0]) + 1.0 / run.rate
    return f'{length:.4g} s at {run.rate:.4g} Hz'


def _plant(run: RecordedRun) -> str:
    names = (v['plant'] for v in run.history.parameters.values() if 'noise_variance' in v)
    return text_of(next(names, ''))


def _alone(runs: Mapping[str, RecordedRun]) -> str:
    (run,) = runs.values()
    metrics = run.metrics
    if not metrics.samples:
        return 'No sample has both an error and a command.'
    if isnan(metrics.peak_error):
        text = f'The error stayed within {metrics.max_error:.4g}'
    else:
        begin = f'{run.figure_settings.settle_time:.4g} s'
        text = f'From {begin} on the error stayed within {metrics.peak_error:.4g}'
    text += f' (RMSE {metrics.rmse:.4g} over all); ITAE is {metrics.itae:.4g}'
    if not isnan(metrics.saturated_fraction):
        share = shown('saturated_fraction', metrics.saturated_fraction)
        text += f', and the command was at a limit for {share} of the time'
    return text + '.'


def _compared(runs: Mapping[str, RecordedRun]) -> str:
    metrics = {name: run.metrics for name, run in runs.items()}
    if not all(m.samples for m in metrics.values()):
        return 'Not every run has samples with both an error and a command.'
    if comparable(runs):
        key, before = 'itae', ''
    else:
        key, before = 'rmse', 'The runs differ in length, and integrals grow with it: '
    best, worst = _extremes({name: getattr(m, key) for name, m in metrics.items()})
    text = (
        f'{before}<b>{escape(best)}</b> has the lowest {key.upper()}, '
        f'{getattr(metrics[best], key):.4g} against {getattr(metrics[worst], key):.4g} of '
        f'<b>{escape(worst)}</b>'
    )
    if not before and metrics[worst].isu > 0.0:
        effort = 100.0 * (metrics[best].isu / metrics[worst].isu - 1.0)
        text += f', with {abs(effort):.1f} % {"less" if effort < 0.0 else "more"} effort (ISU)'
    return text + '.'


def _extremes(values: Mapping[str, float]) -> tuple[str, str]:
    key: Callable[[str], float] = values.__getitem__
    return min(values, key=key), max(values, key=key)


def _lost(runs: Mapping[str, RecordedRun]) -> list[str]:
    found = [f'<b>{escape(name)}</b>: {loss}' for name, s in runs.items() for loss in losses(s)]
    if found:
        return [f'Beware of {"; ".join(found)}.']
    if any(s.summary.get('samples_lost') is None for s in runs.values()):
        return ['Whether samples were lost is not known.']
    return ['Nothing was lost.']


def losses(run: RecordedRun) -> list[str]:
    """Return what a run lacks, in words, as HTML."""
    found = []
    summary, metrics = run.summary, run.metrics
    lost = summary.get('samples_lost')
    by_signal = summary.get('samples_lost_by_signal')
    if isinstance(lost, int) and lost:
        signals = by_signal if isinstance(by_signal, dict) else {}
        named = ', '.join(f'{escape(str(k))} {escape(str(n))}' for k, n in signals.items())
        found.append(f'{lost} samples lost by the recorder' + (f' ({named})' if named else ''))
    elif run.gaps:
        found.append(f'{run.gaps} measurements missing')
    if summary.get('complete') is not True and run.figures is not None:
        found.append('the recorder did not end the run, and these are the samples that it saved')
    if run.gap_time:
        found.append(f'{run.gap_time:.3g} s without a row, which no figure counts')
    if metrics.skipped:
        found.append(f'{metrics.skipped} samples not finite, which no figure counts')
    return found


def _changed(marked: Sequence[NumberedChanges]) -> str:
    count = sum(len(mark.changes) for mark in marked)
    if not count:
        return ''
    return f'There {"were" if count > 1 else "was"} {_counted(count)} on the way.'


def _counted(count: int) -> str:
    return f'{count} changes of parameters' if count > 1 else 'one change of a parameter'


def _listed(items: Sequence[str]) -> str:
    return ', '.join(items[:-1]) + ' and ' + items[-1] if len(items) > 1 else items[0]
