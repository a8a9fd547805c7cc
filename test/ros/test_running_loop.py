"""Loops of nodes in the process of a test: what `nadrc_ros.testing` gives its users."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import inspect
import math
import os
from pathlib import Path
import re
import subprocess
import sys
import threading
from typing import Any

import attrs
from nadrc_ros import testing
from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.nodes.reference import ReferenceNode
from nadrc_ros.scenario import loads
from nadrc_ros.simulation.experiment import Experiment, Retune
from nadrc_ros.simulation.faults import Faults, MeasurementFault
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.signals import make_signal
from nadrc_ros.simulation.simulate import Result, simulate
from nadrc_ros.testing import GraphError, loop, RunningLoop, scenario_loop
import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

SCENARIO = """
plant: {name: paper, a3: 0.2}
reference: {signal: cosine, frequency: 0.5}
disturbance: {signal: sine, frequency: 1.0}
noise: {variance: 1e-4, sample_time: 0.01}
faults:
  measurement: [{kind: not_a_number, probability: 0.1, start: 1, duration: 1}]
  command: [{kind: gain, size: 0.6, start: 3}]
seed: 3
rate: 100
duration: 6
limits: {command_min: -8, command_max: 8}
retune:
  - {time: 2.0, inner_bandwidth: 25, b0: 1.3}
  - {time: 4.005, structure: cascade, outer_bandwidth: 15}
controllers:
  nested: {structure: nested, inner_bandwidth: 20, outer_bandwidth: 10}
"""


class Tank:
    """A plant of one's own: y' = gain u - leak y + w."""

    order = states = 1

    def __init__(self, gain: float = 2.0, leak: float = 0.5) -> None:
        self.b0 = gain
        self.leak = leak

    def derivative(self, t: float, x: Any, u: float, w: float, dx: Any) -> None:
        dx[0] = self.b0 * u - self.leak * x[0] + w

    def output(self, x: Any) -> float:
        return float(x[0])


def assert_same(result: Result, expected: Result) -> None:
    """Compare bit for bit but the modes, which a run records as events; every nan is the same."""
    for field in attrs.fields(Result):
        if field.name == 'modes':
            continue
        got, wanted = getattr(result, field.name), getattr(expected, field.name)
        if isinstance(wanted, np.ndarray):
            assert got.shape == wanted.shape, field.name
            bits = [np.where(np.isnan(x), np.nan, x).view(np.int64) for x in (got, wanted)]
            assert (bits[0] == bits[1]).all(), field.name
        else:
            assert got == wanted, field.name


def test_p18_lockstep_in_one_process_gives_the_bits_of_the_simulation_retunes_included() -> None:
    scenario = loads(SCENARIO)
    with scenario_loop(scenario, 'nested', lockstep=True) as run:
        result = run.finish()
    assert_same(result, scenario.run('nested'))
    assert result.status_counts['no_measurement'] > 0 and result.disturbances.shape == (600, 2)


SETTINGS: dict[str, Any] = {'controller_bandwidth': 4.0, 'inner_bandwidth': 25.0}


def simulated(seconds: float, plant: Tank, retunes: tuple[Retune, ...] = ()) -> Result:
    experiment = Experiment(
        plant=plant,
        reference=make_signal('sine', {'frequency': 2.0}),
        disturbance=make_signal('constant', {'offset': 0.7}),
        noise=Noise(variance=1e-4, seed=5),
        initial_state=(0.5,),
        faults=Faults(measurement=(MeasurementFault(kind='bias', size=0.1, start=0.5),)),
        retunes=retunes,
        rate=100.0,
        duration=seconds,
    )
    return simulate(experiment, ControllerSettings(plant_order=1, b0=plant.b0, **SETTINGS))


def tank(seconds: float, leak: float = 0.5, **more: Any) -> Any:
    """Return the loop that `simulated` simulates."""
    return loop(
        plant={
            'plant': Tank,
            'leak': leak,
            'initial_state': [0.5],
            'disturbance': 'constant',
            'disturbance_offset': 0.7,
            'noise_variance': 1e-4,
            'seed': 5,
            'fault': {'measurement': {'kind': 'bias', 'size': 0.1, 'start': 0.5}},
        },
        controller=SETTINGS,
        reference={'signal': 'sine', 'frequency': 2.0},
        rate=100.0,
        duration=seconds,
        lockstep=True,
        **more,
    )


@pytest.mark.parametrize('executor', [SingleThreadedExecutor, EventsExecutor])
def test_p18_a_change_at_a_time_is_that_of_the_simulation(
    executor: Callable[..., Executor],
) -> None:
    change = {'inner_bandwidth': 40.0, 'b0': 2.5}
    with tank(1.0, executor=executor) as run:
        run.run_until(0.333)  # between two periods: the next one begins at 0.34
        assert run.time == 0.34
        run.change(**change)
        half = run.result()
        result = run.finish()
    expected = simulated(1.0, Tank(), (Retune(time=0.333, settings=change),))
    assert_same(result, expected)
    assert len(half.time) == 34 and (half.command == expected.command[:34]).all()
    assert np.abs(result.command[34:] - simulated(1.0, Tank()).command[34:]).max() > 0.01


def test_all_that_changes_at_a_time_acts_from_then_on() -> None:
    results = []
    for executor in (SingleThreadedExecutor, EventsExecutor, EventsExecutor):
        with tank(0.6, executor=executor) as run:
            run.run_until(0.3)
            run.change('reference', {'signal': 'constant', 'offset': 2.0})
            run.change('plant', {'disturbance_offset': -4.0})
            run.change(inner_bandwidth=30.0)
            results.append(run.finish())
    result, unchanged = results[0], simulated(0.6, Tank())
    for other in results[1:]:
        assert_same(other, result)
    assert (result.reference[30:] == 2.0).all()
    assert (result.command[:30] == unchanged.command[:30]).all()
    assert (result.output[:31] == unchanged.output[:31]).all()
    assert result.output[31] != unchanged.output[31]
    truth = result.total_disturbance + 0.5 * result.output
    assert np.abs(truth[:30] - 0.7).max() < 1e-9 and np.abs(truth[30:] + 4.0).max() < 1e-9


def test_loops_of_other_parameters_in_one_process_do_not_disturb_each_other() -> None:
    with tank(1.0, leak=0.5) as one, tank(1.0, leak=3.0, executor=one.executor) as other:
        for t in (0.2, 0.5, 0.8):
            one.run_until(t)
            other.run_until(t - 0.1)
        results = [one.finish(), other.finish()]
        with tank(0.5, leak=1.5) as third:  # on an executor and in a context of its own
            results.append(third.finish())
    for result, leak, seconds in zip(results, (0.5, 3.0, 1.5), (1.0, 1.0, 0.5)):
        assert_same(result, simulated(seconds, Tank(leak=leak)))


def test_a_reference_of_ones_own_comes_from_a_file(tmp_path: Path) -> None:
    log = tmp_path / 'log.csv'
    log.write_text('t,r\n0,1\n1,3\n', encoding='utf-8')
    with loop(plant=Tank, reference=log, rate=50.0, duration=0.5, lockstep=True) as run:
        result = run.finish()
    assert np.abs(result.reference - (1.0 + 2.0 * result.time)).max() < 1e-9


@pytest.mark.parametrize('executor', [SingleThreadedExecutor, EventsExecutor])
def test_in_real_time_a_loop_runs_by_the_clock_and_ends_by_itself(
    executor: Callable[..., Executor],
) -> None:
    with loop(
        plant='chain',
        controller={'controller_bandwidth': 4.0, 'inner_bandwidth': 10.0},
        reference={'signal': 'constant', 'offset': 1.0},
        rate=50.0,
        duration=2.0,
        executor=executor,
    ) as run:
        assert run.time == 0.0 and run.controller.controller.enabled
        run.run_until(0.5)
        run.change('plant', {'disturbance': 'constant', 'disturbance_offset': 3.0})
        result = run.finish()
    assert result.time[0] == 0.0 and result.time[-1] < 2.0
    assert len(result.time) > 20 and result.reference[-1] == 1.0
    truth = result.total_disturbance[1:].round(9)  # that of the first period came after its row
    assert set(truth) == {0.0, 3.0} and (np.diff(truth) >= 0.0).all()


def test_what_happened_is_told_with_its_time() -> None:
    with loop(plant=Tank, controller={'measurement_timeout': 0.1}, rate=50.0, duration=2.0) as run:
        run.run_until(0.5)
        run.change('plant', {'fault.measurement.kind': 'silent'})
        run.run_until(1.2)
        with pytest.raises(UserError):
            run.change(inner_bandwidth=-1.0)
        run.finish()
        events = [(event.time, event.message) for event in run.events()]
    (moment,) = [t for t, message in events if 'holding' in message]
    assert moment is not None and 0.5 < moment < 1.3
    assert any('inner_bandwidth' in message for _, message in events)


def threads() -> set[threading.Thread]:
    return set(threading.enumerate())


def test_what_is_refused_leaves_nothing_behind(tmp_path: Path) -> None:
    with tank(0.01):
        pass  # the process has its domain from now on
    before = threads(), dict(os.environ), rclpy.ok()
    for values, said in (
        ({'controller': {'b0': 2}}, 'b0 = 2: .*: write 2.0'),
        (
            {'controller': {'inner_bandwith': 2.0}},
            'inner_bandwith = 2.0: .*: did you mean inner_bandwidth\\?',
        ),
        (
            {'controller': {'enabled_at_start': 'false'}},
            "enabled_at_start = 'false': must be true",
        ),
        ({'controller': {'enabled_at_start': 0}}, 'enabled_at_start = 0: must be true or false'),
        ({'plant': int}, "plant = 'int': must be a class with a method derivative"),
        ({'rate': '50'}, "rate = '50': must be a number"),
        ({'duration': None}, 'duration = None: must be a number'),
        ({'reference': 'cosin'}, "signal = 'cosin'"),
        ({'reference': None}, "signal = 'None'"),
        ({'plant': {'plant': Tank, 'leek': 1.0}}, 'leek = 1.0: .*: did you mean leak\\?'),
        ({'plant': {'plant': 'tank'}}, "'tank'"),
        ({'plant': Tank()}, 'plant = .*: must be a class'),
        ({'rate': 1e-4, 'duration': 1e5}, 'rate = 0.0001'),
        ({'controller': {'rate': 50.0}}, 'controller.rate = 50.0: must be left out: rate, dur'),
        ({'duration': 0.0}, 'duration = 0.0'),
        ({'duration': math.inf}, 'duration = inf'),
        ({'namespace': 'my loop'}, "namespace = 'my loop'"),
    ):
        arguments: dict[str, Any] = {'plant': Tank, 'directory': tmp_path} | values
        for lockstep in (True, False):
            with pytest.raises(SettingError, match=said), loop(lockstep=lockstep, **arguments):
                pass
    assert not list(tmp_path.iterdir())
    assert (threads(), dict(os.environ), rclpy.ok()) == before


def test_a_change_that_is_refused_changes_nothing_and_time_only_goes_on() -> None:
    with tank(0.2) as run:
        with pytest.raises(UserError, match='did you mean controller\\?'):
            run.change('controler', b0=2.0)
        run.run_until(0.1)
        with pytest.raises(UserError, match='inner_bandwidth'):
            run.change(inner_bandwidth=-1.0, b0=3.0)
        for t in (0.05, 0.3, math.nan):
            with pytest.raises(SettingError, match=r'from 0.1, now, to 0.2 s'):
                run.run_until(t)
        with pytest.raises(SettingError, match="time = '1': must be a number of seconds"):
            run.run_until('1')
        with pytest.raises(TimeoutError, match=r'not within 0.05 s'):
            run.wait_until(lambda: False, timeout=0.05)
        result = run.finish()
    assert_same(result, simulated(0.2, Tank()))


def test_a_duration_between_two_periods_and_a_slow_rate_are_no_obstacle() -> None:
    slow = {'measurement_timeout': 1.0, 'max_dt': 1.0, 'inner_bandwidth': 1.0}
    with loop(plant=Tank, controller=slow, rate=5.0, duration=1.23, lockstep=True) as run:
        run.run_until(0.35)
        run.run_until(0.37)  # still before the same period
        assert run.time == 0.4
        assert len(run.finish().time) == 6


def test_a_node_that_fails_is_named() -> None:
    with pytest.raises(GraphError, match='controller: on purpose'), tank(0.2) as run:
        run.controller.fail('on purpose')
        run.finish()


def test_nodes_of_ones_own_take_part() -> None:
    heard: list[float] = []
    with tank(0.2) as run:
        node = Node('listener', namespace=run.namespace, context=run.executor.context)
        node.create_subscription(Float64, 'command', lambda m: heard.append(m.data), 1000)
        run.add(node)
        run.wait_until(lambda: node.count_publishers('command'))
        result = run.finish()
        run.wait_until(lambda: heard and heard[-1] == result.command[-1])


def test_a_loop_joins_an_executor_and_a_context_of_ones_own() -> None:
    context = Context()
    context.init([])
    executor = SingleThreadedExecutor(context=context)
    node = Node('mine', context=context)
    executor.add_node(node)
    with loop(plant=Tank, rate=50.0, executor=executor) as run:
        client = node.create_client(SetBool, f'{run.namespace}/controller/enable')
        run.wait_until(client.service_is_ready)
        future = client.call_async(SetBool.Request(data=False))
        run.wait_until(future.done, done=future)
        assert future.result().success and not run.controller.controller.enabled
    assert executor.get_nodes() == [node] and context.ok()
    node.destroy_node()
    context.shutdown()


DOMAIN = """
import os, sys
from nadrc_ros.ros.runtime import private_domain
domain = private_domain()
assert os.environ['ROS_DOMAIN_ID'] == str(domain) == str(private_domain())
assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
print(domain, flush=True)
sys.stdin.readline()
os.environ['ROS_DOMAIN_ID'] = '7'
assert private_domain(keep=True) == 7 and private_domain() == domain
"""


def test_every_process_gets_a_domain_of_its_own() -> None:
    pipe = subprocess.PIPE
    command = [sys.executable, '-c', DOMAIN]
    started = [subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) for _ in range(3)]
    domains = [int(process.stdout.readline()) for process in started if process.stdout]
    for process in started:
        with suppress(BrokenPipeError):
            process.communicate('\n')
        assert process.returncode == 0
    assert len({*domains, testing.private_domain()}) == 4
    assert all(1 <= domain <= 100 for domain in domains)


PAGE = Path(__file__).parents[2] / 'docs' / 'testing.md'


@pytest.mark.parametrize('block', re.findall(r'```python\n(.*?)```', PAGE.read_text(), re.DOTALL))
def test_the_examples_of_the_page_pass(block: str) -> None:
    names: dict[str, Any] = {'__name__': 'page'}
    exec(block, names)
    (test,) = [thing for name, thing in names.items() if name.startswith('test_')]
    test()


PUBLIC = {
    'loop': 'plant controller reference rate duration lockstep executor namespace directory',
    'scenario_loop': 'scenario name lockstep executor namespace directory',
    'private_domain': 'keep',
    'spin_until': 'executor condition timeout done',
}
NODE = 'parameters namespace node_name context remappings arguments'
MEMBERS = (
    'plant controller reference recorder executor namespace rate duration time '
    'add change events finish result run_until wait_until'
)


def test_the_public_names_stay() -> None:
    assert sorted(testing.__all__) == sorted([*PUBLIC, 'GraphError', 'RunningLoop'])
    for name, arguments in PUBLIC.items():
        known = inspect.signature(getattr(testing, name)).parameters
        assert ' '.join(known) == arguments
    for node in (ControllerNode, PlantNode, ReferenceNode, RecorderNode):
        assert ' '.join(inspect.signature(node).parameters) == NODE
    with tank(0.01) as run:
        assert isinstance(run, RunningLoop)
        assert set(MEMBERS.split()) <= {n for n in dir(run) if not n.startswith('_')}
