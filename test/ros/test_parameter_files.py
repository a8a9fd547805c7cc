"""Parameter files and arguments: those that are for nobody here are refused, and nothing else."""

from __future__ import annotations

from pathlib import Path
import signal
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.ros.arguments import refuse_malformed, refuse_unheard
from nadrc_ros.scenario.parameter_files import ANY_CONTROLLER
from probe import parameter_file, Probe, Processes
import pytest

LIMITED: dict[str, Any] = {'command_max': 1.0}


def refusal(probe: Probe, *arguments: str, executable: str = 'probe') -> str:
    """Return why arguments of a process are refused, nothing if they are not."""
    command = ['node', '--ros-args', *arguments]
    try:
        refuse_malformed(command)
        refuse_unheard(probe.node, executable, command)
    except UserError as error:
        return str(error)
    return ''


def test_p13_a_file_for_another_controller_is_refused(start: Processes, tmp_path: Path) -> None:
    file = parameter_file(tmp_path / 'robot.yaml', {'/controller': LIMITED})
    process = start('controller', file=file)
    assert process.end() == 1
    assert f'cannot start: {file}: parameters of /controller and none of ' in process.said
    assert 'for any namespace name them /**/controller' in process.said
    assert len(process.own_lines) == 1, process.said


@pytest.mark.parametrize(
    ('keys', 'refused'),
    [
        (('/probe',), '/probe'),
        (('other/probe',), '/other/probe'),
        (('/*/*/probe',), '/*/*/probe'),
        (('/**',), ''),
        (('/**/probe',), ''),
        (('/*/probe',), ''),
        (('/controller',), ''),
        (('/**/plant', '/**/controller', '/recorder', 'reference'), ''),
        (('/**/prob',), '/**/prob'),  # one letter is missing
        (('my_probe',), '/my_probe'),
        (('/**/plant', '/**/prob'), '/**/prob'),
        (('/**', '/**/prob'), '/**/prob'),
        (('/**/probe', '/**/prob'), ''),  # that is for us, and the rest for whom it may be
        (('/robot/**',), '/robot/**'),
    ],
)
def test_p13_a_file_that_means_nobody_here_is_refused_unless_it_is_for_our_other_nodes(
    keys: tuple[str, ...], refused: str, probe: Probe, tmp_path: Path
) -> None:
    file = parameter_file(tmp_path / 'robot.yaml', dict.fromkeys(keys, LIMITED))
    full = probe.node.get_fully_qualified_name()
    said = refusal(probe, '--params-file', str(file))
    assert said.startswith(f'{file}: parameters of {refused} and none of {full}; ' * bool(refused))
    assert ('name them /**/probe (with' in said) == bool(refused)


@pytest.mark.parametrize('content', ('', '# b0: 2.0\n', '{}\n'))
def test_p13_an_empty_file_is_called_empty(content: str, probe: Probe, tmp_path: Path) -> None:
    (file := tmp_path / 'empty.yaml').write_text(content)
    said = refusal(probe, '--params-file', str(file))
    assert said == f'{file}: there are no parameters in it, it is empty'


def test_p13_a_renamed_node_is_told_what_to_write_in_a_file_of_our_tools(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    file = parameter_file(tmp_path / 'design.yaml', {ANY_CONTROLLER: LIMITED})
    process = start('controller', '-r', '__node:=yaw', file=file)
    assert process.end() == 1
    assert f'parameters of {ANY_CONTROLLER} and none of {start.namespace}/yaw' in process.said
    assert 'name them /**/yaw (' in process.said
    file.write_text(file.read_text().replace(ANY_CONTROLLER, '/**/yaw'))
    start('controller', '-r', '__node:=yaw', file=file)
    assert probe.get('yaw', 'command_max') == [1.0]


def test_what_a_node_shows_starts_one_of_another_name_and_namespace(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    """A dump has the QoS of topics that are called otherwise then."""
    start('controller', **LIMITED)
    shown = probe.all_parameters('controller')
    assert any(name.startswith('qos_overrides.') for name in shown)
    file = parameter_file(tmp_path / 'dump.yaml', {'/**/yaw': shown})
    moved = ('-r', '__node:=yaw', '-r', 'measurement:=heading')
    start('controller', *moved, namespace=f'{start.namespace}/arm', file=file)
    assert probe.get('arm/yaw', 'command_max') == [1.0]
    reliable = f'qos_overrides.{start.namespace}/measurement.subscription.reliability'
    file = parameter_file(file, {'/**/yaw': shown | {reliable: 'reliable'}})
    process = start('controller', *moved, namespace=f'{start.namespace}/leg', file=file)
    assert process.end() == 1
    assert (
        f"{reliable} = 'reliable': must be a parameter of yaw: did you mean qos_over"
        in process.said
    )


def test_p13_a_file_for_our_other_nodes_alone_is_no_secret(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    file = parameter_file(tmp_path / 'loop.yaml', {'/**/plant': {'rate': 100.0}})
    process = start('controller', file=file)
    said = f'{file} has no parameters of {start.namespace}/controller: it runs without them'
    probe.wait_until(lambda: said in process.said)


@pytest.mark.parametrize(
    ('arguments', 'refused'),
    [
        (('-p', 'prob:b0:=2.0'), 'there is no prob here'),
        (('--param', '/a/prob:b0:=2.0'), 'there is no /a/prob here'),
        (('-r', 'prob:measurement:=state'), 'there is no prob here'),
        (('-p', 'probe:b0:=2.0', '-r', 'probe:__ns:=/a'), ''),
        (('-p', 'b0:=2.0', '-r', '__node:=probe', '-r', 'measurement:=/a/b'), ''),
        (('-r', 'rostopic://measurement:=a', '-p', 'trace:=a:b:=c'), ''),
    ],
)
def test_p13_an_argument_for_a_node_that_is_not_here_is_refused(
    arguments: tuple[str, ...], refused: str, probe: Probe
) -> None:
    said = refusal(probe, *arguments)
    assert refused in said and bool(said) == bool(refused)


@pytest.mark.parametrize(
    ('text', 'refused'),
    [
        ('a:\n ros__parameters:\n  b0: 1.0\n  b0: 2.0\n', "line 4: the key 'b0' was given before"),
        ('a: {ros__parameters: {}}\na: {ros__parameters: {}}\n', "line 2: the key 'a' was given"),
        ('a:\n ros__parameters:\n\tb0: 1.0\n', 'line 3, column 1: not YAML'),
        ('a: {ros_parameters: {b0: 1.0}}', '/a/ros_parameters/b0 has a value that is not below'),
        ('a:\n ros__parameters:\n', 'ros__parameters of /a must be a mapping'),
        ('a: {ros__parameters: [1, 2]}', 'ros__parameters of /a must be a mapping'),
        ('- a', 'the file has a value that is not below'),
        ('a: {ros__parameters: {p: [1.0, 2]}}', 'p = [1.0, 2]: write [1.0, 2.0]'),
        (
            'a: {ros__parameters: {b: {p: [1.0, x]}}}',
            "b.p = [1.0, 'x']: a list must have numbers,",
        ),
        ('a: {ros__parameters: {p: [[1.0], [2.0]]}}', 'p = [[1.0], [2.0]]: a list must have'),
        ('a: {ros__parameters: {p: [~]}}', 'p = [None]: a list must have'),
        ('a: &a\n ros__parameters: {b0: 2.0}\nb: *a\n', 'line 3: ROS knows no aliases (*name)'),
        (b'\xff', 'not UTF-8'),
        (None, 'cannot be read: No such file'),
    ],
)
def test_p13_a_file_that_is_no_parameter_file_is_refused_before_ros_reads_it(
    text: str | bytes | None, refused: str, tmp_path: Path
) -> None:
    file = tmp_path / 'broken.yaml'
    if text is not None:
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(UserError) as caught:
        refuse_malformed(['node', '--ros-args', '--params-file', str(file)])
    assert str(caught.value).startswith(f'{file}: ') and refused in str(caught.value)


def test_p13_each_of_several_files_is_looked_at(start: Processes, tmp_path: Path) -> None:
    common = parameter_file(tmp_path / 'common.yaml', {'/**': {'rate': 150.0}})
    own = parameter_file(tmp_path / 'own.yaml', {'/controller': LIMITED})
    process = start('controller', '--params-file', str(own), file=common)
    assert process.end() == 1
    assert f'cannot start: {own}: parameters of /controller and none of ' in process.said


def test_p13_each_axis_is_meant_by_a_file_if_any_is(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    keys = [f'{start.namespace}/{axis}/controller' for axis in ('x', 'y', 'yy')]
    x, y = (parameter_file(tmp_path / f'{i}.yaml', {keys[i]: {'rate': 100.0}}) for i in range(2))
    axes = '--', '--axes', 'x', 'y'
    process = start('controller', '--params-file', str(y), *axes, file=x)
    probe.wait_until(lambda: probe.said('x/controller') and probe.said('y/controller'))
    process.signal(signal.SIGINT)
    assert probe.end_of(process) == 0
    both = parameter_file(tmp_path / 'both.yaml', {keys[0]: {}, keys[2]: LIMITED})
    process = start('controller', *axes, file=both)
    assert process.end() == 1
    assert f'axis y: {both}: parameters of {keys[0]}, {keys[2]} and none of ' in process.said
    assert f' and none of {keys[1]} (did you mean ' in process.said
