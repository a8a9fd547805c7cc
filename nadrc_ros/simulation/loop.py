"""The closed loop as a state that goes on period by period: at t_k measure, decide, hold."""

from __future__ import annotations

from collections.abc import Callable
from math import nan

import attrs
from nadrc_ros.adrc.angle import short
from nadrc_ros.adrc.cascade import Cascade, loops_of
from nadrc_ros.adrc.settings import ControllerSettings, MAX_LEVELS, REFERENCE_DERIVATIVES
from nadrc_ros.adrc.state import damping, known_before
from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.faults import first_period, SentSample
from nadrc_ros.simulation.metrics import accumulate_remainders, Metrics
from nadrc_ros.simulation.plant_run import signal_block
from nadrc_ros.simulation.protocols import sample_time, Signal
from nadrc_ros.simulation.signals import Nothing
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
# A row: these, then one estimate per level, then of each inner loop of a cascade its own columns.
COLUMNS = (
    *('time', 'reference', 'tracking', 'output', 'measurement', 'command'),
    *('output_estimate', 'disturbance_estimate', 'total_disturbance'),
)
FIRST_LEVEL = len(COLUMNS)
ROW_WIDTH = FIRST_LEVEL + MAX_LEVELS
INNER_COLUMNS = ('reference', 'output', 'measurement')
# Periods between two draws of noise: the memory of a run of any length.
_NOISE_BLOCK = 8192

# kernel(loop, stop, rows) advances the loop towards period ``stop``, up to which no setting
# changes and there is noise. It stops before a period it cannot do, and after one in which the
# mode of the controller or its cause changed, and returns False when it cannot go on at all; the
# loop is then as it was.
Kernel = Callable[['Loop', int, Array], bool]


class Loop:
    """
    One run of one controller, or of those of a cascade, in an experiment.

    Attributes
    ----------
    plant_run, controller
        The plant, with the number k of the next period, and what commands it.
    cascade
        That controller as the innermost loop, with those around it: the first one follows the
        reference.
    derivatives
        Which derivative of the output each inner loop of it controls.
    metrics
        The figures of merit so far.
    remainders
        The sums of :func:`~nadrc_ros.simulation.metrics.accumulate_remainders`.
    modes
        Mode and cause of the innermost controller with the times [s] from which they held.
    levels
        The largest number of levels that was in use.
    noise, inner_noise, fed, noise_start
        A block of noise, of the output and for each inner loop, and of the feed-forward, which is
        0 where the controller listens to none; and its first period.

    """

    def __init__(self, experiment: Experiment, settings: ControllerSettings) -> None:
        self.experiment = experiment
        self.cascade = Cascade(settings, checked=not experiment.faults.blind)
        self.controller = self.cascade.loops[-1]
        self.plant_run = experiment.plant_run(self.controller.settings.safe_command)
        orders = [each.plant_order for each in loops_of(settings)]
        self.derivatives = [sum(orders[: i + 1]) for i in range(len(orders) - 1)]
        self.metrics = Metrics(experiment.settled)
        self.remainders = [0.0] * MAX_LEVELS
        self.modes: list[tuple[float, Mode, Cause]] = []
        self.levels = self.controller.design.levels
        self.noise = np.zeros(0)
        self.inner_noise = [np.zeros(0) for _ in self.derivatives]
        self.fed = np.zeros(0)
        self.acting: float | None = None
        self.noise_start = 0
        self._newest = SentSample(nan, -1.0, -2)  # the first period is not as the others
        self._settings = settings
        own = self.controller.settings
        self._listens, self._fed = own.applied_timeout > 0.0, own.feed_forward_timeout > 0.0
        self._feed_forward = experiment.feed_forward if self._fed else Nothing()
        self._changes = [
            (first_period(retune.time, experiment.rate), retune.settings)
            for retune in sorted(experiment.retunes, key=lambda retune: retune.time)
        ]

    def run(self, rows: Array, kernel: Kernel | None = None) -> None:
        """
        Go on to the end, writing a row per period if ``rows`` (steps, :func:`row_width`) has any.

        Periods that the kernel leaves are done here: those in which settings change or something
        goes wrong.
        """
        # The kernel knows of one sample a period, in time, and of one span, h. It may therefore
        # not begin where the sample before was lost or late: the next one spans more than h.
        steps, plant_run = self.experiment.steps, self.plant_run
        while plant_run.k < steps:
            drawn = self.noise_start + len(self.noise)
            if plant_run.k == drawn:
                count = min(_NOISE_BLOCK, steps - drawn)
                self.noise = plant_run.noise_block(drawn, count)
                self.inner_noise = [
                    plant_run.derivative_noise_block(m, drawn, count) for m in self.derivatives
                ]
                self.fed = signal_block(self._feed_forward, drawn, count, self.experiment.rate)
                self.noise_start = drawn
                drawn += len(self.noise)
            if kernel is not None and self._regular():
                stop = min(drawn, plant_run.faults.next_begin(plant_run.k))
                stop = min(stop, self._changes[0][0]) if self._changes else stop
                begin = plant_run.k
                if plant_run.k < stop and not kernel(self, stop, rows):
                    kernel = None
                if plant_run.k > begin:
                    self._note_mode((plant_run.k - 1) / self.experiment.rate)
                self._newest = SentSample(nan, plant_run.k - 1.0, plant_run.k - 1)
                self.acting = self.controller.command
                if plant_run.k == drawn:
                    continue
            self._period(rows)
            self._note_mode((plant_run.k - 1) / self.experiment.rate)

    def _note_mode(self, time: float) -> None:
        now = self.controller.policy[:2]
        if not self.modes or self.modes[-1][1:] != now:
            self.modes.append((time, Mode(now[0]), Cause(now[1])))

    def _regular(self) -> bool:
        """Tell whether this period has its one sample, as the one before had."""
        k = self.plant_run.k
        usual = self._newest.number == k - 1 == self._newest.stamp
        told = self.acting if self._listens else None
        usual = usual and told in (None, self.controller.command)
        return usual and not self.plant_run.faults.acts(k)

    def _period(self, rows: Array) -> None:
        """Advance by one period in plain Python."""
        experiment, plant_run, controller = self.experiment, self.plant_run, self.controller
        outer, *inner = self.cascade.loops
        k, h = plant_run.k, experiment.period
        t = k / experiment.rate
        while self._changes and self._changes[0][0] <= k:
            self._settings = attrs.evolve(self._settings, **self._changes.pop(0)[1])
            controller.retune(self._settings)
        r = sample_reference(experiment.reference, k, experiment.rate, experiment.reference_rate)
        if experiment.reference_alone:
            del r[1:]
        y = plant_run.output
        at = k - self.noise_start
        shown = plant_run.measured(float(self.noise[at]))
        measurement, dt = self._take(plant_run.faults.deliver(k, shown))
        rates = [plant_run.state[m] for m in self.derivatives]
        measured = [rate + float(noise[at]) for rate, noise in zip(rates, self.inner_noise)]
        spans = [dt] + [h] * len(inner)
        u = self.cascade.tick(
            [measurement, *measured],
            spans,
            elapsed=h,
            reference=r,
            applied=self.acting if self._listens else None,
            feed_forward=float(self.fed[at]) if self._fed else None,
        )
        self.acting = acting = plant_run.faults.act(k, u)
        followed = r[0] if experiment.error == 'reference' else outer.tracking
        now = controller.settings
        saturated = u <= now.command_min or u >= now.command_max
        reached, acting = plant_run.reach(u, acting)
        truth = plant_run.total_disturbance(reached, acting)
        truth += (plant_run.plant.b0 - controller.b0) * reached
        if controller.design.known:  # the first states of a plant are y, y', ...
            truth += damping(controller.design, plant_run.state, (0, *self.derivatives)[-1])
        error = short(followed - y, outer.design.measurement_period)
        self.metrics.add(t, h, error, u, saturated)
        left = truth - known_before(controller.design, controller.state)
        levels, estimates = controller.design.levels, controller.disturbances
        accumulate_remainders(left, estimates, levels, t, h, self.remainders)
        self.levels = max(self.levels, controller.design.levels)
        if len(rows):
            row = (
                t,
                r[0],
                outer.tracking,
                y,
                measurement,
                u,
                outer.output_estimate,
                controller.total_disturbance,
                truth,
                *controller.disturbances,
            )
            rows[k, : len(row)] = row
            for i, loop in enumerate(inner):
                first = ROW_WIDTH + i * len(INNER_COLUMNS)
                rows[k, first : first + len(INNER_COLUMNS)] = (
                    loop.reference[0],
                    rates[i],
                    measured[i],
                )
        plant_run.advance(acting)

    def _take(self, samples: list[SentSample]) -> tuple[float, float]:
        """Return the newest sample that arrived, nan if none did, and the time it spans [s]."""
        if not samples:
            return nan, 0.0
        sample, before = max(samples, key=lambda each: each.number), self._newest
        dt = (sample.stamp - before.stamp) * self.experiment.period
        if sample.number <= before.number:  # late, or twice: the law must refuse it by its time,
            return sample.value, min(dt, 0.0)  # also where a clock that jumped stamped it ahead
        self._newest = sample
        return sample.value, dt


def row_width(settings: ControllerSettings) -> int:
    """Return how many entries a row of these controllers has."""
    return ROW_WIDTH + len(INNER_COLUMNS) * (len(loops_of(settings)) - 1)


def sample_reference(signal: Signal, k: int, rate: float, own_rate: float = 0.0) -> list[float]:
    """
    Return r, r', r'' at t_k = k / rate: what the reference topics carry.

    With an ``own_rate`` those of its last sample, at a multiple of 1 / own_rate.
    """
    out = [0.0] * (REFERENCE_DERIVATIVES + 1)
    signal.derivatives(sample_time(k, rate, own_rate), out)
    return out
