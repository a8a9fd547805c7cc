"""Several axes in one process: each is a controller of its own, and all of them have one fate."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from typing import Any

from nadrc_ros.nodes.axes import axis_spaces
from nadrc_ros.ros.runtime import LOCKED_UP
from probe import NodeProcess, parameter_file, Probe, Processes
import pytest

AXES = {'x': 3.0, 'y': -2.0, 'z': 0.5}
CONTROL: dict[str, Any] = {
    'rate': 50.0,
    'plant_order': 1,
    'b0': 1.0,
    'controller_bandwidth': 8.0,
    'command_rate_limit': 100.0,
}
# One axis and another is told from the load that its plant has.
PLANT: dict[str, Any] = {
    'rate': 50.0,
    'plant': 'chain',
    'order': 1,
    'damping': 0.0,
    'disturbance': 'constant',
}
BROKEN = """
import sys
from nadrc_ros.nodes.controller import ControllerNode, make_axes
from nadrc_ros.ros.runtime import run

def tick(self, *arguments):
    original(self, *arguments)
    if self.controller.settings.good_samples == 7:
        raise ZeroDivisionError('on purpose')

original, ControllerNode._take_sample = ControllerNode._take_sample, tick
raise SystemExit(run(lambda: make_axes(sys.argv)))
"""
# Slack for a machine that has other things to do; promised is 1 s.
SLACK = 3.0


def run_axes(
    start: Processes, *python: str, axes: tuple[str, ...] = tuple(AXES), **parameters: Any
) -> NodeProcess:
    """Run axes in the namespace of the test; ``x_b0=2.0`` is for the axis x alone."""
    by_node: dict[str, dict[str, Any]] = {'/**': dict(CONTROL)}
    for key, value in parameters.items():
        axis, _, name = key.partition('_')
        node = f'{start.namespace}/{axis}/controller' if axis in axes else '/**'
        by_node.setdefault(node, {})[name if axis in axes else key] = value
    file = parameter_file(start.directory / 'axes.yaml', by_node)
    ros = ('--ros-args', '-r', f'__ns:={start.namespace}', '--params-file', str(file))
    return start.run(
        'axes', *(python or ('-m', 'nadrc_ros.nodes.controller')), '--axes', *axes, *ros
    )


def run_loops(
    probe: Probe, start: Processes, *python: str, **parameters: Any
) -> tuple[dict[str, list[float]], NodeProcess]:
    """Run three loops until each command carries the load of its plant."""
    commands: dict[str, list[float]] = {axis: probe.listen(f'{axis}/command') for axis in AXES}
    for axis, load in AXES.items():
        parameters[f'{axis}_safe_command'] = 10.0 + load
    controllers = run_axes(start, *python, **parameters)
    for axis, load in AXES.items():
        space = f'{start.namespace}/{axis}'
        start('plant', **PLANT, disturbance_offset=load, namespace=space)

    def carried() -> bool:
        return all(commands[a] and abs(commands[a][-1] + AXES[a]) < 0.2 for a in AXES)

    probe.wait_until(carried)
    return commands, controllers


def all_safe(commands: dict[str, list[float]]) -> bool:
    return all(commands[axis][-1] == 10.0 + load for axis, load in AXES.items())


@pytest.mark.parametrize('trigger', ['timer', 'measurement'])
def test_p14_axes_are_controllers_of_their_own_and_a_signal_sends_each_to_its_safe_command(
    trigger: str, probe: Probe, start: Processes
) -> None:
    commands, controllers = run_loops(probe, start, trigger=trigger, x_inner_bandwidth=33.0)
    assert probe.get('x/controller', 'inner_bandwidth') == [33.0]
    assert probe.set('y/controller', inner_bandwidth=44.0, rate=60.0)[0] == ''
    assert probe.get('x/controller', 'inner_bandwidth') == [33.0]
    assert probe.get('z/controller', 'inner_bandwidth') == [40.0]
    assert probe.enable(False, node='z/controller').success
    probe.wait_until(lambda: commands['z'][-1] == 10.5)
    probe.wait_until(lambda: abs(commands['x'][-1] + 3.0) < 0.2)
    modes = {}
    for axis in AXES:
        probe.wait_until(lambda: probe.said(f'{axis}/controller'))  # noqa: B023
        modes[axis] = probe.said(f'{axis}/controller')[-1][2]['enabled']
    assert modes == {'x': 'True', 'y': 'True', 'z': 'False'}
    begin = controllers.signal(signal.SIGINT)
    assert probe.end_of(controllers) == 0, controllers.said
    seconds = time.monotonic() - begin
    print(f'ended after {seconds:.2f} s')
    assert seconds < SLACK
    probe.wait_until(lambda: all_safe(commands))
    assert 'Traceback' not in controllers.said


def test_p14_an_exception_on_one_axis_sends_all_of_them_to_their_safe_command(
    probe: Probe, start: Processes
) -> None:
    commands, controllers = run_loops(probe, start, '-c', BROKEN)
    probe.set_and_go('y/controller', good_samples=7)
    assert probe.end_of(controllers) == 1
    assert 'ZeroDivisionError: on purpose' in controllers.said
    probe.wait_until(lambda: all_safe(commands))


@pytest.mark.parametrize(
    ('axes', 'parameters', 'complaint'),
    [
        (('x', '2nd'), {}, "'2nd'"),
        (('x', 'a/b'), {}, "'a/b'"),
        (('x', 'a__b'), {}, "'a__b'"),
        (('x', 'y', 'x'), {}, "'x' is there twice"),
        (('x', 'y'), {'y_rate': 100.0}, 'rate is 50.0 for {}/x/controller and 100.0 for {}/y'),
        (('x', 'y'), {'y_trigger': 'measurement'}, 'trigger is timer for {}/x/controller'),
    ],
)
def test_axes_that_cannot_be_are_refused_in_one_line(
    axes: tuple[str, ...], parameters: dict[str, Any], complaint: str, start: Processes
) -> None:
    process = run_axes(start, axes=axes, **parameters)
    assert process.end() == 1
    assert complaint.format(*[start.namespace] * 2) in process.said
    assert len(process.own_lines) == 1, process.said


def test_an_axis_that_is_refused_is_named_and_leaves_nothing_of_the_others(
    start: Processes,
) -> None:
    trace = start.directory / 'x.jsonl'
    process = run_axes(start, axes=('x', 'y'), x_trace=str(trace), y_inner_bandwidth=-1.0)
    assert process.end() == 1
    assert 'axis y: ' in process.said and 'inner_bandwidth' in process.said
    assert not trace.exists()


def test_what_an_axis_is_called_composes_with_the_namespace_of_the_command_line() -> None:
    def space(*rules: str) -> str:
        return axis_spaces(['controller', '--axes', 'x', '--ros-args', *rules])['x']

    assert space('-r', 'a:=b') == '/x'
    assert space('-r', '__ns:=/robot') == '/robot/x'
    assert space('-r', 'controller:__ns:=/', '-r', '__ns:=/late') == '/x'
    assert axis_spaces(['controller']) == {}


def test_the_help_explains_the_axes_and_a_misspelt_option_is_a_usage_error() -> None:
    def controller(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, '-m', 'nadrc_ros.nodes.controller', *arguments]
        return subprocess.run(command, check=False, capture_output=True, text=True)

    told = controller('--help')
    assert told.returncode == 0 and '--axes NAME' in told.stdout and '/**' in told.stdout
    refused = controller('--axis', 'x')
    assert refused.returncode == 2 and '--axis' in refused.stderr


def test_in_lockstep_each_axis_goes_by_its_own_samples_and_the_last_one_ends_the_process(
    probe: Probe, start: Processes
) -> None:
    paced: dict[str, Any] = {'rate': 50.0, 'pacing': 'lockstep', 'reference_derivatives': 'none'}
    axes = run_axes(
        start, axes=('x', 'y'), **paced, x_steps=20, y_steps=40, readers='command: plant'
    )
    del paced['reference_derivatives']
    processes = [axes]
    for axis, steps in {'x': 20, 'y': 40}.items():
        own = {**paced, 'steps': steps, 'namespace': f'{start.namespace}/{axis}'}
        processes += [
            start('plant', **PLANT | own, readers='measurement: controller reference'),
            start('reference', **own, readers='reference: controller'),
        ]
    # a plant ends well when it had a command for each of its steps
    codes = [probe.end_of(process) for process in processes]
    assert set(codes) <= {0, LOCKED_UP}, axes.said  # they go at the same moment
