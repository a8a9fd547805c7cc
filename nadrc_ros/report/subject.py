"""What a report is about: recorded runs by name, with all that is derived from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.figures import Figures
from nadrc_ros.records.history import History, read_history
from nadrc_ros.records.recorded_run import OWN, read_run, RecordedRun
from nadrc_ros.records.recording import (
    read_settings,
    RecordingError,
    RunSettings,
    SAMPLES,
    SETTINGS,
)
from nadrc_ros.records.shaping import window
from nadrc_ros.records.source import Source
from nadrc_ros.report.columns import Array, Trace
from nadrc_ros.report.timeline import controller_settings, plant_gain, referred, Steps
from nadrc_ros.simulation.metrics import MetricValues
import numpy as np

# Share of a bag that is not yet settled.
START = 0.1


@attrs.frozen(kw_only=True, eq=False)
class Subject:
    """
    One run of a report.

    Attributes
    ----------
    run, history
        What was recorded.
    figures
        What the figures of merit were asked to be.
    metrics
        The figures of merit, from the samples: those of the recorder, to the bit.
    gap_time
        Time that no figure counts, as nothing is known of it [s].
    settings
        Of the controller, with the times from which they held; empty where not recorded.
    truth
        The true total disturbance (N,), for the b0 of the controller where that and the plant's
        are known; not-a-number where there is none.
    referred
        Whether they are known.

    """

    run: RecordedRun
    history: History
    figures: RunSettings
    metrics: MetricValues
    gap_time: float
    settings: Steps[ControllerSettings]
    truth: Array
    referred: bool

    @property
    def time(self) -> Array:
        """Return the time of each row [s]."""
        return self.run.columns['time']

    @property
    def command(self) -> Array:
        """Return the command of each row."""
        return self.run.columns['command']

    @property
    def output(self) -> Array:
        """Return the true output, or the measurement where there is none."""
        output = self.column('output')
        return np.where(np.isnan(output), self.run.columns['measurement'], output)

    @property
    def knows_output(self) -> bool:
        """Tell whether the true output is known, not the measurement alone."""
        return bool(np.isfinite(self.column('output')).any())

    @property
    def error(self) -> Array:
        """Return the error of the figures of merit."""
        reference, followed = self.run.columns['reference'], self.column('tracking')
        if self.figures.error == 'reference':
            followed = np.where(np.isnan(reference), followed, reference)
        return followed - self.output

    @property
    def levels(self) -> list[str]:
        """Return the names of the columns of the levels that have numbers."""
        names = [name for name in self.run.columns if name.startswith('level_')]
        return [name for name in names if np.isfinite(self.run.columns[name]).any()]

    @property
    def is_folder(self) -> bool:
        """Tell whether a recorder of this package wrote it."""
        return (self.run.path / SETTINGS).is_file()

    @property
    def gaps(self) -> int:
        """Return how many periods have no measurement."""
        measured = self.time[np.isfinite(self.run.columns['measurement'])]
        periods = np.rint(np.diff(measured) * self.run.rate).sum()
        if measured.size:  # one at the very end is not of this run any more
            periods += max(0.0, np.rint((self.run.stop - measured[-1]) * self.run.rate) - 1.0)
        return max(0, int(periods) + 1 - len(measured))

    @property
    def latency(self) -> Array:
        """Return the times from a measurement to the command in reply [s], where there was one."""
        between = self.column('command_stamp') - self.column('measurement_stamp')
        return np.asarray(between[between >= 0.0])

    @property
    def periods(self) -> Array:
        """Return the times between measurements that followed each other [s], by their stamps."""
        spans = np.diff(self.column('measurement_stamp'))
        followed = np.rint(np.diff(self.time) * self.run.rate) == 1.0
        return np.asarray(spans[followed & np.isfinite(spans)])

    def figure_of_merit(self, name: str) -> float | None:
        """Return one of the figures, None where the run does not tell it."""
        value = float(getattr(self.metrics, name))
        return None if isnan(value) else value

    def column(self, name: str) -> Array:
        """Return a column, not-a-number where it was not recorded."""
        return self.run.columns.get(name, np.full(len(self.time), np.nan))

    def trace(self) -> Trace:
        """Return what a picture needs."""
        return Trace(
            time=self.time,
            reference=self.column('reference'),
            output=self.output,
            command=self.command,
            disturbance_estimate=self.column('disturbance_estimate'),
            total_disturbance=self.truth,
        )


def comparable(subjects: Mapping[str, Subject]) -> bool:
    """Tell whether integrals over the runs compare: whether these are of one length."""
    longest = max(subject.metrics.duration for subject in subjects.values())
    within = [subject.metrics.duration >= 0.99 * longest for subject in subjects.values()]
    return all(within)


def read_subjects(
    paths: Sequence[Path],
    source: Source = OWN,
    begin: float | None = None,
    end: float | None = None,
) -> dict[str, Subject]:
    """
    Read runs, and name them by what tells them apart; ``source`` is for bags and CSV files.

    Of each counts what is from ``begin`` to ``end`` [s]; the figures of merit count the time from
    there.

    Raises
    ------
    UserError
        For what is not a run; the message begins with its path.
    OSError
        For a file that cannot be read.

    """
    subjects = []
    for path in dict.fromkeys(paths):
        own = (path / SAMPLES).is_file()
        try:
            run = window(read_run(path, OWN if own else source), begin, end)
            subject = make_subject(run, read_history(path), begin)
            if begin is not None or end is not None:
                subject = attrs.evolve(subject, history=_during(run, subject.history))
            subjects.append(subject)
        except UserError as error:
            raise RecordingError(f'{path}: {error}') from None
    return dict(zip(_names(subjects), subjects))


def make_subject(run: RecordedRun, history: History, begin: float | None = None) -> Subject:
    """Work out what a report shows of a run, or of one that begins at that time [s]."""
    start = 0.0 if begin is None else float(run.columns['time'][0])
    figures = _figures(run, start)
    settings, plant = controller_settings(history), plant_gain(history)
    truth = run.columns.get('total_disturbance', np.full(len(run.columns['time']), np.nan))
    sums, known = _sums(run, Figures(figures, history), start), bool(settings and plant)
    if known:
        gains = [(time, each.b0) for time, each in settings]
        truth = referred(run.columns['time'], run.columns['command'], truth, plant, gains)
    return Subject(
        run=run,
        history=history,
        figures=figures,
        metrics=sums.values(),
        gap_time=sums.gap_time,
        settings=settings,
        truth=truth,
        referred=known,
    )


def _during(run: RecordedRun, history: History) -> History:
    """Return a history without the changes and events that were not during the rows of a run."""
    first, last = run.columns['time'][0], run.columns['time'][-1]
    return attrs.evolve(
        history,
        changes=[each for each in history.changes if first <= each.time <= last],
        events=[e for e in history.events if e.time is not None and first <= e.time <= last],
    )


def _figures(run: RecordedRun, start: float) -> RunSettings:
    if (run.path / SETTINGS).is_file():
        return read_settings(run.path)
    return RunSettings(settle_time=START * (float(run.columns['time'][-1]) - start))


def _sums(run: RecordedRun, found: Figures, start: float) -> Figures:
    columns = {name: values.tolist() for name, values in run.columns.items()}
    for row in zip(*columns.values()):
        values = dict(zip(columns, row))
        found.add(values['time'] - start, values)
    found.end(run.stop - start)
    return found


def _names(subjects: Sequence[Subject]) -> list[str]:
    """Return the first kind of name that is there for all and different for each."""
    kinds: list[Callable[[Subject], str]] = [
        _namespace,
        lambda subject: subject.run.path.resolve().name,
        lambda subject: f'{_namespace(subject)} {subject.run.path.resolve().name}',
        lambda subject: str(subject.run.path),
    ]
    for kind in kinds:
        names = [kind(subject) for subject in subjects]
        if all(names) and len(set(names)) == len(names):
            break
    return names


def _namespace(subject: Subject) -> str:
    about: dict[str, Any] = subject.history.about
    return str(about.get('namespace', '')).strip('/')
