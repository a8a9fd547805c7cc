"""Many runs of one experiment, of which only the figures of merit are kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.simulation.experiment import Experiment, kernel
from nadrc_ros.simulation.loop import Loop, WIDTH
from nadrc_ros.simulation.metrics import metric_values, MetricValues
import numpy as np


@attrs.frozen(kw_only=True)
class RunMetrics(MetricValues):
    """
    The figures of merit of a run, with those that need the truth about the disturbance.

    Attributes
    ----------
    remainder_itae
        Integral of t |L - d_1 - ... - d_k| for each level k [unit of y^(n), s^2]: of the errors
        e_3 = L - d_1 of the inner and zeta_3 = L - d_1 - d_2 of the outer observer in the paper
        (Abdul-Adheem & Ibraheem, nested linear extended state observers).

    """

    remainder_itae: tuple[float, ...]


def simulate_many(
    experiment: Experiment,
    settings: Sequence[ControllerSettings],
    seeds: Sequence[int],
    *,
    executor: Executor | None = None,
    compiled: bool | None = None,
    say: Callable[[str], None] | None = None,
) -> list[RunMetrics]:
    """
    Run every controller with every seed; memory does not grow with the length of a run.

    Parameters
    ----------
    experiment
        What is done to each controller; the seed of its noise is replaced.
    settings, seeds
        Run i * len(seeds) + j is of controller i with seed j.
    executor
        Where the runs are done; by default threads of its own, which compiled runs use in full.
    compiled, say
        As in :func:`~nadrc_ros.simulation.experiment.simulate`.

    """
    jobs = [(one, seed) for one in settings for seed in seeds]
    fast = kernel(experiment, experiment.steps * len(jobs), compiled, say) is not None
    count = len(jobs)
    arguments = (
        [experiment] * count,
        [one for one, _ in jobs],
        [seed for _, seed in jobs],
        [fast] * count,
    )
    if executor is not None:
        return list(executor.map(run_metrics, *arguments))
    with ThreadPoolExecutor() as threads:
        return list(threads.map(run_metrics, *arguments))


def run_metrics(
    experiment: Experiment, settings: ControllerSettings, seed: int, compiled: bool | None = None
) -> RunMetrics:
    """Return the figures of merit of one run with noise of that seed."""
    noise = attrs.evolve(experiment.noise, seed=seed)
    one = attrs.evolve(experiment, noise=noise)
    loop = Loop(one, settings)
    loop.run(np.empty((0, WIDTH)), kernel(one, one.steps, compiled))
    values = attrs.asdict(metric_values(loop.acc))
    return RunMetrics(**values, remainder_itae=tuple(loop.remainders[: loop.levels]))
