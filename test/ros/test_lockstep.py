"""Lockstep: the graph gives the bits of the simulation, and a broken run ends with a reason."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import isnan
from pathlib import Path
import re
import signal
import time
from typing import Any

import attrs
from nadrc_ros.adrc.structures import STRUCTURES
from nadrc_ros.demo.run import Run, run_lockstep
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.runtime import DESTROY_TIME, END_TIME
from nadrc_ros.scenario import load, loads, Scenario
from nadrc_ros.testing import scenario_loop
from probe import Probe, Processes
import pytest

LOCKSTEP: dict[str, Any] = {'pacing': 'lockstep', 'steps': 1_000_000}
COLUMNS = {
    'time',
    'reference',
    'measurement',
    'command',
    'output',
    'total_disturbance',
    'tracking',
    'output_estimate',
    'disturbance_estimate',
}
SCENARIO = """
plant: {name: paper, a3: 0.2}
reference: {signal: cosine, frequency: 0.5}
disturbance: {signal: sine, frequency: 1.0}
noise: {variance: 1e-4, sample_time: 0.01}
faults:
  measurement: [{kind: not_a_number, probability: 0.1, start: 5, duration: 1}]
  command: [{kind: gain, size: 0.6, start: 7}]
seed: 3
rate: 200
duration: 10
limits: {command_min: -8, command_max: 8}
controllers:
"""
DIVERGING = """
plant: {name: chain, order: 1, damping: -900}
reference: constant
noise: {variance: 1e-4}
rate: 100
duration: 1.5
limits: {command_min: -8, command_max: 8}
controllers: {nested: {}}
"""
ANGLE = """
plant: {name: chain, order: 2, initial_state: [300, 0]}
reference: {signal: cosine, amplitude: 300.0, frequency: 2.0}
noise: {variance: 1e-2}
sensor: {wrap_min: -180, wrap_max: 180}
rate: 100
duration: 2
limits: {command_min: -5000, command_max: 5000}
controllers: {angle: {measurement_period: 360}}
"""


def assert_same_bits(scenario: Scenario, name: str, run: Run) -> None:
    offline = scenario.run(name)
    recorded = dict(run.samples)
    levels = [recorded.pop(f'level_{k + 1}') for k in range(offline.disturbances.shape[1])]
    assert recorded.keys() == COLUMNS
    for k, level in enumerate(levels):
        assert same(level, offline.disturbances[:, k]), f'{name}: level {k + 1}'
    for column, values in recorded.items():
        assert same(values, getattr(offline, column)), f'{name}: {column}'
    assert run.summary['metrics'] == attrs.asdict(offline.metrics)
    assert run.summary['complete']
    assert run.summary['samples_lost'] == 0


def same(graph: Any, offline: Any) -> bool:
    """Compare bit for bit; every nan is the same one here."""
    return [float(x).hex() for x in graph] == [float(x).hex() for x in offline]


def test_p18_the_graph_gives_the_bits_of_the_simulation(tmp_path: Path) -> None:
    controllers = '  nested: {inner_bandwidth: 20, outer_bandwidth: 10, levels: 3}\n  other: {}'
    scenario = loads(SCENARIO + controllers)
    runs = run_lockstep(scenario, tmp_path, lambda name: None)
    assert list(runs) == ['nested', 'other']
    for name, run in runs.items():
        assert run.summary['rows'] == 2000
        assert_same_bits(scenario, name, run)
    # that the runs were worth comparing: noise is on, the limits act, and so do the faults
    assert len(set(runs['nested'].samples['measurement'])) > 900
    assert any(run.summary['metrics']['saturated_fraction'] > 0.0 for run in runs.values())
    assert sum(map(isnan, runs['nested'].samples['measurement'])) in range(8, 35)


@pytest.mark.parametrize('structure', STRUCTURES)
def test_p18_so_do_all_structures_in_one_process(structure: str) -> None:
    settings = f'{{structure: {structure}, inner_bandwidth: 20, outer_bandwidth: 10, levels: 3}}'
    scenario = loads(f'{SCENARIO}  {structure}: {settings}')
    with scenario_loop(scenario, structure, lockstep=True) as loop:
        result = loop.finish()
    offline = scenario.run(structure)
    for column in COLUMNS:
        assert same(getattr(result, column), getattr(offline, column)), column
    assert same(result.disturbances.ravel(), offline.disturbances.ravel())
    assert result.metrics == offline.metrics and result.status_counts == offline.status_counts
    assert len(set(result.command)) > 1500


def test_p18_so_does_an_angle_through_a_sensor_that_wraps(tmp_path: Path) -> None:
    scenario = loads(ANGLE)
    runs = run_lockstep(scenario, tmp_path, lambda name: None)
    assert_same_bits(scenario, 'angle', runs['angle'])
    assert max(map(abs, runs['angle'].samples['measurement'])) < 180.5
    assert (
        runs['angle'].summary['metrics']['max_error']
        < 180.0
        < 540.0
        < (max(runs['angle'].samples['output']) - min(runs['angle'].samples['output']))
    )


def test_p18_with_signals_and_a_plant_of_the_users(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / 'docs' / 'own.md').read_text(encoding='utf-8')
    names = iter(('my_plant.py', 'my_signals.py', 'log.csv', 'scenario.yaml'))
    for text in re.findall('```(?:python|text|yaml)\n(.*?)```', page, re.DOTALL):
        (tmp_path / next(names)).write_text(text)
    scenario = load(tmp_path / 'scenario.yaml')
    runs = run_lockstep(scenario, tmp_path / 'out', lambda name: None)
    assert_same_bits(scenario, 'nested', runs['nested'])


def test_p18_with_a_plant_that_answers_late() -> None:
    """By a fraction of a period too, and with another b0, to which the truth is referred."""
    scenario = loads(
        SCENARIO.replace('a3: 0.2', 'input_delay: 0.0237').replace('duration: 10', 'duration: 2')
        + '  late: {input_delay: 0.0237, inner_bandwidth: 15, outer_bandwidth: 15, b0: 1.5}'
    )
    with scenario_loop(scenario, 'late', lockstep=True) as loop:
        result = loop.finish()
    offline = scenario.run('late')
    for column in COLUMNS:
        assert same(getattr(result, column), getattr(offline, column)), column


def test_p18_also_when_the_plant_diverges(tmp_path: Path) -> None:
    scenario = loads(DIVERGING)
    runs = run_lockstep(scenario, tmp_path, lambda name: None)
    assert isnan(runs['nested'].samples['output'][-1])
    assert_same_bits(scenario, 'nested', runs['nested'])


def test_a_missing_reader_ends_the_start_by_name(start: Processes, namespace: str) -> None:
    readers = 'command: plant recorder'
    process = start('controller', **LOCKSTEP, readers=readers, start_timeout=1.0)
    assert process.end() == 1
    assert f'{namespace}/command has no reader plant' in process.said
    assert f'{namespace}/command has no reader recorder' in process.said
    assert 'Traceback' not in process.said


def test_a_silent_input_ends_the_run_by_name(
    probe: Probe, start: Processes, namespace: str
) -> None:
    commands = probe.listen('command')
    plant = start('plant', **LOCKSTEP, readers='measurement: controller')
    probe.wait_until(lambda: probe.node.count_publishers(f'{namespace}/measurement'))
    process = start('controller', **LOCKSTEP, lockstep_timeout=4.0, safe_command=1.5)
    assert probe.end_of(process) == 1
    assert f'{namespace}/reference' in process.said
    assert f'{namespace}/measurement' not in process.said  # the plant did send its first
    assert 'no sample 1 for 4 s' in process.said
    probe.wait_until(lambda: commands == [1.5])  # safe, as its last
    plant.signal(signal.SIGINT)
    assert probe.end_of(plant) == 0
    assert 'Traceback' not in process.said + plant.said


def test_a_lost_sample_ends_the_run_by_topic_and_number(
    make_probe: Callable[..., Probe], namespace: str
) -> None:
    probe = make_probe(parameters={'controller': LOCKSTEP})
    publish = probe.publisher('measurement')
    publish(0.0)  # number 1: the controller is not there yet
    controller = probe.add(ControllerNode())
    probe.wait_until(lambda: probe.readers('measurement'))
    publish(0.0)
    probe.wait_until(lambda: controller.finished)
    assert controller.failure == f'{namespace}/measurement: sample 1 is missing, 2 came'


def test_p14_interrupted_beside_a_dead_reader_a_node_ends_at_once_at_safe(
    probe: Probe, start: Processes
) -> None:
    commands = probe.listen('command')
    inputs = ('measurement', 'reference', 'reference/rate', 'reference/acceleration')
    feed = [probe.publisher(topic) for topic in inputs]
    recorder = start('recorder', **LOCKSTEP, directory=str(start.directory / 'runs'))
    safe: dict[str, Any] = {'safe_command': 1.5}
    controller = start('controller', **LOCKSTEP, **safe, readers='command: probe recorder')
    probe.wait_until(lambda: all('controller' in probe.readers(topic) for topic in inputs))
    for k in range(20):
        for publish in feed:
            publish(0.1 * k)
        probe.wait_until(partial(lambda count: len(commands) == count, k + 1))
    assert commands[-1] != 1.5
    recorder.popen.kill()
    recorder.end()
    begin = controller.signal(signal.SIGTERM)
    assert probe.end_of(controller) == 0
    # as long as there is time for a reader that was held up
    assert END_TIME - DESTROY_TIME < time.monotonic() - begin < 3.0
    probe.wait_until(lambda: commands[-1] == 1.5)
    assert commands.numbers == list(range(1, 22))
