"""Runs of a scenario over noise seeds, and what they amount to."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.simulation.batch import RunMetrics, simulate_batch
from nadrc_ros.simulation.experiment import Experiment
import numpy as np

Statistics = dict[str, float]


def without_noise(experiment: Experiment) -> Experiment:
    """Return the experiment with a perfect measurement."""
    return attrs.evolve(experiment, noise=attrs.evolve(experiment.noise, variance=0.0))


def metrics_of(
    experiment: Experiment,
    settings: Sequence[ControllerSettings],
    seeds: Sequence[int],
    jobs: int,
) -> list[list[RunMetrics]]:
    """Return the figures of merit of each controller for each seed, from ``jobs`` threads."""
    with ThreadPoolExecutor(max(1, jobs)) as threads:
        runs = simulate_batch(experiment, settings, seeds, executor=threads, compiled=True)
    count = len(seeds)
    return [runs[i * count : (i + 1) * count] for i in range(len(settings))]


def statistics(values: Sequence[float]) -> Statistics:
    """Return mean and standard deviation; the latter is 0 for a single value."""
    std = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return {'mean': float(np.mean(values)), 'std': std}
