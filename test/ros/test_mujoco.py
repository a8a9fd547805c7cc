"""The machines of examples/mujoco, which know nothing of us, under the parameter files beside."""

from __future__ import annotations

import time
from typing import Any

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from probe import Probe, Processes, ROOT
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from wired import listen

pytest.importorskip('mujoco', reason='the test extra brings it')
FOLDER = ROOT / 'examples' / 'mujoco'


def run(start: Processes, machine: str, *more: str) -> list[Any]:
    """Run a machine and its controllers as they are in the files, with these topics: not ours."""
    file = str(FOLDER / f'{machine}.yaml')
    ros = ('--ros-args', '--params-file', file)
    return [
        start.run(machine, str(FOLDER / 'machine.py'), machine),
        start.run('controller', '-m', 'nadrc_ros.nodes.controller', *more, *ros),
    ]


def test_two_joints_of_an_arm_go_where_they_are_told(probe: Probe, start: Processes) -> None:
    processes = run(start, 'arm', '--axes', 'shoulder', 'elbow')
    states = listen(probe, JointState, '/joint_states')
    efforts = listen(probe, Float64MultiArray, '/efforts')
    probe.wait_until(lambda: efforts and states)
    send = {axis: probe.publisher(f'/{axis}/reference') for axis in ('shoulder', 'elbow')}
    aim = {'shoulder': 0.8, 'elbow': -0.5}

    def there() -> bool:
        for axis, value in aim.items():
            send[axis](value)
        last = dict(zip(states[-1].name, states[-1].position))
        return all(abs(last[axis] - value) < 0.01 for axis, value in aim.items())

    probe.wait_until(there)
    count, came = len(efforts), len(states)
    probe.spin(1.0)
    assert there()
    assert abs(efforts[-1].data[0]) > 1.0  # it carries itself
    # One for each message, both joints, is half of what two would be; a state may get lost.
    assert len(efforts) - count < 1.5 * (len(states) - came)
    assert all(process.running for process in processes), processes[1].said


def test_a_rover_turns_to_a_heading(probe: Probe, start: Processes) -> None:
    processes = run(start, 'rover')
    odometry = listen(probe, Odometry, '/odom')
    commands = listen(probe, TwistStamped, '/cmd_vel')
    probe.wait_until(lambda: odometry and commands)
    send = probe.publisher('/reference')

    def turned() -> bool:
        send(1.5)
        return bool(abs(odometry[-1].pose.pose.orientation.z - 0.6816387600233341) < 0.005)

    probe.wait_until(turned)
    assert max(command.twist.angular.z for command in commands) <= 1.0
    assert commands[-1].header.frame_id == 'base_link'
    stamps = {(o.header.stamp.sec, o.header.stamp.nanosec) for o in odometry}
    answered = [(c.header.stamp.sec, c.header.stamp.nanosec) for c in commands]
    last = answered[-100:]  # before, it was silent at times; and the probe may have missed some
    assert sum(stamp in stamps for stamp in last) > 0.5 * len(last)
    assert all(process.running for process in processes), processes[1].said


@pytest.mark.parametrize(
    ('machine', 'what', 'bounds', 'aim'),
    [
        ('arm', 'elbow', '--max-command 2 --travel 0.6 --speed 4', 0.8),
        ('rover', 'heading', '--max-command 0.5 --travel 1 --speed 1 --actuator-timeout 0.5', 1.5),
    ],
)
def test_from_nothing_to_a_loop_that_settles(
    machine: str, what: str, bounds: str, aim: float, soak: bool, probe: Probe, start: Processes
) -> None:
    if not soak:
        pytest.skip('DID NOT RUN: takes a minute, and a machine that keeps time; with --soak')
    out = start.directory / 'out'
    start.run(machine, str(FOLDER / 'machine.py'), machine)
    words = ('--params', str(FOLDER / f'{what}.yaml'), *bounds.split(), '--yes', '--out', str(out))
    process = start.run('commission', '-m', 'nadrc_ros.cli', 'commission', *words)
    assert process.end(200.0) == 0, process.said
    assert ('the actuator stopped after 0.5' in process.said) == (machine == 'rover')
    print(process.said)
    file = ('--ros-args', '--params-file', str(out / 'commissioned.yaml'))
    start.run('controller', '-m', 'nadrc_ros.nodes.controller', *file)
    estimates = probe.listen('/controller/output_estimate')
    assert probe.enable(True, '/controller').success
    send = probe.publisher('/reference')

    outside = [time.monotonic()]

    def settled() -> bool:
        send(aim)
        if not estimates or abs(estimates[-1] - aim) > 0.01:
            outside[0] = time.monotonic()
        return time.monotonic() - outside[0] > 2.0

    probe.wait_until(settled)
