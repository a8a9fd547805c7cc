"""An experiment and the closed loop that runs it offline, with the law that the node runs."""

from __future__ import annotations

from typing import Any

import attrs
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import choice, number
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.simulation.metrics import Metrics, MetricValues
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plants import Plant
from nadrc_ros.simulation.process import Process
from nadrc_ros.simulation.signals import Signal
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
KNOWN_DERIVATIVES = 2


@attrs.frozen(kw_only=True)
class Retune:
    """A change of controller settings at a time [s], by field name."""

    time: float = number(0.0, 0.0, 1e9, 's', 'time of the change')
    settings: dict[str, Any] = attrs.field(factory=dict)


@attrs.frozen(kw_only=True)
class Experiment:
    """
    What is done to a controller: plant, signals, noise, rate, duration.

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
    rate: float = number(200.0, 1.0, 1e5, 'Hz', 'periods per second')
    duration: float = number(15.0, 1e-3, 1e6, 's', 'length of the run')
    error: str = choice(
        'reference', ('reference', 'tracking'), 'error of the metrics: r - y, or r1 - y'
    )

    def __attrs_post_init__(self) -> None:
        if self.steps < 1:
            raise SettingError(
                'duration', self.duration, f'at least {self.period!r} s, one period'
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
        """Number of periods N."""
        return round(self.duration * self.rate)

    def process(self) -> Process:
        """Return the plant at its initial state."""
        return Process(self.plant, self.disturbance, self.noise, self.rate, self.initial_state)


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


def sample_reference(signal: Signal, k: int, rate: float) -> list[float]:
    """Return r, r', r'' at t_k = k / rate: what the reference topics carry."""
    out = [0.0] * (KNOWN_DERIVATIVES + 1)
    signal.derivatives(k / rate, out)
    return out


def simulate(experiment: Experiment, settings: ControllerSettings) -> Result:
    """Run the closed loop offline: at each t_k measure, decide, hold the command until t_k+1."""
    process = experiment.process()
    controller = Controller(settings)
    metrics = Metrics()
    steps, h = experiment.steps, experiment.period
    retunes = sorted(experiment.retunes, key=lambda retune: retune.time)
    rows: list[tuple[float, ...]] = []
    levels: list[list[float]] = []
    for k in range(steps):
        t = k / experiment.rate
        while retunes and retunes[0].time <= t:
            settings = attrs.evolve(settings, **retunes.pop(0).settings)
            controller.retune(settings)
        r = sample_reference(experiment.reference, k, experiment.rate)
        y, measurement = process.output, process.measurement
        u = controller.tick(measurement, h, reference=r)
        followed = r[0] if experiment.error == 'reference' else controller.tracking
        now = controller.settings
        saturated = u <= now.command_min or u >= now.command_max
        metrics.add(t, h, followed - y, u, saturated)
        truth = process.total_disturbance(u) + (process.plant.b0 - controller.settings.b0) * u
        rows.append(
            (
                t,
                r[0],
                controller.tracking,
                y,
                measurement,
                u,
                controller.output_estimate,
                controller.total_disturbance,
                truth,
            )
        )
        levels.append(controller.disturbances)
        process.advance(u)
    columns = np.array(rows).T
    return Result(
        time=columns[0],
        reference=columns[1],
        tracking=columns[2],
        output=columns[3],
        measurement=columns[4],
        command=columns[5],
        output_estimate=columns[6],
        disturbance_estimate=columns[7],
        total_disturbance=columns[8],
        disturbances=_padded(levels),
        metrics=metrics.values(),
        status_counts={status.name.lower(): n for status, n in controller.counts.items() if n},
    )


def _padded(rows: list[list[float]]) -> Array:
    width = max(map(len, rows))
    return np.array([row + [np.nan] * (width - len(row)) for row in rows])
