"""The figures of merit of a recorded run, from its rows: live, at its end and from its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, isfinite, isnan, nan
from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.angle import short
from nadrc_ros.records.history import History, read_history
from nadrc_ros.records.recording import (
    read_columns,
    read_settings,
    read_summary,
    RecordingError,
    RunSettings,
    SAMPLES,
    stop_of,
)
from nadrc_ros.records.spacing import Spacing
from nadrc_ros.simulation.metrics import Metrics, MetricValues, SETTLED

# So many rows are kept until a controller tells whether they are of an angle.
_MOST_UNTOLD = 10_000


class Figures:
    """
    The figures of merit of rows in order of time, each of which counts until the next one.

    With a rate, as in lockstep, each counts for a period. Without, the last one counts for the
    usual spacing, as does one before a gap: what nobody measured is in no figure, but in
    ``gap_time``.

    Where the settings name no limit of the command and no period of an angle, the history may:
    what the controllers told. Rows from before a period was told are counted anew.

    Attributes
    ----------
    rows
        How many rows there were.
    periods
        How many there would have been without gaps.
    last
        Time of the last row [s].
    gap_time
        Time that is in no figure [s].
    gaps
        From when to when that was [s].
    stop
        When the run ended [s], None where that is not known.

    """

    def __init__(self, settings: RunSettings, history: History | None = None) -> None:
        self.settings = settings
        self._history = history or History()
        self._lowest, self._highest = _Largest(), _Largest()
        self.rows = 0
        self.gap_time = 0.0
        self.gaps: list[tuple[float, float]] = []
        self.stop: float | None = None
        self._metrics = Metrics(settings.settle_time or inf)
        self._spacing = Spacing()
        self._waiting: tuple[float, Mapping[str, float]] | None = None
        self._period: float | None = settings.measurement_period or None
        self._untold: list[tuple[float, float, float, float, bool]] = []
        self._passed = self._regular = 0
        self._lasted = 0.0
        self.last = 0.0

    def add(self, t: float, values: Mapping[str, float]) -> None:
        """Add the row of time ``t`` [s]."""
        self.rows += 1
        self.last = t
        if self.settings.settle_time and not self.settings.rate:
            # the row of that instant counts, a little early or late
            self._metrics.settle_from(self.settings.settle_time - 0.5 * self._spacing.usual)
        if self.settings.rate:
            self._count(t, 1.0 / self.settings.rate, values)
            return
        if self._waiting is not None:
            self._count(self._waiting[0], self._length(self._waiting[0], t), self._waiting[1])
        self._waiting = t, values

    def end(self, stop: float | None = None) -> None:
        """Count the last row, too, and what was missing from there to the time ``stop`` [s]."""
        self.stop = stop
        if self._waiting is None:
            return
        (t, values), usual = self._waiting, self._spacing.usual
        self._waiting = None
        self._count(t, usual, values)
        span = 0.0 if stop is None else stop - t
        if self._spacing.is_gap(span):
            self._skip(t + usual, t + span)
            self._passed += round(span / usual) - 1

    def values(self) -> MetricValues:
        """Return the figures so far; without known limits nobody knows what was saturated."""
        found = self._metrics.values()
        if self.settings.knows_limits:
            return found
        return attrs.evolve(found, saturated_fraction=self._told_fraction(found.duration))

    @property
    def rate(self) -> float:
        """Return the rows per second without gaps [Hz], 0 before the second one."""
        return self.settings.rate or (self._regular / self._lasted if self._lasted else 0.0)

    @property
    def periods(self) -> int:
        """Return how many rows there would have been without gaps."""
        passed = round(self.last * self.settings.rate) if self.settings.rate else self._passed
        return max(passed + 1, self.rows) if self.rows else 0

    def _told_fraction(self, duration: float) -> float:
        """
        Return the share of the time at the limits that the controllers told, nan without any.

        They may be told long after the first row, so that only the ends of the command were noted:
        those are the limits, or inside them, unless somebody else commanded.
        """
        limits = self._history.command_limits()
        if limits is None or not duration:
            return nan
        low, high = limits
        if -self._lowest.value < low or self._highest.value > high:
            return nan
        at_low = self._lowest.time if -self._lowest.value == low else 0.0
        at_high = self._highest.time if self._highest.value == high else 0.0
        return (at_low + at_high) / duration

    def _skip(self, begin: float, end: float) -> None:
        self.gaps.append((begin, end))
        self.gap_time += end - begin

    def _length(self, begin: float, end: float) -> float:
        """Return for how long [s] the row at ``begin`` counts, the next one being at ``end``."""
        span = end - begin
        # The bound is that of the rows before: a gap must not widen what counts as one.
        gap, length = self._spacing.is_gap(span), span
        if gap:
            length = self._spacing.usual
            self._skip(begin + length, end)
        self._spacing.add(span)
        periods = round(span / self._spacing.usual)  # none for a sample that came twice
        self._passed += periods
        if not gap:
            self._regular += periods
            self._lasted += span
        return length

    def _count(self, t: float, h: float, values: Mapping[str, float]) -> None:
        """Count a row for ``h`` [s]; without a true output the measurement stands for it."""
        command = values['command']
        followed = values.get('tracking', nan)
        if self.settings.error == 'reference' and not isnan(values['reference']):
            followed = values['reference']
        output = values.get('output', nan)
        if isnan(output):
            output = values['measurement']
        saturated = command <= self.settings.command_min or command >= self.settings.command_max
        error = followed - output
        if self._period is None:
            self._seek_period()
        if self._period is None:
            self._untold.append((t, h, error, command, saturated))
        error = short(error, self._period or 0.0)
        self._metrics.add(t, h, error, command, saturated)
        if isfinite(error) and isfinite(command):  # else it is in no figure
            self._lowest.add(-command, h)
            self._highest.add(command, h)

    def _seek_period(self) -> None:
        """Take the period that was told meanwhile, and count the rows before it by it."""
        self._period = self._history.measurement_period()
        if self._period is None and len(self._untold) >= _MOST_UNTOLD:
            self._period = 0.0
        if self._period:
            self._metrics = Metrics(self._metrics.sums[SETTLED])
            for t, h, error, command, saturated in self._untold:
                self._metrics.add(t, h, short(error, self._period), command, saturated)
        if self._period is not None:
            self._untold.clear()


class _Largest:
    """The largest of some values, and for how long it was there [s]."""

    def __init__(self) -> None:
        self.value = -inf
        self.time = 0.0

    def add(self, value: float, h: float) -> None:
        if value > self.value:
            self.value, self.time = value, 0.0
        if value == self.value:
            self.time += h


def summary(figures: Figures) -> dict[str, Any]:
    """
    Return what every summary has, whoever makes it.

    There are fewer ``rows`` than ``periods`` where there was nothing to make them of. The run
    went on until ``stop``, with or without rows; None where nobody knows.
    """
    return {
        'metrics': figures.values().as_dict(),
        'rows': figures.rows,
        'periods': figures.periods,
        'rate': figures.rate,
        'error': figures.settings.error,
        'gap_time': figures.gap_time,
        'stop': figures.stop,
    }


def figures_of(
    columns: Mapping[str, Sequence[float]],
    settings: RunSettings,
    history: History,
    start: float = 0.0,
    stop: float | None = None,
) -> Figures:
    """Return the figures of whole columns, which count from the time ``start`` [s] on."""
    figures = Figures(settings, history)
    for row in zip(*columns.values()):
        values = dict(zip(columns, row))
        figures.add(values['time'] - start, values)
    figures.end(None if stop is None else stop - start)
    return figures


def summarise(folder: Path) -> dict[str, Any]:
    """
    Return the summary that the samples of a run amount to, with the recorder's own figures.

    What they do not tell is None: how many samples were lost (a gap in time may be a measurement
    that was never sent), and whether the run was complete.

    Raises
    ------
    RecordingError, SettingError
        For files that are not those of a run, or a run without samples.
    OSError
        For a file that cannot be read.

    """
    if folder.exists() and not (folder / SAMPLES).is_file():
        raise RecordingError(f'not the folder of a run: there is no {SAMPLES} in it')
    settings, (columns, cut) = read_settings(folder), read_columns(folder)
    stop = stop_of(read_summary(folder))
    return summary(figures_of(columns, settings, read_history(folder), stop=stop)) | {
        'samples_lost': None,
        'samples_lost_by_signal': None,
        'commands_before': None,
        'complete': False if cut else None,
    }
