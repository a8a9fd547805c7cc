"""The figures of merit of a recorded run, from its rows: live, at its end and from its files."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isnan, nan

import attrs
from nadrc_ros.adrc.fields import choice, number
from nadrc_ros.adrc.settings import LARGEST, LONGEST, SMALLEST
from nadrc_ros.records.spacing import Spacing
from nadrc_ros.simulation.metrics import Metrics, MetricValues


@attrs.frozen(kw_only=True)
class FigureSettings:
    """What the figures of merit need to know besides the samples."""

    error: str = choice(
        'reference',
        ('reference', 'tracking'),
        'error of the metrics: reference - output, or ~/tracking of the controller - output',
        live=False,
    )
    command_min: float = number(
        SMALLEST,
        SMALLEST,
        LARGEST,
        'command unit',
        'lower limit, for the saturated fraction',
        live=False,
    )
    command_max: float = number(
        LARGEST,
        SMALLEST,
        LARGEST,
        'command unit',
        'upper limit, for the saturated fraction',
        live=False,
    )
    settle_time: float = number(
        0.0,
        0.0,
        LONGEST,
        's',
        'from when on peak_error counts; 0 = a tenth of duration, never without one',
        live=False,
    )

    @property
    def knows_limits(self) -> bool:
        """Tell whether a limit of the command is known."""
        return (self.command_min, self.command_max) != (SMALLEST, LARGEST)


@attrs.frozen(kw_only=True)
class RunSettings(FigureSettings):
    """What ``run.json`` has: enough to compute the figures of merit from the samples."""

    rate: float = number(
        0.0, 0.0, 1e5, 'Hz', 'rows per second where they are periods; 0 = as their times say'
    )


class Figures:
    """
    The figures of merit of rows in order of time, each of which counts until the next one.

    With a rate, as in lockstep, each counts for a period. Without, the last one counts for the
    usual spacing, as does one before a gap: what nobody measured is in no figure, but in
    ``gap_time``.

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
    stop
        When the run ended [s], None where that is not known.

    """

    def __init__(self, settings: RunSettings) -> None:
        self.settings = settings
        self.rows = 0
        self.gap_time = 0.0
        self.stop: float | None = None
        self._metrics = Metrics(settings.settle_time or inf)
        self._spacing = Spacing()
        self._waiting: tuple[float, Mapping[str, float]] | None = None
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
            self._count(self._waiting[0], self._length(t - self._waiting[0]), self._waiting[1])
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
            self.gap_time += span - usual
            self._passed += round(span / usual) - 1

    def values(self) -> MetricValues:
        """Return the figures so far; without known limits nobody knows what was saturated."""
        found = self._metrics.values()
        return found if self.settings.knows_limits else attrs.evolve(found, saturated_fraction=nan)

    @property
    def rate(self) -> float:
        """Return the rows per second without gaps [Hz], 0 before the second one."""
        return self.settings.rate or (self._regular / self._lasted if self._lasted else 0.0)

    @property
    def periods(self) -> int:
        """Return how many rows there would have been without gaps."""
        passed = round(self.last * self.settings.rate) if self.settings.rate else self._passed
        return max(passed + 1, self.rows) if self.rows else 0

    def _length(self, span: float) -> float:
        """Return for how long a row counts after which the next one came ``span`` later [s]."""
        gap, length = self._spacing.is_gap(span), span
        if gap:
            length = self._spacing.usual
            self.gap_time += span - length
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
        self._metrics.add(t, h, followed - output, command, saturated)
