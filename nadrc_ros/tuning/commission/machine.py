"""What commissioning needs of a machine, simulated or on the graph, and what it gets from it."""

from __future__ import annotations

from math import inf
from typing import Protocol

import attrs
from nadrc_ros.adrc.commission.experiment import Experiment
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.adrc.settings import ControllerSettings
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@attrs.frozen(kw_only=True, eq=False)
class Samples:
    """
    What was seen: arrays (N,), a value each tick of the controller.

    ``time`` [s] of the ticks, the ``measurement`` that came since the one before, nan if none did,
    and its ``stamp`` [s] by the clock of its source, nan if unknown; the ``command`` sent in that
    tick and the ``excitation`` in it, nan where nothing is sent. ``outcome`` and ``reason`` are
    those of the experiment, '' where there was none.
    """

    time: Array
    measurement: Array
    stamp: Array
    command: Array
    excitation: Array
    stage: npt.NDArray[np.str_]
    outcome: str = ''
    reason: str = ''


class Machine(Protocol):
    """Something that moves under a command and is measured."""

    @property
    def rate(self) -> float:
        """Return how many ticks there are in a second [Hz]."""
        ...

    @property
    def present(self) -> ControllerSettings:
        """Return the settings of its controller by now: limits, timeouts, the safe command."""
        ...

    def listen(self, seconds: float) -> Samples:
        """Watch it for so long [s], and send nothing."""
        ...

    def run(
        self, settings: ExperimentSettings, controller: ControllerSettings | None = None
    ) -> Samples:
        """Run an experiment until it is over."""
        ...


class Plant(Protocol):
    """What a :class:`Simulated` machine is made of."""

    def measure(self) -> float:
        """Return what the sensor shows by now, nan if nothing."""
        ...

    def advance(self, command: float) -> None:
        """Act so for one period."""
        ...


class Simulated:
    """
    A simulated machine.

    Parameters
    ----------
    plant
        Measured and moved a period at a time.
    rate
        Periods per second [Hz].
    present
        The settings of its controller.
    actuator_timeout
        Time without commands after which its actuator takes the safe one [s].

    """

    def __init__(
        self,
        plant: Plant,
        rate: float,
        present: ControllerSettings,
        actuator_timeout: float = inf,
    ) -> None:
        self.plant, self.rate, self.present = plant, rate, present
        self.actuator_timeout = actuator_timeout
        self._quiet = 0.0
        self._ticks = 0
        self._command = present.safe_command

    def listen(self, seconds: float) -> Samples:
        """Watch it while the safe command acts."""
        rows = []
        for _ in range(max(int(seconds * self.rate + 0.5), 1)):
            rows.append((self.plant.measure(), np.nan, np.nan, ''))
            self._act(self.present.safe_command)
        return self._samples(rows)

    def run(
        self, settings: ExperimentSettings, controller: ControllerSettings | None = None
    ) -> Samples:
        """Run an experiment until it is over; then the safe command acts."""
        experiment = Experiment(settings, controller)
        rows = []
        while experiment.over is None:
            measurement = self.plant.measure()
            dt = 1.0 / self.rate if measurement == measurement else 0.0
            command = experiment.tick(measurement, dt, 1.0 / self.rate)
            rows.append((measurement, command, experiment.excitation, experiment.stage))
            self._quiet = self._quiet + 1.0 / self.rate if experiment.silent else 0.0
            late = self._quiet > self.actuator_timeout
            self._act(self.present.safe_command if late else command)
        outcome = experiment.outcome.value if experiment.outcome else ''
        return self._samples(rows, outcome, experiment.over)

    def _act(self, command: float) -> None:
        self._command = command
        self.plant.advance(command)
        self._ticks += 1

    def _samples(
        self, rows: list[tuple[float, float, float, str]], outcome: str = '', reason: str = ''
    ) -> Samples:
        time = (self._ticks - len(rows) + np.arange(len(rows))) / self.rate
        *numbers, stage = zip(*rows)
        measurement, command, excitation = map(np.array, numbers)
        return Samples(
            time=time,
            measurement=measurement,
            stamp=time,
            command=command,
            excitation=excitation,
            stage=np.array(stage),
            outcome=outcome,
            reason=reason,
        )
