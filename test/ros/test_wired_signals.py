"""Signals that are fields of messages: in, out, stamped, missing, refused."""

from __future__ import annotations

from copy import deepcopy
from importlib import metadata
from math import cos, nan, sin
import random
import signal
import time
from typing import Any

from geometry_msgs.msg import TwistStamped
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import build
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Status
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.diagnostics import WARN
from nadrc_ros.ros.exchange import Exchange
from nadrc_ros.ros.topics import receive, RECORD, SEND, Sender
from nadrc_ros.ros.wires import make_wire, missing_type
from nadrc_ros.wiring.address import parse_address
from nav_msgs.msg import Odometry
from probe import Probe, Processes
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, UInt8
from wired import (
    BEGIN,
    CONTROL,
    Feed,
    joints,
    LAW,
    listen,
    Make,
    MS,
    run,
    steps,
    wired,
)


def test_a_missing_message_package_is_named_for_the_distribution_that_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv('ROS_DISTRO', raising=False)
    wheels = {each.name for each in metadata.distributions()}
    for name in ('jazzy', 'kilted'):
        if f'ros-{name}-rclpy' in wheels:
            assert f': ros-{name}-own-msgs has it' in missing_type('own_msgs/msg/X')
    monkeypatch.setenv('ROS_DISTRO', 'lyrical')
    assert ': ros-lyrical-own-msgs has it' in missing_type('own_msgs/msg/X')


@pytest.mark.parametrize('executor', [None, SingleThreadedExecutor])
def test_a_joint_moves_an_element_of_an_array(make_probe: Make, executor: Any) -> None:
    """With the numbers that the law gives for it, whatever the order of the joints."""
    probe, node = run(make_probe, wired(), **({'executor': executor} if executor else {}))
    heard = listen(probe, Float64MultiArray, 'efforts')
    feed = Feed(probe, node)
    probe.wait_until(lambda: node._command.has_readers)
    law = Controller(build(ControllerSettings, LAW))
    expected = []
    for k in range(40):
        order = ('shoulder', 'elbow') if k % 3 else ('elbow', 'wrist', 'shoulder')
        y = 0.01 * k * k
        feed(joints(BEGIN + 10 * k * MS, order, elbow=y))
        expected.append(law.tick(y, 0.01 if k else 1.0))
        probe.wait_until(lambda: len(heard) > k)  # noqa: B023
    assert [message.data[0] for message in heard] == [0.0] * 40
    assert [message.data[1] for message in heard] == expected
    assert expected[-1] != 0.0
    assert node.controller.counts == law.counts


def refused(make: Make, **parameters: Any) -> str:
    probe = make(parameters={'controller': wired(start_timeout=0.2, **parameters)})
    with pytest.raises(UserError) as caught:
        probe.add(ControllerNode())
    said = str(caught.value)
    assert '\n' not in said
    return said


REFUSED = [
    ({'wiring_measurement': 'joints position'}, 'nobody has a topic', '/probe_topic std_msgs'),
    ({'wiring_measurement': '/x own_msgs/X y'}, 'own_msgs is not installed', '-own-msgs has it'),
    ({'wiring_reference': '/x sensor_msgs/Imo y'}, 'has no message Imo', 'did you mean Imu?'),
    ({'wiring_measurement': '/x sensor_msgs/Imu y'}, 'wiring.measurement', 'there are header'),
    ({'wiring_measurement': '/x sensor_msgs/JointState position'}, 'which element', '[name=...]'),
    ({'wiring_measurement': '/x sensor_msgs/Imu header.frame_id'}, 'is a string', 'wiring.meas'),
    ({'wiring_reference_rate': '/x y z'}, 'wiring.reference_rate', 'is too much'),
    (
        {'wiring_command': '/x nav_msgs/Odometry pose.pose.orientation.yaw'},
        'cannot be written',
        '',
    ),
    ({'wiring_command': 'x std_msgs/Float64MultiArray data[-1]'}, 'elements are [0]', 'command'),
    ({'wiring_frame_id': 'base'}, 'has no header', 'wiring.frame_id'),
    ({'wiring_frame_id': 'base', 'wiring_command': ''}, 'wiring.frame_id', 'has no header'),
    ({'wiring_stamp': 'now'}, 'wiring.stamp', 'header, source, receipt'),
    ({'pacing': 'lockstep', 'steps': 9}, 'wiring.measurement', 'pacing: lockstep'),
    ({'wiring_comand': 'x y'}, 'wiring.comand', 'wiring.command'),
    *(
        ({f'wiring_{name}': '/x std_msgs/Float64 data', **more}, f'wiring.{name} = ', why)
        for name, why, more in (
            ('applied', 'must be left out: applied_timeout is 0 (off)', {}),
            ('feed_forward', 'must be left out: feed_forward_timeout is 0 (off)', {}),
            ('b0_variable', 'must be left out: b0_source is not topic', {}),
            ('reference_acceleration', 'takes 1 derivatives', {'plant_order': 1}),
            ('reference_rate', 'takes 0 derivatives', {'reference_derivatives': 'none'}),
        )
    ),
    ({'b0_source': 'topic'}, 'b0_source', 'left out without a b0_table'),
    ({'b0_source': 'reference'}, 'b0_source', 'left out without a b0_table'),
]


@pytest.mark.parametrize(('parameters', 'why', 'how'), REFUSED)
def test_what_cannot_be_wired_is_refused_at_the_start_by_name(
    make_probe: Make, parameters: dict[str, Any], why: str, how: str
) -> None:
    probe: Probe | None = None

    def make(**more: Any) -> Probe:
        nonlocal probe
        probe = make_probe(**more)
        probe.publisher('/probe_topic')
        return probe

    said = refused(make, **parameters)
    assert why in said and how in said


def test_the_type_comes_from_the_graph_where_it_is_left_out(make_probe: Make) -> None:
    probe = make_probe(parameters={'controller': wired(wiring_measurement='joints position[0]')})
    publisher = probe.node.create_publisher(JointState, 'joints', SEND)
    node = probe.add(ControllerNode())
    probe.wait_until(publisher.get_subscription_count)
    publisher.publish(joints(BEGIN, shoulder=3.0))
    probe.wait_until(lambda: node.controller.counts)
    assert node.inputs[0].message_type == 'sensor_msgs/msg/JointState'


def test_p14_a_signal_ends_a_node_that_waits_for_a_type(start: Processes, probe: Probe) -> None:
    waiting: Any = {'wiring.measurement': 'joints position[0]'}
    process = start('controller', **waiting)
    probe.wait_until(lambda: 'controller' in probe.nodes())
    process.signal(signal.SIGTERM)
    assert probe.end_of(process) == 0, process.said


def test_who_is_missing_is_no_sample_and_is_told(make_probe: Make) -> None:
    probe, node = run(make_probe, wired())
    feed = Feed(probe, node)
    feed(joints(BEGIN, elbow=1.0))
    for k in range(1, 4):
        feed(joints(BEGIN + k * MS, ('shoulder', 'wrist')))
    assert steps(node) == {'ok': 1}
    message = 'elbow is not among shoulder, wrist'
    probe.wait_until(lambda: any(message in said[1] for said in probe.said()))
    level, _, values = probe.said()[-1]
    assert level >= WARN
    assert values['measurements_without_the_field'] == '3'
    assert node._sample_ticker is not None
    assert node._sample_ticker.missed == 0  # they were not lost
    feed(joints(BEGIN + 9 * MS, elbow=1.0))
    probe.wait_until(lambda: message not in probe.said()[-1][1])


def test_a_part_that_another_publisher_tells_does_not_replace_ours(make_probe: Make) -> None:
    """Both come before the controller looks, as after a callback that took its time."""
    probe, node = run(make_probe, wired())
    feed = Feed(probe, node)
    others = probe.node.create_publisher(JointState, 'joints', SEND)
    probe.wait_until(others.get_subscription_count)
    heard = node.inputs[0]
    for k in range(20):
        feed.publisher.publish(joints(BEGIN + 10 * k * MS, elbow=1.0))
        others.publish(joints(BEGIN + 10 * k * MS, ('finger', 'thumb')))
        time.sleep(0.01)
        probe.wait_until(lambda: heard.absences == k + 1)  # noqa: B023
        assert heard.count == k + 1


def test_p24_no_bytes_of_a_message_enter_an_observer_or_end_a_node(make_probe: Make) -> None:
    probe, node = run(make_probe, wired())
    feed = Feed(probe, node)
    for k in range(3):
        feed(joints(BEGIN + 10 * k * MS, elbow=1.0))
    before = deepcopy(node.controller.state.levels)
    whole = bytes(serialize_message(joints(BEGIN + 30 * MS, elbow=2.0)))
    dice = random.Random(1)
    bad = [whole[: dice.randrange(20, 70)] for _ in range(20)]
    bad += [whole[:4] + dice.randbytes(dice.randrange(80)) for _ in range(20)]
    for data in bad:
        feed(data)
    taken = node.controller.counts
    assert sum(n for status, n in taken.items() if status < Status.NO_MEASUREMENT) == 3
    assert node.controller.state.levels == before
    feed(joints(BEGIN + 40 * MS, elbow=1.0))
    assert sum(n for status, n in taken.items() if status < Status.NO_MEASUREMENT) == 4


def test_a_reference_in_the_same_message_counts_for_the_step_it_triggers(make_probe: Make) -> None:
    goal = 'joints sensor_msgs/msg/JointState position[name=goal]'
    probe, node = run(make_probe, wired(wiring_reference=goal))
    feed = Feed(probe, node)
    law = Controller(build(ControllerSettings, LAW))
    for k in range(5):
        feed(joints(BEGIN + 10 * k * MS, ('goal', 'elbow'), goal=2.0 + k, elbow=1.0))
        law.tick(1.0, 0.01 if k else 1.0, reference=[2.0 + k])
        assert node.controller.command == law.command


def test_a_number_is_the_one_that_was_sent_to_the_bit(make_probe: Make) -> None:
    probe, node = run(make_probe, wired(wiring_measurement='y std_msgs/Float64 data'))
    got: list[float] = []
    wire = node._wiring.wires['measurement']
    receive(node, 'unused', lambda value, _: got.append(value), wire=wire)
    send = probe.publisher('y')
    for value in (-0.0, 5e-324, 1e308, 0.1):
        send(value)
        probe.wait_until(lambda: got and repr(got[-1]) == repr(value))  # noqa: B023


def test_a_command_is_written_so_that_its_address_reads_it(make_probe: Make) -> None:
    """Scaled, and as the whole number that the type has; out of its range is its end."""
    command = 'pwm std_msgs/UInt8 data * 0.5 + 10'
    probe, node = run(make_probe, wired(wiring_command=command))
    heard = listen(probe, UInt8, 'pwm')
    probe.wait_until(lambda: node._command.has_readers)
    for value, data in ((10.0, 0), (20.2, 20), (1e308, 255), (-1e308, 0), (-0.0, 0)):
        node._command.send(value)
        probe.wait_until(lambda: heard and heard[-1].data == data)  # noqa: B023
    count = len(heard)
    node._command.send(nan)
    probe.spin(0.1)
    assert {message.data for message in heard[count:]} <= {0}


def test_p14_the_last_command_is_safe_in_any_message_and_has_the_time_of_its_sample(
    make_probe: Make,
) -> None:
    parameters = wired(
        wiring_measurement='odom nav_msgs/Odometry pose.pose.orientation.yaw',
        wiring_command='cmd_vel geometry_msgs/TwistStamped twist.angular.z',
        wiring_frame_id='base_link',
        safe_command=0.5,
    )
    probe, node = run(make_probe, parameters)
    heard = listen(probe, TwistStamped, 'cmd_vel')
    feed = Feed(probe, node, Odometry, 'odom')
    probe.wait_until(lambda: node._command.has_readers)
    for k in range(5):
        odometry = Odometry()
        odometry.header.stamp = joints(BEGIN + 10 * k * MS).header.stamp
        odometry.pose.pose.orientation.z = 1.04 * sin(0.6 + 0.01 * k)  # its norm is not quite 1
        odometry.pose.pose.orientation.w = 1.04 * cos(0.6 + 0.01 * k)
        feed(odometry)
        probe.wait_until(lambda: len(heard) > k)  # noqa: B023
        assert heard[k].header.stamp == odometry.header.stamp
    assert heard[-1].header.frame_id == 'base_link'
    assert node.controller.reference[0] == pytest.approx(1.2)
    assert heard[-1].twist.angular.z != 0.5
    node.begin_stop()
    node.close()
    probe.wait_until(lambda: heard[-1].twist.angular.z == 0.5)
    assert heard[-1].twist.linear.x == 0.0
    assert heard[-1].header.stamp.sec > 1.01e-9 * BEGIN  # it answers no sample


def test_p16_who_commands_in_the_same_element_is_noticed(make_probe: Make) -> None:
    probe = make_probe(parameters={'controller': wired(share_command=False)})
    other = probe.node.create_publisher(Float64MultiArray, 'efforts', SEND)
    node = probe.add(ControllerNode())
    probe.node.create_timer(0.02, lambda: other.publish(Float64MultiArray(data=[1.0, 2.0])))
    probe.wait_until(lambda: 'commands on' in ''.join(said[1] for said in probe.said()))
    assert node._rivals.gave_way


def test_float64_stays_the_default(make_probe: Make) -> None:
    _, node = run(make_probe, CONTROL)
    assert [each.message_type for each in node.inputs] == ['std_msgs/msg/Float64'] * len(
        node.inputs
    )
    assert type(node._command) is Sender


PLACES = [
    ('sensor_msgs/JointState position[name=elbow]', 'sensor_msgs/JointState velocity[name=wrist]'),
    (
        'trajectory_msgs/JointTrajectory points[0].velocities[1]',
        'trajectory_msgs/JointTrajectory points[1].positions[0]',
    ),
    ('geometry_msgs/TwistStamped twist.linear.x', 'geometry_msgs/TwistStamped twist.angular.z'),
    ('nav_msgs/Odometry twist.covariance[35]', 'nav_msgs/Odometry pose.covariance[0] * -2'),
    ('std_msgs/Int16MultiArray data[3]', 'std_msgs/Int16MultiArray data[0]'),
    ('std_msgs/Bool data', ''),
]


@pytest.mark.parametrize('places', PLACES)
def test_a_command_can_be_anywhere_in_a_message(probe: Probe, places: tuple[str, str]) -> None:
    """Written through the middleware's own classes, and read back by the same address."""
    exchange = Exchange()
    wires = [
        make_wire(probe.node, 'command', parse_address(f'out {place}'), 'header', 0.0)
        for place in places
        if place
    ]
    fields: list[Any] = [exchange.sender(probe.node, wire, 0.0, '', 7.0) for wire in wires]
    got: list[tuple[float, ...]] = []

    def take(data: bytes, _: Any) -> None:
        got.append(tuple(wire.reader.read(data) or 0.0 for wire in wires))

    receive(
        probe.node,
        '',
        lambda *_: None,
        RECORD,
        wire=wires[0],
        join=lambda _, __, subscribe: subscribe(take),
    )
    probe.wait_until(lambda: fields[0].has_readers)
    assert all(field._message is fields[0]._message for field in fields)
    for i, field in enumerate(fields):
        field.send(1.0 + i)
    exchange.flush()
    probe.wait_until(lambda: got)
    assert got[-1] == tuple(1.0 + i for i in range(len(fields)))
