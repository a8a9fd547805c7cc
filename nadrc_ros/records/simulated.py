"""A simulated run as one that was recorded, with all that happened in it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import attrs
from nadrc_ros.records.history import Event, History
from nadrc_ros.records.recorded_run import RecordedRun
from nadrc_ros.records.recording import RunSettings
from nadrc_ros.records.states import describe
from nadrc_ros.scenario import Scenario
from nadrc_ros.simulation.faults import Faults, first_period
from nadrc_ros.simulation.simulate import Result

_SAME = ('time', 'reference', 'measurement', 'command', 'output', 'total_disturbance')
_ESTIMATES = ('tracking', 'output_estimate', 'disturbance_estimate')


def recorded(path: Path, scenario: Scenario, name: str, result: Result) -> RecordedRun:
    """Return the run of the controller ``name`` of a scenario, which was read from ``path``."""
    settings, rate = scenario.controllers[name], scenario.rate
    columns = {column: getattr(result, column) for column in (*_SAME, *_ESTIMATES)}
    columns |= {f'level_{k}': values for k, values in enumerate(result.disturbances.T, 1)}
    controller, plant = f'/{name}/controller', f'/{name}/plant'
    color = list(scenario.controllers).index(name)
    units = attrs.asdict(scenario.units)
    history = History(about={'namespace': name, 'units': units, 'color': color})
    history.take(None, controller, attrs.asdict(settings))
    what = {'plant': scenario.plant.name or scenario.plant.file}
    noise = {'noise_variance': scenario.noise.variance, 'seed': scenario.noise.seed}
    history.take(None, plant, what | scenario.plant.values | noise)
    for retune in scenario.retunes:
        history.take(first_period(retune.time, rate) / rate, controller, retune.settings)
    history.events.extend(
        Event(time, controller, 'mode', describe(mode, cause))
        for time, mode, cause in result.modes
    )
    history.events.extend(_faults(scenario, plant))
    return RecordedRun(
        path=path,
        rate=rate,
        stop=float(result.time[-1]),
        columns=columns,
        summary={'complete': True, 'samples_lost': 0},
        figures=RunSettings(
            rate=rate,
            error=scenario.error,
            command_min=settings.command_min,
            command_max=settings.command_max,
            measurement_period=settings.measurement_period,
            settle_time=scenario.experiment.settled,
        ),
        history=history,
        true_for_controller=True,
    )


def _faults(scenario: Scenario, node: str) -> Iterator[Event]:
    """Yield what the plant of a scenario would say of its faults."""
    if scenario.faults == Faults():
        return
    faults, before = scenario.experiment.plant_run(0.0).faults, ''
    for k in range(scenario.experiment.steps):
        now = ', '.join(faults.acting(k))
        if now != before:
            yield Event(k / scenario.rate, node, 'fault', now or 'none')
            before = now
