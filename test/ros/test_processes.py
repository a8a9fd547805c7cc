"""Nodes as processes: what they load, how they share a graph, how their parameters travel."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import count
from pathlib import Path
import signal
from typing import Any

from nadrc_ros.demo.loop_parameters import node_parameters
from nadrc_ros.demo.loop_processes import NODES
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.ros.diagnostics import ERROR
from nadrc_ros.scenario import loads
from probe import parameter_file, Probe, Processes
import pytest
from rclpy.qos import ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

CONTROL: dict[str, Any] = {'rate': 100.0, 'plant_order': 1, 'b0': 1.0}
GONE = 5.0
PLANT: dict[str, Any] = {'rate': 100.0, 'plant': 'chain', 'order': 1}
LOADED = """
import sys
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.runtime import run

class Counted(ControllerNode):
    def _take_sample(self, *arguments):
        super()._take_sample(*arguments)
        self.finished = self.ticker.periods >= 20

code = run(Counted)
print('LOADED', *sorted({name.partition('.')[0] for name in sys.modules}))
raise SystemExit(code)
"""
SCENARIO = """
plant: {name: paper, a3: 0.2}
reference: {signal: cosine, frequency: 0.5}
disturbance: {signal: sine, amplitude: 2}
noise: {variance: 1e-5}
controllers:
  mine: {structure: cascade, levels: 3, pole_ratios: [1, 1.5, 2], command_rate_limit: 1e4}
"""
SLOW = """
plant: {name: chain, order: 1}
reference: {signal: step}
rate: 2
duration: 60
controllers:
  mine: {inner_bandwidth: 0.2, controller_bandwidth: 0.1, measurement_timeout: 2.5, max_dt: 2.5}
"""


def test_a_running_controller_has_loaded_nothing_heavy(start: Processes) -> None:
    arguments = ('--ros-args', '-r', f'__ns:={start.namespace}')
    process = start.run('loaded', '-c', LOADED, *arguments)
    assert process.end() == 0
    loaded = process.said.partition('LOADED ')[2].split()
    assert 'rclpy' in loaded
    heavy = {'scipy', 'numba', 'matplotlib', 'typer', 'rich', 'pandas'}
    assert heavy.isdisjoint(loaded)


def test_two_loops_in_two_namespaces_do_not_disturb_each_other(
    probe: Probe, start: Processes
) -> None:
    outputs = {}
    for name, x in (('a', 1.0), ('b', -2.0)):
        space = f'{start.namespace}/{name}'
        outputs[name] = probe.listen(f'{name}/plant/output')
        start('plant', **PLANT, initial_state=[x], namespace=space)
        start('controller', **CONTROL, namespace=space)
    probe.wait_until(lambda: all(len(heard) > 100 for heard in outputs.values()))
    assert all(abs(y - 1.0) < 0.5 for y in outputs['a'])
    assert all(abs(y + 2.0) < 0.5 for y in outputs['b'])
    probe.wait_until(lambda: probe.said('a/controller') and probe.said('b/controller'))
    assert probe.set('a/controller', inner_bandwidth=77.0) == ['']
    assert probe.get('b/controller', 'inner_bandwidth') == [40.0]
    assert probe.enable(False, node='a/controller').success
    probe.wait_until(lambda: probe.said('a/controller')[-1][2]['enabled'] == 'False')
    assert probe.said('b/controller')[-1][2]['enabled'] == 'True'


@pytest.mark.parametrize(
    ('scenario', 'lockstep'), [(SCENARIO, False), (SCENARIO, True), (SLOW, False)]
)
def test_parameter_files_made_from_a_scenario_load(
    scenario: str, lockstep: bool, probe: Probe, start: Processes, tmp_path: Path
) -> None:
    parameters = node_parameters(loads(scenario), 'mine', tmp_path / 'runs', lockstep)
    file = parameter_file(
        tmp_path / 'made.yaml', {f'{start.namespace}/{node}': p for node, p in parameters.items()}
    )
    # in lockstep the others would run to their end; one alone waits for its readers
    names = ['controller'] if lockstep else NODES
    processes = {node: start(node, file=file) for node in names}
    probe.wait_until(lambda: set(processes) <= set(probe.nodes()))
    for node in processes:
        loaded = probe.all_parameters(node)
        assert {key: loaded[key] for key in parameters[node]} == parameters[node]


def test_what_a_running_node_shows_starts_the_same_node_again(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    first = start('controller', **CONTROL)
    change = {'inner_bandwidth': 61.0, 'command_max': 7.0, 'structure': 'cascade', 'levels': 3}
    assert probe.set('controller', **change, fal_gains=[2.5]) == [''] * 5
    shown = probe.all_parameters('controller')
    first.signal(signal.SIGINT)
    assert probe.end_of(first) == 0
    file = parameter_file(tmp_path / 'dump.yaml', {f'{start.namespace}/controller': shown})
    # sooner than a killed one would be noticed; the list of nodes itself may keep its name
    probe.wait_until(lambda: not probe.readers('measurement'), GONE)
    second = start('controller', file=file)
    probe.wait_until(lambda: probe.readers('measurement') == ['controller'])
    assert probe.all_parameters('controller') == shown
    assert second.running


def test_yaml_overrides_the_quality_of_service(
    make_probe: Callable[..., Probe], namespace: str
) -> None:
    overrides = {
        f'qos_overrides.{namespace}/measurement.subscription.reliability': 'reliable',
        f'qos_overrides.{namespace}/command.publisher.depth': 7,
    }
    probe = make_probe(parameters={'controller': CONTROL | overrides})
    probe.add(ControllerNode())
    (reader,) = probe.node.get_subscriptions_info_by_topic(f'{namespace}/measurement')
    assert reader.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert probe.get('controller', *overrides) == ['reliable', 7]
    # ... of that topic, and of no other
    (reader,) = probe.node.get_subscriptions_info_by_topic(f'{namespace}/reference')
    assert reader.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT


def test_simulated_time_that_stands_still_is_an_error(make_probe: Callable[..., Probe]) -> None:
    probe = make_probe(parameters={'controller': CONTROL | {'use_sim_time': True}})
    probe.add(ControllerNode())
    publisher = probe.node.create_publisher(Clock, '/clock', 10)
    seconds = count(1)

    def running() -> bool:
        publisher.publish(Clock(clock=Time(seconds=next(seconds)).to_msg()))
        return bool(probe.said()) and 'stands still' not in probe.said()[-1][1]

    def standing() -> bool:
        level, message, _ = probe.said()[-1]
        return level == ERROR and message.endswith('; /clock stands still')

    probe.wait_until(running)
    probe.wait_until(standing)
    probe.wait_until(running)


def test_a_plant_of_ones_own_that_ran_away_is_told_and_goes_on(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    file = tmp_path / 'tank.py'
    file.write_text(
        'from math import sqrt\n'
        'class Tank:\n'
        '    order = states = b0 = 1\n'
        '    def derivative(self, t, x, u, w, dx):\n'
        '        dx[0] = u + sqrt(9.0 - x[0])\n'
        '    def output(self, x):\n'
        '        return x[0]\n'
    )
    tank = {'rate': 100.0, 'plant': str(file), 'initial_state': [1.0], 'start': 'at_once'}
    probe = make_probe(parameters={'plant': tank | {'command_timeout': 0.0}})
    plant = probe.add(PlantNode())
    plant.process.state[0] = 1e31  # far out, where what its code raises is no fault of that
    probe.wait_until(lambda: probe.said('plant') and probe.said('plant')[-1][0] == ERROR)
    assert probe.said('plant')[-1][1] == 'the plant diverged'
    k = plant.process.k
    probe.wait_until(lambda: plant.process.k > k + 10)


def test_simulated_time_paces_the_nodes_and_may_step_back(
    make_probe: Callable[..., Probe],
) -> None:
    probe = make_probe(
        parameters={
            'controller': CONTROL | {'use_sim_time': True},
            'plant': PLANT | {'use_sim_time': True, 'initial_state': [1.0]},
        }
    )
    node, plant = probe.add(ControllerNode()), probe.add(PlantNode())
    publisher = probe.node.create_publisher(Clock, '/clock', 10)
    probe.wait_until(lambda: publisher.get_subscription_count() >= 2)

    def reads(ns: int) -> bool:
        return all(n.get_clock().now().nanoseconds == ns for n in (node, plant))

    def run(begin: float, count: int) -> None:
        """Let simulated time run, by half periods."""
        for k in range(count):
            clock = Clock()
            ns = round((begin + 0.005 * k) * 1e9)
            clock.clock.sec, clock.clock.nanosec = divmod(ns, 10**9)
            publisher.publish(clock)
            probe.wait_until(partial(reads, ns))
            probe.spin(0.001)

    def step(begin: float) -> tuple[int, int]:
        periods, used = node.ticker.periods, node.controller.counts[0]
        run(begin, 100)
        return node.ticker.periods - periods, node.controller.counts[0] - used

    step(1000.0)
    ticks, used = step(1000.5)
    assert 40 <= ticks <= 60
    assert used > 20
    periods = node.ticker.periods
    probe.spin(0.2)  # the clock stands still: nothing happens
    assert node.ticker.periods - periods <= 1
    step(100.0)  # nine hundred seconds back
    ticks, used = step(100.5)
    assert 40 <= ticks <= 60
    assert used > 20
    assert abs(plant.process.output - 1.0) < 0.5
    assert node.controller.mode == 0
