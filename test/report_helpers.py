"""Recorded runs to report on, as a recorder would have left them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, nan, sin
from pathlib import Path
import random
from typing import Any

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.figures import summarise
from nadrc_ros.records.history import append_parameters, write_about
from nadrc_ros.records.recording import RunFolder, RunSettings, STAMPS

SIGNALS = (
    *('reference', 'measurement', 'command', 'output', 'total_disturbance'),
    *('tracking', 'output_estimate', 'disturbance_estimate', 'level_1', 'level_2'),
)
RUN = RunSettings(rate=100.0, command_min=-2.0, command_max=2.0)


def record(
    directory: Path,
    columns: Sequence[str] = (*SIGNALS, *STAMPS),
    count: int = 400,
    run: RunSettings = RUN,
    seed: int = 1,
    summary: bool = True,
    **fixed: float,
) -> Path:
    """Write a run whose values are odd, those in ``fixed`` excepted."""
    folder, rng = RunFolder(directory, ['time', *columns], run), random.Random(seed)
    for k in range(count):
        t = k / run.rate
        values = {
            'reference': cos(t),
            'measurement': cos(t) + rng.gauss(0.0, 0.01),
            'command': sin(3.0 * t) + rng.gauss(0.0, 0.1),
            'output': cos(t) + 0.1 * sin(t),
            **{name: rng.gauss(0.0, 1.0) for name in SIGNALS[4:]},
            'reference_stamp': 1.999 + t,
            'measurement_stamp': 2.0 + t + rng.uniform(0.0, 1e-4),
            'command_stamp': 2.001 + t + rng.uniform(0.0, 1e-3),
            **fixed,
        }
        folder.write([t, *(values[name] for name in columns)])
    folder.close()
    if summary:
        whole = {'samples_lost': 0, 'samples_lost_by_signal': {}, 'complete': True}
        folder.write_summary(summarise(folder.path) | whole)
    return folder.path


def describe(folder: Path, namespace: str, **settings: Any) -> None:
    """Say who ran, with the parameters of a controller and of the plant of the paper."""
    write_about(folder, {'started': 'then', 'namespace': namespace, 'versions': {'python': '3.x'}})
    values: Mapping[str, Any] = attrs.asdict(ControllerSettings(**settings))
    append_parameters(folder, None, f'{namespace}/controller', values)
    plant = {'plant': 'paper', 'noise_variance': 1e-6, 'seed': 2**63 - 1}
    append_parameters(folder, None, f'{namespace}/plant', plant)


NOTHING = dict.fromkeys(SIGNALS[3:], nan)
