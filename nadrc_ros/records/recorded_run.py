"""A recorded run as it was read, and all that follows from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import nan
from pathlib import Path
from typing import Any
from zlib import crc32

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.angles import short_way, unwrapped
from nadrc_ros.records.figures import Figures, figures_of
from nadrc_ros.records.history import Change, Event, History
from nadrc_ros.records.recording import RecordingError, RunSettings
from nadrc_ros.records.states import Lasting, states
from nadrc_ros.scenario.units import Units
from nadrc_ros.simulation.metrics import MetricValues
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
# Share of a log that is not yet settled, where nobody said when it is.
_UNSETTLED_SHARE = 0.1
# Of logs that have no number of their color: those of solid lines.
_NAMED_COLORS = 6
# What b0_source of a controller is among the columns.
_GAIN_COLUMNS = {'measurement': 'output_estimate', 'reference': 'tracking'}


@attrs.frozen(kw_only=True, eq=False, slots=False)
class RecordedRun:
    """
    What was recorded of one loop; arrays have a value for each row, (N,), nan where there is none.

    Attributes
    ----------
    path
        Where it was read from.
    rate
        Measurements per second [Hz]: the nominal rate, where nobody told it that of their times.
    columns
        By the names of ``samples.csv``: ``time`` [s], ``reference``, ``measurement``, ``command``
        always, others if they were recorded. A measurement that was lost leaves a gap in ``time``
        and has no row.
    stop
        Until when the log goes on [s], with rows or without.
    summary
        The recorder's summary, empty if there is none.
    told
        How a file was understood that does not say so itself, '' for others.
    figures
        What a recorder of this package was asked its figures of merit to be, None for other logs.
    history
        What was recorded besides the samples.
    true_for_controller
        Whether ``total_disturbance`` among the columns is for the b0 of the controller.
    part
        Whether it is a part of what was recorded: figures and events are those of its time.

    """

    path: Path
    rate: float
    stop: float
    columns: dict[str, Array]
    summary: dict[str, Any]
    told: str = ''
    figures: RunSettings | None = None
    history: History = attrs.field(factory=History)
    true_for_controller: bool = False
    part: bool = False

    def column(self, name: str) -> Array:
        """Return a column, not-a-number where it was not recorded."""
        return self.columns.get(name, np.full(len(self.time), np.nan))

    @property
    def time(self) -> Array:
        """Return the time of each row [s]."""
        return self.columns['time']

    @property
    def reference(self) -> Array:
        """Return the reference of each row."""
        return self.columns['reference']

    @property
    def command(self) -> Array:
        """Return the command of each row."""
        return self.columns['command']

    @property
    def output(self) -> Array:
        """Return the true output, or the measurement where there is none."""
        output = self.column('output')
        return np.where(np.isnan(output), self.columns['measurement'], output)

    @property
    def knows_output(self) -> bool:
        """Tell whether the true output is known, not the measurement alone."""
        return bool(np.isfinite(self.column('output')).any())

    @property
    def disturbance_estimate(self) -> Array:
        """Return the sum of the levels."""
        return self.column('disturbance_estimate')

    @property
    def levels(self) -> list[str]:
        """Return the names of the columns of the levels that have numbers."""
        names = [name for name in self.columns if name.startswith('level_')]
        return [name for name in names if np.isfinite(self.columns[name]).any()]

    @property
    def error(self) -> Array:
        """Return the error of the figures of merit."""
        followed = self.column('tracking')
        if self.figure_settings.error == 'reference':
            followed = np.where(np.isnan(self.reference), followed, self.reference)
        return short_way(followed - self.output, self.measurement_period)

    @property
    def measurement_period(self) -> float:
        """Return the period of an angle, 0 of what is none, or where nobody told."""
        told = self.history.measurement_period()
        return self.figure_settings.measurement_period or told or 0.0

    def unwrapped(self) -> RecordedRun:
        """Return the run of an angle as one that turns on, to draw it; another as it is."""
        period = self.measurement_period
        return attrs.evolve(self, columns=unwrapped(self.columns, period)) if period else self

    # ---- besides the samples ----

    @property
    def color(self) -> int:
        """Return the number that its recorder gave its color; of other logs one of their name."""
        told = self.history.about.get('color')
        return told if isinstance(told, int) else crc32(self.path.name.encode()) % _NAMED_COLORS

    @property
    def units(self) -> Units:
        """Return the units that its recorder was told; a record may hold anything."""
        told = self.history.about.get('units')
        try:
            return Units(**told) if isinstance(told, dict) else Units()
        except (TypeError, UserError):
            return Units()

    def unit(self, column: str) -> str:
        """Return the unit of a signal, '' if it is not known."""
        settings = self.history.controller_settings()
        return self.units.of(column, settings[0][1].plant_order if settings else 0)

    @property
    def states(self) -> list[Lasting]:
        """Return what the controller did from when to when, as far as it told."""
        return states(self.history.events, float(self.time[0]), self.end)

    @property
    def end(self) -> float:
        """Return when the last row is over, or the log goes on [s]."""
        return max(self.stop, float(self.time[-1]))

    @property
    def changes(self) -> list[Change]:
        """Return the changes of parameters on the way, those during a part of a run."""
        first, last = self.time[0], self.time[-1]
        found = self.history.changes
        return [each for each in found if not self.part or first <= each.time <= last]

    @property
    def events(self) -> list[Event]:
        """Return what happened before and during the run, that during a part of a run."""
        first, last = self.time[0], self.time[-1]
        found = self.history.events
        return [
            e for e in found if not self.part or (e.time is not None and first <= e.time <= last)
        ]

    @cached_property
    def gains(self) -> tuple[Sequence[tuple[float, float]], Sequence[tuple[float, float]]]:
        """Return b0 of plant and controller with the times [s] from which they held, if known."""
        settings = self.history.controller_settings()
        return self.history.plant_gain(), [(time, each.b0) for time, each in settings]

    @property
    def referred(self) -> bool:
        """Tell whether :attr:`total_disturbance` is that for the b0 of the controller."""
        return self.true_for_controller or all(self.gains)

    @cached_property
    def total_disturbance(self) -> Array:
        """
        Return the truth, y^(n) - b0 u, for b0 of the controller, or of the plant if unknown.

        With known poles of the controller it is that of :func:`modelled`, with a table of b0 that
        of :func:`scheduled`.
        """
        truth = self.column('total_disturbance')
        if self.true_for_controller or not self.referred:
            return truth
        settings = self.history.controller_settings()
        truth = referred(self.time, self._acted, truth, *self.gains)
        truth = scheduled(self.columns, self._acted, truth, settings)
        return modelled(self.time, self.output, truth, settings)

    @property
    def _acted(self) -> Array:
        """Return the command that reached the plant at each row."""
        return reached(self.time, self.command, *self.history.plant_delay())

    # ---- figures ----

    @property
    def figure_settings(self) -> RunSettings:
        """Return what the figures of merit are asked to be."""
        return self.figures or RunSettings(
            settle_time=_UNSETTLED_SHARE * float(self.time[-1] - self._start)
        )

    @property
    def metrics(self) -> MetricValues:
        """Return the figures of merit, from the samples: those of the recorder, to the bit."""
        return self._sums.values()

    @property
    def gap_time(self) -> float:
        """Return the time that no figure counts, as nothing is known of it [s]."""
        return self._sums.gap_time

    @property
    def figure_gaps(self) -> list[tuple[float, float]]:
        """Return from when to when [s] there is no row that counts in a figure."""
        return [(self._start + begin, self._start + end) for begin, end in self._sums.gaps]

    @property
    def gaps(self) -> int:
        """Return how many periods have no measurement."""
        measured = self.time[np.isfinite(self.columns['measurement'])]
        periods = np.rint(np.diff(measured) * self.rate).sum()
        if measured.size:  # one at the very end is not of this run any more
            periods += max(0.0, np.rint((self.stop - measured[-1]) * self.rate) - 1.0)
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
        followed = np.rint(np.diff(self.time) * self.rate) == 1.0
        return np.asarray(spans[followed & np.isfinite(spans)])

    @property
    def _start(self) -> float:
        return float(self.time[0]) if self.part else 0.0

    @cached_property
    def _sums(self) -> Figures:
        columns = {name: values.tolist() for name, values in self.columns.items()}
        return figures_of(columns, self.figure_settings, self.history, self._start, self.stop)


def window(run: RecordedRun, begin: float | None, end: float | None) -> RecordedRun:
    """
    Return the rows from ``begin`` to ``end`` [s], with their times; all of them without these.

    Raises
    ------
    RecordingError
        When there are none.

    """
    if begin is None and end is None:
        return run
    time = run.time
    low, high = time[0] if begin is None else begin, run.stop if end is None else end
    inside = (time >= low) & (time <= high)
    if not inside.any():
        raise RecordingError(
            f'no row from {low:g} to {high:g} s: the run has {time[0]:g} to {time[-1]:g} s'
        )
    columns = {name: column[inside] for name, column in run.columns.items()}
    return attrs.evolve(run, stop=min(run.stop, high), columns=columns, part=True)


def referred(
    time: npt.ArrayLike,
    command: npt.ArrayLike,
    truth: npt.ArrayLike,
    plant: Sequence[tuple[float, float]],
    controller: Sequence[tuple[float, float]],
) -> Array:
    """
    Return the total disturbance for the b0 of the controller, L = y^(n) - b0 u.

    ``command`` is u as it reached the plant, ``truth`` the same for the b0 of the plant; ``plant``
    and ``controller`` hold both gains with the times [s] from which they held.
    """
    gain = sampled(plant, time) - sampled(controller, time)
    return np.asarray(np.asarray(truth) + gain * np.asarray(command))


def reached(time: Array, command: Array, delay: float, before: float) -> Array:
    """Return the command that was there ``delay`` [s] before each time, ``before`` the first."""
    if delay == 0.0:
        return command
    sent = np.searchsorted(time, time - delay * (1.0 - 1e-9), 'right') - 1
    return np.where(sent < 0, before, command[sent])


def scheduled(
    columns: Mapping[str, Array],
    command: Array,
    truth: Array,
    controllers: Sequence[tuple[float, ControllerSettings]],
) -> Array:
    """
    Return the total disturbance for the b0 that the controller looked up, where it has a table.

    ``command`` is u as it reached the plant, ``truth`` is for the b0 of the settings, which have
    the times [s] from which they held. What b0 is over was not recorded if it has a topic: then it
    is not-a-number. How fast b0 may move is left out.
    """
    result = np.array(truth)
    held = sampled(
        [(start, float(i)) for i, (start, _) in enumerate(controllers)], columns['time']
    )
    for i, (_, settings) in enumerate(controllers):
        table, rows = settings.b0_table, held == i
        if len(table) > 1:
            x = columns.get(_GAIN_COLUMNS.get(settings.b0_source, ''), np.full(len(held), nan))
            if settings.measurement_period > 0.0:
                x = table[0] + np.mod(x - table[0], settings.measurement_period)
            gain = np.interp(x[rows], table[::2], table[1::2])
            result[rows] += (settings.b0 - gain) * command[rows]
    return result


def modelled(
    time: npt.ArrayLike,
    output: Array,
    truth: Array,
    controllers: Sequence[tuple[float, ControllerSettings]],
) -> Array:
    """
    Return the total disturbance for the known poles, y^(n) + a_{n-1} y^(n-1) + ... - b0 u.

    Of order 1 that is a_0 y more than ``truth``. Of higher orders it is not-a-number while the
    settings, with the times [s] from which they held, have any: no record has y', y'', ...
    """
    shares = [(start, _share_of_output(settings)) for start, settings in controllers]
    share = sampled(shares, time)
    return np.where(share == 0.0, truth, truth + share * output)


def _share_of_output(settings: ControllerSettings) -> float:
    if not any(settings.plant_poles):
        return 0.0
    return -settings.plant_poles[0] if settings.plant_order == 1 else nan


def sampled(steps: Sequence[tuple[float, float]], time: npt.ArrayLike) -> Array:
    """Return what holds at each time [s]; before the first step that one."""
    starts = np.array([start for start, _ in steps])
    values = np.array([value for _, value in steps])
    return np.asarray(values[np.maximum(np.searchsorted(starts, time, 'right') - 1, 0)])
