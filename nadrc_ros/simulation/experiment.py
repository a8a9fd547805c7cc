"""An experiment and the closed loop that runs it offline, with the law that the node runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import choice, number
from nadrc_ros.adrc.settings import ControllerSettings, FASTEST_RATE, LONGEST, SLOWEST_RATE
from nadrc_ros.simulation.faults import Faults
from nadrc_ros.simulation.loop import COLUMNS, Kernel, LEVELS, Loop, WIDTH
from nadrc_ros.simulation.metrics import metric_values, MetricValues
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plants import Plant
from nadrc_ros.simulation.process import Process
from nadrc_ros.simulation.signals import Signal
from nadrc_ros.simulation.signals.elementary import Nothing
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
# Plain Python takes some 10 s for that many, numba about as long to compile.
WORTH_COMPILING = 200_000
# Rows of that many periods take 6 GB; :func:`~nadrc_ros.simulation.many.run_metrics` keeps none.
MOST_ROWS = 50_000_000


@attrs.frozen(kw_only=True)
class Retune:
    """A change of controller settings at a time [s], by field name."""

    time: float = number(0.0, 0.0, LONGEST, 's', 'time of the change')
    settings: dict[str, Any] = attrs.field(factory=dict)


@attrs.frozen(kw_only=True)
class Experiment:
    """
    What is done to a controller: plant, signals, noise, faults, rate, duration.

    Raises
    ------
    SettingError
        For a value out of range, fewer than one period, or an initial state of the wrong length.

    """

    plant: Plant
    reference: Signal
    disturbance: Signal
    noise: Noise
    initial_state: tuple[float, ...]
    retunes: tuple[Retune, ...] = ()
    faults: Faults = attrs.field(factory=Faults)
    noise_signal: Signal = attrs.field(factory=Nothing)
    rate: float = number(200.0, SLOWEST_RATE, FASTEST_RATE, 'Hz', 'periods per second')
    duration: float = number(15.0, 1.0 / FASTEST_RATE, LONGEST, 's', 'length of the run')
    error: str = choice(
        'reference', ('reference', 'tracking'), 'error of the metrics: r - y, or r1 - y'
    )
    settle_time: float = number(
        0.0, 0.0, LONGEST, 's', 'from when on peak_error counts; 0 = a tenth of the duration'
    )

    def __attrs_post_init__(self) -> None:
        if self.steps < 1:
            raise SettingError(
                'duration', self.duration, f'at least {self.period!r} s, one period'
            )
        if self.settle_time > self.last:
            raise SettingError(
                'settle_time', self.settle_time, f'at most {self.last:g} s, the last sample'
            )
        if len(self.initial_state) != self.plant.states:
            raise SettingError(
                'initial_state', self.initial_state, f'a list of {self.plant.states} numbers'
            )

    @property
    def period(self) -> float:
        """Sample period h [s]."""
        return 1.0 / self.rate

    @property
    def steps(self) -> int:
        """Return the number of periods N."""
        return round(self.duration * self.rate)

    @property
    def last(self) -> float:
        """Return the time of the last sample [s]."""
        return (self.steps - 1) / self.rate

    @property
    def settled(self) -> float:
        """Return the time from which ``peak_error`` counts [s]."""
        return self.settle_time or min(0.1 * self.duration, self.last)

    def process(self) -> Process:
        """Return the plant at its initial state."""
        return Process(
            self.plant,
            self.disturbance,
            self.noise,
            self.rate,
            self.initial_state,
            self.faults,
            self.noise_signal,
        )


@attrs.frozen(kw_only=True, eq=False)
class Result:
    """
    One run: arrays (N,) over the periods, ``disturbances`` (N, K) one column per level.

    Row k: reference, output and measurement at ``time`` t_k, the ``command`` held from t_k on, and
    the estimates after the sample of t_k. ``total_disturbance`` is the truth for the CONTROLLER's
    b0. A level that was added by a retune is nan before.
    """

    time: Array
    reference: Array
    tracking: Array
    output: Array
    measurement: Array
    command: Array
    output_estimate: Array
    disturbances: Array
    disturbance_estimate: Array
    total_disturbance: Array
    metrics: MetricValues
    status_counts: dict[str, int]


def simulate(
    experiment: Experiment,
    settings: ControllerSettings,
    *,
    compiled: bool | None = None,
    say: Callable[[str], None] | None = None,
) -> Result:
    """
    Run the closed loop offline: at each t_k measure, decide, hold the command until t_k+1.

    Parameters
    ----------
    experiment, settings
        What is done to which controller.
    compiled
        Whether to compile the loop, which gives the same bits. By default a run that is long
        enough to win by it is compiled. Without numba, or with a plant or signal that does not
        compile, the loop runs in plain Python all the same.
    say
        Called with one line before numba compiles, which takes some seconds, once per machine
        for each combination of plant and signal classes.

    Raises
    ------
    SettingError
        For a run of so many periods that their rows do not fit in memory.

    """
    steps = experiment.steps
    if steps > MOST_ROWS:
        raise SettingError(
            'duration',
            experiment.duration,
            f'at most {MOST_ROWS / experiment.rate:g} s, {MOST_ROWS:,} periods, to keep every one',
        )
    loop, rows = Loop(experiment, settings), np.full((steps, WIDTH), np.nan)
    loop.run(rows, kernel(experiment, steps, compiled, say))
    columns = dict(zip(COLUMNS, np.ascontiguousarray(rows.T)))
    return Result(
        **columns,
        disturbances=rows[:, LEVELS : LEVELS + loop.levels].copy(),
        metrics=metric_values(loop.acc),
        status_counts={s.name.lower(): n for s, n in loop.controller.counts.items() if n},
    )


def kernel(
    experiment: Experiment,
    periods: int,
    compiled: bool | None = None,
    say: Callable[[str], None] | None = None,
) -> Kernel | None:
    """
    Return the compiled loop for the classes in ``experiment``, None for plain Python.

    ``periods`` is how many are about to be run: with ``compiled`` None it decides.
    """
    if compiled is False or (compiled is None and periods < WORTH_COMPILING):
        return None
    try:
        from nadrc_ros.simulation.kernel import kernel_for
    except ImportError:
        return None
    return kernel_for(experiment, say)
