"""The parameters of the four nodes of a loop, and who reads what they send."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.cascade import CascadeSettings
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.fields import Declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.nodes.plant_settings import PlantSettings
from nadrc_ros.nodes.recorder_settings import DEFAULT_INPUTS
from nadrc_ros.records.recording import topic_of
from nadrc_ros.ros.signal_parameters import DISTURBANCE, FEED_FORWARD, NOISE_SIGNAL, REFERENCE
from nadrc_ros.ros.topics import APPLIED_TOPIC, FEED_FORWARD_TOPIC, reference_topics
from nadrc_ros.scenario import PLANT, Scenario, ScenarioError
from nadrc_ros.scenario.parameter_files import controller_parameters, Parameters
from nadrc_ros.scenario.user_code import class_fields

# Periods, at least, without a command before the plant falls to its safe one.
_PERIODS_OF_SILENCE = 5


def node_parameters(
    scenario: Scenario, name: str, directory: Path, lockstep: bool
) -> dict[str, Parameters]:
    """Return the parameters of each node of the loop of controller ``name``."""
    settings = scenario.controllers[name]
    if isinstance(settings, CascadeSettings):
        raise ScenarioError(
            f'controllers.{name} is a cascade, and nadrc demo starts loops of one controller: '
            'nadrc simulate runs it, and on the graph controller --axes, as in docs/cascade.md'
        )
    plant: Parameters = {
        'plant': scenario.plant.file or scenario.plant.name,
        'plant_class': scenario.plant.class_name,
        'initial_state': list(scenario.initial_state),
        'input_delay': scenario.input_delay,
        'safe_command': settings.safe_command,
        'report_applied': settings.applied_timeout > 0.0,
        'command_timeout': command_timeout(scenario.rate),
        'noise_variance': scenario.noise.variance,
        'noise_sample_time': scenario.noise.sample_time,
        'seed': scenario.noise.seed,
        **attrs.asdict(scenario.sensor),
    }
    fields = class_fields(PLANT.type_of(plant['plant'], plant['plant_class']))
    plant |= _typed(fields, scenario.plant.values)
    plant |= DISTURBANCE.of(scenario.disturbance) | NOISE_SIGNAL.of(scenario.noise_signal)
    plant |= _fault_parameters(scenario)
    nodes: dict[str, Parameters] = {
        'plant': plant,
        'reference': {
            **REFERENCE.of(scenario.reference),
            **FEED_FORWARD.of(scenario.feed_forward),
            'alone': scenario.reference_alone,
            'sample_rate': scenario.reference_rate,
        },
        'controller': {
            **controller_parameters(settings, scenario.rate),
            'enabled_at_start': lockstep,
        },
        'recorder': recorder_parameters(
            settings, directory, 0.0 if lockstep else scenario.duration
        )
        | {'error': scenario.error, 'settle_time': scenario.experiment.settled}
        | {'color': list(scenario.controllers).index(name) % 18}
        | {f'units.{key}': value for key, value in attrs.asdict(scenario.units).items()},
    }
    steps = scenario.experiment.steps if lockstep else None
    return {
        node: parameters | pacing(node, settings, scenario.rate, steps)
        for node, parameters in nodes.items()
    }


def command_timeout(rate: float) -> float:
    """Return how long [s] a plant waits for commands that come at ``rate`` [Hz]."""
    return max(PlantSettings().command_timeout, _PERIODS_OF_SILENCE / rate)


def recorder_parameters(
    settings: ControllerSettings, directory: Path, duration: float
) -> Parameters:
    """Return what makes a recorder record a loop with these settings, for so long [s]."""
    return {
        'inputs': ' '.join(recorded(settings)),
        'directory': str(directory),
        'duration': duration,
        'command_min': settings.command_min,
        'command_max': settings.command_max,
        'measurement_period': settings.measurement_period,
    }


def pacing(
    node: str, settings: ControllerSettings, rate: float, steps: int | None = None
) -> Parameters:
    """Return what paces a node of a loop: at ``rate`` [Hz], in lockstep where ``steps`` counts."""
    if steps is None:
        return {'rate': rate}
    expected = '; '.join(
        f'{topic}: {" ".join(readers)}'
        for topic, (writer, readers) in expected_readers(settings, lockstep=True).items()
        if writer == node
    )
    return {'rate': rate, 'pacing': 'lockstep', 'steps': steps, 'readers': expected}


def _fault_parameters(scenario: Scenario) -> Parameters:
    parameters: Parameters = {}
    for where, faults in attrs.asdict(scenario.faults).items():
        if len(faults) > 1:
            raise ScenarioError(f'faults.{where} has {len(faults)}, and a plant node takes one')
        for fault in faults:
            parameters |= {f'fault.{where}.{key}': value for key, value in fault.items()}
    return parameters


def recorded(settings: ControllerSettings) -> list[str]:
    """Return the signals worth recording for these settings."""
    signals = [name for name in DEFAULT_INPUTS if not name.startswith('level_')]
    signals += ['applied'] if settings.applied_timeout > 0.0 else []
    signals += ['feed_forward'] if settings.feed_forward_timeout > 0.0 else []
    return signals + [f'level_{k + 1}' for k in range(make_design(settings).levels)]


def expected_readers(
    settings: ControllerSettings, lockstep: bool
) -> dict[str, tuple[str, list[str]]]:
    """Return for each topic of a loop its writer and the nodes that read it."""
    paced = 'measurement' if lockstep else 'command'
    topics = {
        'reference': ('reference', ['controller']),
        'measurement': ('plant', ['controller']),
        'command': ('controller', ['plant']),
    }
    topics[paced][1].append('reference')
    for topic in reference_topics(settings)[1:]:
        topics[topic] = ('reference', ['controller'])
    if settings.applied_timeout > 0.0:
        topics[APPLIED_TOPIC] = ('plant', ['controller'])
    if settings.feed_forward_timeout > 0.0:
        topics[FEED_FORWARD_TOPIC] = ('reference', ['controller'])
    for topic in map(topic_of, recorded(settings)):
        topics.setdefault(topic, (topic.partition('/')[0], []))[1].append('recorder')
    return topics


def _typed(fields: Mapping[str, Declared], values: Mapping[str, Any]) -> Parameters:
    """Give each value the type that its parameter has."""
    return {
        key: float(value) if fields[key].kind == 'number' else value
        for key, value in values.items()
    }
