"""Axes of one process in messages that they share."""

from __future__ import annotations

import random
import signal
import time
from typing import Any

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import build
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.nodes.axes import axis_of
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.topics import SEND
from probe import parameter_file, Probe, Processes
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from wired import (
    BEGIN,
    Feed,
    joints,
    LAW,
    listen,
    Make,
    MS,
    steps,
    wired,
)

AXES = ('shoulder', 'elbow', 'wrist')


def axes(make: Make, **parameters: Any) -> tuple[Probe, list[Any], list[Any]]:
    """Run an axis for each joint, the k-th of which commands element k + 1 of an array."""
    probe = make()
    heard = listen(probe, Float64MultiArray, 'efforts')
    nodes: list[ControllerNode] = []
    for k, name in enumerate(AXES):
        given = wired(
            wiring_measurement=f'{probe.namespace}/joints sensor_msgs/JointState '
            f'position[name={name}]',
            wiring_command=f'{probe.namespace}/efforts std_msgs/Float64MultiArray data[{k + 1}]',
            wiring_fill=-1.0,
            safe_command=10.0 * (k + 1),
            **parameters,
        )
        first = nodes[0] if nodes else None
        nodes.append(
            axis_of(ControllerNode, first, ())(
                namespace=f'{probe.namespace}/{name}', parameters=given
            )
        )
    for node in nodes:
        probe.add(node)
    probe.wait_until(lambda: nodes[0]._command.has_readers)
    return probe, nodes, heard


def test_axes_hear_one_message_and_answer_in_one(make_probe: Make) -> None:
    probe, nodes, heard = axes(make_probe)
    feed = Feed(probe, nodes[2])
    laws = [
        Controller(build(ControllerSettings, {**LAW, 'safe_command': safe}))
        for safe in (10.0, 20.0, 30.0)
    ]
    for k in range(20):
        order = AXES if k % 3 else AXES[::-1]
        at = {name: 0.01 * k * (i + 1) for i, name in enumerate(AXES)}
        feed(joints(BEGIN + 10 * k * MS, order, **at))
        probe.wait_until(lambda: len(heard) > k)  # noqa: B023
        expected = [law.tick(at[n], 0.01 if k else 1.0) for law, n in zip(laws, AXES)]
        assert list(heard[k].data) == [-1.0, *expected]
    assert probe.node.count_publishers('efforts') == 1
    assert len(heard) == 20


def test_an_axis_that_is_off_or_blind_is_at_its_own_safe_command(make_probe: Make) -> None:
    probe, nodes, heard = axes(make_probe, share_command=False)
    feed = Feed(probe, nodes[0])
    probe.wait_until(lambda: not any(node._rivals.listening for node in nodes))
    nodes[1].enable(False)
    partial = AXES[:2]
    for k in range(30):
        feed(joints(BEGIN + 10 * k * MS, partial if k else AXES, shoulder=0.01 * k, elbow=1.0))
        probe.spin(0.02)
    assert heard[-1].data[2] == 20.0
    nodes[1].set_parameters([Parameter('safe_command', value=25.0)])
    feed(joints(BEGIN + 400 * MS, partial, shoulder=0.5, elbow=1.0))
    probe.wait_until(lambda: heard[-1].data[2] == 25.0)
    assert heard[-1].data[1] not in (10.0, heard[-2].data[1])
    assert not any(node._rivals.commanding or node._rivals.gave_way for node in nodes)
    for node in nodes:
        node.begin_stop()
    for node in nodes:
        node.close()
    probe.wait_until(lambda: list(heard[-1].data) == [-1.0, 10.0, 25.0, 30.0])


def test_axes_on_one_timer_send_one_message_a_period(make_probe: Make) -> None:
    probe, nodes, heard = axes(make_probe, trigger='timer', rate=50.0)
    feed = Feed(probe, nodes[1])
    feed(joints(BEGIN, AXES))
    before, ticks = len(heard), nodes[0].ticker.periods
    probe.wait_until(lambda: nodes[0].ticker.periods >= ticks + 50)
    assert len(heard) - before == pytest.approx(nodes[0].ticker.periods - ticks, abs=2)
    still = list(heard[-1].data)
    feed(joints(BEGIN + 20 * MS, AXES, shoulder=8.0, elbow=8.0, wrist=8.0))
    probe.wait_until(lambda: list(heard[-1].data) != still)
    moved = next(message.data for message in heard[before:] if list(message.data) != still)
    assert all(now != then for now, then in zip(moved[1:], still[1:]))  # of one period, all of it


def test_an_element_that_another_axis_commands_is_refused(make_probe: Make) -> None:
    probe = make_probe()
    first = probe.add(ControllerNode(namespace=f'{probe.namespace}/x', parameters=wired()))
    with pytest.raises(UserError, match='another axis of this process commands it'):
        axis_of(ControllerNode, first, ())(
            namespace=f'{probe.namespace}/x', node_name='other', parameters=wired()
        )
    fill = wired(wiring_fill=1.0, wiring_command='efforts std_msgs/Float64MultiArray data[0]')
    with pytest.raises(UserError, match='are one for all axes'):
        axis_of(ControllerNode, first, ())(
            namespace=f'{probe.namespace}/x', node_name='third', parameters=fill
        )


def test_p14_a_signal_sends_all_elements_to_their_safe_commands(
    probe: Probe, start: Processes
) -> None:
    both = {
        f'{start.namespace}/{name}/controller': wired(
            wiring_measurement=f'{start.namespace}/joints sensor_msgs/JointState position[{k}]',
            wiring_command=f'{start.namespace}/efforts std_msgs/Float64MultiArray data[{k}]',
            safe_command=5.0 + k,
            command_rate_limit=1000.0,
        )
        for k, name in enumerate(AXES)
    }
    file = parameter_file(start.directory / 'axes.yaml', both)
    heard = listen(probe, Float64MultiArray, 'efforts')
    send = probe.node.create_publisher(JointState, 'joints', SEND)
    process = start.run(
        *('axes', '-m', 'nadrc_ros.nodes.controller', '--axes', *AXES, '--ros-args'),
        *('-r', f'__ns:={start.namespace}', '--params-file', str(file)),
    )
    safe = [5.0, 6.0, 7.0]

    def moved() -> bool:
        send.publish(joints(time.time_ns(), AXES, **dict.fromkeys(AXES, time.monotonic() % 10.0)))
        return bool(heard) and all(now != then for now, then in zip(heard[-1].data, safe))

    probe.wait_until(moved)
    process.signal(signal.SIGINT)
    assert probe.end_of(process) == 0, process.said
    probe.wait_until(lambda: list(heard[-1].data) == safe)
    assert 'Traceback' not in process.said


def test_axes_take_the_quality_of_service_of_a_topic_that_they_share(
    make_probe: Make, namespace: str
) -> None:
    depth = f'qos_overrides.{namespace}/joints.subscription.depth'
    _, nodes, _ = axes(make_probe, **{depth: 7})
    assert nodes[0].inputs[0].qos.depth == 7


class Joint:
    """A joint that integrates its command and a load; the law on Float64 sees the same of it."""

    def __init__(self, load: float, safe: float) -> None:
        self.law = Controller(build(ControllerSettings, {**LAW, 'safe_command': safe}))
        self.load = load
        self.y = 0.0
        self.seen = -1

    def move(self, command: float) -> None:
        self.y += 0.01 * (command + self.load)


def in_the_wild(make: Make, shuffled: bool) -> tuple[list[list[float]], list[list[float]]]:
    """Run three joints for 4 s; return the commands that were sent, and those on Float64."""
    probe, nodes, heard = axes(make)
    feed = Feed(probe, nodes[0])
    others = probe.node.create_publisher(JointState, 'joints', SEND)
    probe.wait_until(others.get_subscription_count)
    dice = random.Random(3)
    loops = [Joint(load, 10.0 * (k + 1)) for k, load in enumerate((0.5, -1.0, 2.0))]
    order, expected = list(AXES), []
    for k in range(400):
        if shuffled and k % 50 == 0:
            dice.shuffle(order)
        if k % 4 == 2:  # who tells the fingers only
            before = nodes[0].inputs[0].absences
            others.publish(joints(BEGIN + 10 * k * MS, ('finger', 'thumb')))
            probe.wait_until(lambda: nodes[0].inputs[0].absences > before)  # noqa: B023
        blind = 150 <= k < 200  # the elbow, for half a second
        there = tuple(name for name in order if not (blind and name == 'elbow'))
        at = {name: loop.y for name, loop in zip(AXES, loops)}
        feed(joints(BEGIN + 10 * k * MS, there, **at))
        probe.wait_until(lambda: len(heard) > k)  # noqa: B023
        for name, loop in zip(AXES, loops):
            if name in there:
                loop.law.tick(loop.y, 0.01 * (k - loop.seen) if k else 1.0)
                loop.seen = k
        expected.append([loop.law.command for loop in loops])
        for loop, command in zip(loops, heard[k].data[1:]):
            loop.move(command)
    assert not any(steps(node).get('bad_time_step') for node in nodes)
    probe.close()
    return [list(message.data[1:]) for message in heard], expected


def test_p24_three_joints_in_the_wild_are_commanded_as_on_float64_to_the_bit(
    make_probe: Make,
) -> None:
    sent, expected = in_the_wild(make_probe, shuffled=True)
    assert sent == expected
    assert sent == in_the_wild(make_probe, shuffled=False)[0]
    assert all(abs(command) < 40.0 for row in sent for command in row)
    assert [round(command, 2) for command in sent[-1]] == [-0.5, 1.0, -2.0]
