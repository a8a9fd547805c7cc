"""A recorder listens to what the controller is wired to, by the parameters of that one."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
import time

from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.records.recording import read_samples
import pytest
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from wired import joints, listen, Make, wired

PERIOD = 20_000_000


def test_in_simulated_time_rows_are_at_the_times_of_headers(
    make_probe: Make, tmp_path: Path
) -> None:
    recorder = {'directory': str(tmp_path), 'inputs': 'reference measurement command'}
    sim = {'use_sim_time': True}
    probe = make_probe(parameters={'controller': wired(**sim), 'recorder': recorder | sim})
    clock = probe.node.create_publisher(Clock, '/clock', 10)
    send = probe.node.create_publisher(JointState, 'joints', 10)
    node, controller = probe.add(RecorderNode()), probe.add(ControllerNode())
    probe.wait_until(lambda: send.get_subscription_count() > 1)
    probe.wait_until(lambda: controller._command.publisher.get_subscription_count() > 0)
    for k in range(40):
        now = 5_000_000_000 + k * PERIOD
        clock.publish(Clock(clock=joints(now).header.stamp))
        probe.wait_until(lambda: node.get_clock().now().nanoseconds == now)  # noqa: B023
        late = 3_000_000 if k % 3 else 9_000_000  # until it is there
        send.publish(joints(now - late, elbow=0.1 * k))
        heard = node.intake.losses['measurement']
        probe.wait_until(lambda: heard.newest > k)  # noqa: B023
    node.close()
    spans = [b - a for a, b in pairwise(read_samples(node.folder.path)['time'])]
    assert len(spans) > 20
    assert {round(1e3 * span, 6) for span in spans} <= {14.0, 20.0, 26.0}
    assert len({round(1e3 * span, 6) for span in spans}) == 3


def test_it_records_what_acts_and_the_feed_forward_where_the_controller_hears_them(
    make_probe: Make, tmp_path: Path
) -> None:
    inputs = 'reference measurement command applied feed_forward'
    recorder = {'directory': str(tmp_path), 'inputs': inputs}
    joined = {'applied_timeout': 5.0, 'feed_forward_timeout': 5.0, 'rate': 50.0}
    parameters = wired(wiring_applied='drive std_msgs/Float64MultiArray data[1]', **joined)
    probe = make_probe(parameters={'controller': parameters, 'recorder': recorder})
    send = probe.node.create_publisher(JointState, 'joints', 10)
    report = probe.node.create_publisher(Float64MultiArray, 'drive', 10)
    feed = probe.publisher('feed_forward')
    node = probe.add(RecorderNode())
    controller = probe.add(ControllerNode())
    for publisher in (send, report, controller._command.publisher):
        probe.wait_until(lambda: publisher.get_subscription_count() > 0)  # noqa: B023
    probe.wait_until(lambda: report.get_subscription_count() > 1 and probe.readers('feed_forward'))
    begin = time.time_ns()
    for k in range(60):
        probe.wait_until(lambda: time.time_ns() > begin + k * PERIOD)  # noqa: B023
        report.publish(Float64MultiArray(data=[9.0, 0.5 * (k // 10)]))
        feed(0.1 * (k // 10))
        send.publish(joints(time.time_ns(), elbow=0.0))
    node.close()
    rows = read_samples(node.folder.path)
    there = [(a, f) for a, f in zip(rows['applied'], rows['feed_forward']) if a == a and f == f]
    assert len(there) > 30 and there[-1] == (2.5, 0.5)
    assert all(a == pytest.approx(5.0 * f) for a, f in there[-8:])


@pytest.mark.parametrize('best_effort', [False, True])
def test_a_recorder_records_the_numbers_that_the_controller_has_and_sends(
    make_probe: Make, tmp_path: Path, best_effort: bool
) -> None:
    recorder = {'directory': str(tmp_path), 'inputs': 'reference measurement command'}
    parameters = wired(
        rate=50.0,
        measurement_timeout=5.0,
        wiring_reference='goal sensor_msgs/JointState position[-1] * 2',
    )
    probe = make_probe(parameters={'controller': parameters, 'recorder': recorder})
    qos = qos_profile_sensor_data if best_effort else 10
    send = probe.node.create_publisher(JointState, 'joints', qos)
    aim = probe.node.create_publisher(JointState, 'goal', 10)
    heard = listen(probe, Float64MultiArray, 'efforts')
    node = probe.add(RecorderNode(parameters=recorder))
    controller = probe.add(ControllerNode())
    probe.wait_until(lambda: send.get_subscription_count() > 1)
    probe.wait_until(lambda: aim.get_subscription_count() > 1)
    probe.wait_until(lambda: controller._command.publisher.get_subscription_count() > 1)
    begin = time.time_ns()
    for k in range(60):
        probe.wait_until(lambda: time.time_ns() > begin + k * PERIOD)  # noqa: B023
        aim.publish(joints(0, ('a', 'b'), b=1.5))
        others = ('shoulder', 'wrist')
        if k % 3 == 2:  # somebody else tells the other joints
            send.publish(joints(begin + k * PERIOD, others))
        send.publish(joints(begin + k * PERIOD, (*others, 'elbow'), elbow=0.01 * k * k))
    probe.wait_until(lambda: len(heard) >= 60)
    probe.spin(0.7)
    node.close()
    rows = read_samples(node.folder.path)
    assert node.intake.losses['measurement'].newest > 60  # those of the others count as come
    assert node.intake.lost['measurement'] == 0
    commands = {message.data[1] for message in heard}
    measured = {0.01 * k * k for k in range(60)}
    assert len(rows['time']) >= 50
    assert set(rows['measurement']) <= measured
    assert set(rows['command']) <= commands
    assert rows['reference'][5:] == [3.0] * len(rows['reference'][5:])
    stamps = rows['measurement_stamp']
    periods = [(stamp - stamps[0]) / 0.02 for stamp in stamps]
    assert periods == pytest.approx([round(n) for n in periods], abs=1e-4)
