"""Nodes in a process of somebody else: they take all by arguments and leave the process alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
import gc
import os
from pathlib import Path
import signal
import sys
from typing import Any

from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.nodes.reference import ReferenceNode
from nadrc_ros.ros.arguments import rules_of, tell_unused
from nadrc_ros.ros.node import LiveNode
from probe import parameter_file, Probe
import pytest
from rclpy.context import Context
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor

NODES = (ControllerNode, PlantNode, ReferenceNode, RecorderNode)
CONTROL: dict[str, Any] = {'rate': 50.0, 'plant_order': 1, 'controller_bandwidth': 8.0}
PLANT: dict[str, Any] = {'rate': 50.0, 'plant': 'chain', 'order': 1, 'damping': 0.0}
BAD: list[tuple[type[LiveNode], dict[str, Any], str]] = [
    *((node, {'rat': 50.0}, 'rat = 50.0: .*: did you mean rate\\?') for node in NODES),
    *((node, {'rate': 50}, 'rate = 50: must be .*: write 50.0') for node in NODES),
    *((node, {'rate': -1.0}, 'rate = -1.0: must be a finite number from') for node in NODES),
    *((node, {'pacing': 'lockstep'}, 'steps = 0') for node in NODES),
    (
        ControllerNode,
        {'plant_order': 2**70},
        'plant_order = 11.*: must be an int',
    ),
    (ControllerNode, {'inner_bandwidth': 'fast'}, "inner_bandwidth = 'fast': must be a finite"),
    (ControllerNode, {'pole_ratios': [1, 2]}, r'pole_ratios = \[1, 2\]: must be'),
    (ControllerNode, {'command_min': 1.0, 'command_max': 0.0}, 'command_m'),
    (PlantNode, {'fault': {'measurement': {'kind': 'clock_jump'}}}, 'fault.measurement.kind = '),
    (PlantNode, {'initial_state': [1.0] * 7}, 'initial_state = '),
    (ReferenceNode, {'signal': 'cosin'}, "signal = 'cosin': must be one of"),
    (RecorderNode, {'inputs': 'command'}, "inputs = 'command'"),
]


@pytest.fixture
def context() -> Iterator[Context]:
    """Return a context that knows no arguments."""
    context = Context()
    context.init([])
    yield context
    context.try_shutdown()


def refusal(make: Callable[[], object]) -> str:
    with pytest.raises(SettingError) as caught:
        make()
    return str(caught.value)


@pytest.mark.parametrize(('node', 'values', 'said'), BAD)
def test_p13_a_bad_parameter_is_refused_as_in_a_file_and_nothing_is_left(
    node: type[LiveNode],
    values: dict[str, Any],
    said: str,
    context: Context,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SettingError, match=said) as caught:
        node(parameters=values, context=context)
    if 2**70 not in values.values():  # which no file can hold
        file = parameter_file(tmp_path / 'bad.yaml', {'/**': values})
        in_file = Context()
        in_file.init(['--ros-args', '--params-file', str(file)])
        assert refusal(lambda: node(context=in_file)) == str(caught.value)
        in_file.try_shutdown()
        file.unlink()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ('node', 'name', 'path', 'why'),
    [
        (RecorderNode, 'directory', 'file', 'a folder, .*File exists'),
        (RecorderNode, 'directory', 'file/runs', 'a folder, .*Not a directory'),
        (RecorderNode, 'directory', '~nobody_here/runs', 'a folder, .*home'),
        (ControllerNode, 'trace', 'file', 'a new file .*File exists'),
        (ControllerNode, 'trace', 'none/t', 'a new file .*No such file or directory'),
    ],
)
def test_p13_where_nothing_can_be_written_the_parameter_is_named(
    node: type[LiveNode],
    name: str,
    path: str,
    why: str,
    context: Context,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path('file').touch()
    with pytest.raises(SettingError, match=f"^{name} = '{path}': must be {why}"):
        node(parameters={name: path}, context=context)
    assert [each.name for each in tmp_path.iterdir()] == ['file']


@pytest.mark.parametrize(
    ('where', 'said'),
    [
        ({'namespace': 'a b'}, "namespace = 'a b': must be names with / between them"),
        ({'namespace': '/a//b'}, "namespace = '/a//b'"),
        ({'node_name': 'yaw/controller'}, "node_name = 'yaw/controller': must be letters"),
        ({'remappings': {'measurement': 'a b'}}, "remappings = 'a b': must be the name"),
        ({'parameters': {'b0': None}}, 'b0 = None: must be true or false, a number'),
        ({'parameters': {'use_sim_time': 1}}, 'use_sim_time = 1: must be true or false'),
        ({'parameters': {'b0': Path('2')}}, 'b0 = PosixPath'),
    ],
)
def test_names_that_are_none_are_refused_in_one_line(
    where: dict[str, Any], said: str, context: Context
) -> None:
    message = refusal(lambda: ControllerNode(context=context, **where))
    assert message.startswith(said) and '\n' not in message


@pytest.mark.parametrize(
    ('rule', 'said'),
    [
        ('measurment:=/imu', 'called measurment: did you mean measurement?'),
        ('/comand:=/motor', 'called /comand: did you mean /command?'),
        ('controller:comand:=/motor', 'called comand: did you mean command?'),
        ('~/enabel:=/stop', 'called ~/enabel: did you mean ~/enable?'),
        ('rosservice://~/enabel:=/stop', 'called ~/enabel: did you mean ~/enable?'),
        ('odom:=/odometry', '/controller is called odom'),
        *((rule, '') for rule in ('measurement:=/imu', '/command:=motor', '~/enable:=/stop')),
        *((rule, '') for rule in ('controller:measurement:=~/imu', 'rostopic://command:=/motor')),
        *((rule, '') for rule in ('__node:=yaw', 'reference/acceleration:=/a', '/tf:=tf')),
        *(
            (rule, '')
            for rule in ('measurement:=measurement', '/rosout:=/log', '~/event:=/events')
        ),
    ],
)
def test_a_remapping_of_what_no_node_has_is_told(
    rule: str, said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    context = Context()
    command = ['controller', '--ros-args', '-r', rule]
    context.init(command)
    node = ControllerNode(context=context)
    tell_unused([node], rules_of(command))
    log = capfd.readouterr().err
    assert log.count('no topic or service of') == bool(said) and said in log
    node.destroy_node()
    context.try_shutdown()


def test_of_several_axes_a_remapping_has_to_be_for_one_only(
    context: Context, capfd: pytest.CaptureFixture[str]
) -> None:
    remapped = {'/y/measurement': '/imu'}
    nodes = [
        ControllerNode(context=context, namespace=axis, remappings=rules)
        for axis, rules in (('x', {}), ('y', remapped))
    ]
    tell_unused(nodes, ['/y/measurement:=/imu'])
    assert 'no topic or service' not in capfd.readouterr().err
    nodes.append(ControllerNode(context=context, remappings={'comand': '/motor'}))
    assert 'did you mean command?' in capfd.readouterr().err
    for node in nodes:
        node.destroy_node()


def state_of_the_process() -> list[object]:
    handlers = [signal.getsignal(number) for number in signal.valid_signals()]
    collecting = gc.isenabled(), gc.get_freeze_count(), gc.get_threshold()
    return [handlers, collecting, dict(os.environ), list(sys.argv), Path.cwd()]


@pytest.mark.parametrize('node', NODES)
def test_a_node_touches_and_asks_nothing_of_its_process(
    node: type[LiveNode], context: Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = '--params-file', str(parameter_file(tmp_path / 'n.yaml', {'/x/controller': {}}))
    monkeypatch.setattr(sys, 'argv', ['mine.py', '--axes', '1st', '--ros-args', *files])
    before = state_of_the_process()
    values = {'directory': str(tmp_path)} if node is RecorderNode else {}
    made = node(context=context, parameters=values)
    made.close()
    made.destroy_node()
    assert state_of_the_process() == before


def test_a_constructor_that_raises_leaves_no_node_on_the_graph(probe: Probe) -> None:
    for node in NODES:
        refusal(partial(node, namespace=probe.namespace, parameters={'rat': 1.0}))
    made = ControllerNode(namespace=probe.namespace, node_name='whole')
    probe.add(made)
    probe.wait_until(lambda: 'whole' in probe.nodes())
    assert sorted(probe.nodes()) == ['probe', 'whole']


@pytest.mark.parametrize(
    'executor', [SingleThreadedExecutor, EventsExecutor, MultiThreadedExecutor]
)
def test_loops_with_other_parameters_run_side_by_side_on_any_executor(
    executor: Callable[[], Executor], make_probe: Callable[..., Probe], namespace: str
) -> None:
    probe = make_probe(executor=executor)
    commands, controllers = {}, {}
    for side, load in {'left': 3.0, 'right': -2.0}.items():
        where: dict[str, Any] = {
            'namespace': namespace,
            'remappings': {topic: f'{side}/{topic}' for topic in ('measurement', 'command')},
        }
        disturbed = PLANT | {'disturbance': 'constant', 'disturbance_offset': load}
        probe.add(PlantNode(node_name=f'{side}_plant', parameters=disturbed, **where))
        node = probe.add(
            ControllerNode(
                node_name=f'{side}_controller',
                parameters=CONTROL | {'command_max': 10.0 + load},
                **where,
            )
        )
        assert node.get_fully_qualified_name() == f'{namespace}/{side}_controller'
        commands[side, load] = probe.listen(f'{side}/command')
        controllers[side] = node.controller

    def carried() -> bool:
        return all(heard and abs(heard[-1] + load) < 0.1 for (_, load), heard in commands.items())

    probe.wait_until(carried)
    assert probe.set('left_controller', inner_bandwidth=33.0) == ['']
    probe.wait_until(lambda: controllers['left'].settings.inner_bandwidth == 33.0)
    assert controllers['right'].settings.inner_bandwidth == 40.0
    assert controllers['right'].settings.command_max == 8.0
