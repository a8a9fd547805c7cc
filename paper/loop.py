"""A closed loop around any control step: for experiments on parts of the law, or against it."""

from __future__ import annotations

from collections.abc import Callable

import attrs
from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.adrc.law import step
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import blank_state, start
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.loop import sample_reference
from nadrc_ros.simulation.metrics import Metrics, MetricValues
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
# decide(reference, measurement, applied, dt) -> command
Decide = Callable[[list[float], float, float, float], float]


class Law:
    """The law without its supervisor: no fault policy and no bumpless entry."""

    def __init__(self, settings: ControllerSettings) -> None:
        self.design: Design = make_design(settings)
        self.state = blank_state(self.design)
        self._next = blank_state(self.design)

    def start(self, measurement: float, reference: float) -> None:
        """Start the estimates at rest at a measurement, as the controller does."""
        start(self.design, measurement, 0.0, reference, self.state)

    @property
    def profile(self) -> list[float]:
        """Return the reference r1, r2, ... that the law follows."""
        return list(self.state.profile)

    def __call__(
        self, reference: list[float], measurement: float, applied: float, dt: float
    ) -> float:
        """Return the command."""
        command, _ = step(self.design, self.state, reference, measurement, applied, dt, self._next)
        self.state, self._next = self._next, self.state
        return command


@attrs.frozen(kw_only=True, eq=False)
class Run:
    """Arrays (N,) over the periods, and the figures of merit."""

    time: Array
    output: Array
    command: Array
    metrics: MetricValues


def run(experiment: Experiment, decide: Decide) -> Run:
    """Run the loop: at each t_k measure, decide, hold the command until t_k+1."""
    plant, h = experiment.plant_run(), experiment.period
    metrics, u = Metrics(experiment.settled), 0.0
    rows = []
    for k in range(experiment.steps):
        r = sample_reference(experiment.reference, k, experiment.rate)
        y = plant.output
        u = decide(r, plant.measurement, u, h)
        metrics.add(k / experiment.rate, h, r[0] - y, u)
        rows.append((k / experiment.rate, y, u))
        plant.advance(u)
    time, output, command = np.array(rows).T
    return Run(time=time, output=output, command=command, metrics=metrics.values())
