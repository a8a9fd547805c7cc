"""When samples of wired signals were taken: by headers, by the source, by receipt."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
import random
import time
from typing import Any

from geometry_msgs.msg import TwistStamped
from nadrc_ros.nodes.controller import ControllerNode
import pytest
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from wired import (
    BEGIN,
    Feed,
    joints,
    listen,
    Make,
    MS,
    run,
    wired,
)


def commands_of(make: Make, late: Callable[[int], int], **parameters: Any) -> list[float]:
    """Return the commands for 60 samples, the k-th of which is sent ``late(k)`` periods later."""
    probe, node = run(make, wired(**parameters))
    heard = listen(probe, Float64MultiArray, 'efforts')
    feed = Feed(probe, node)
    probe.wait_until(lambda: node._command.has_readers)
    for k in range(60):
        probe.spin(0.01 * late(k))
        feed(joints(BEGIN + 10 * k * MS, elbow=0.01 * k))
        probe.wait_until(lambda: len(heard) > k)  # noqa: B023
    probe.close()
    return [message.data[1] for message in heard]


def test_p09_what_transport_delays_changes_no_command(make_probe: Make) -> None:
    dice = random.Random(2)
    delays = [dice.randint(1, 3) if dice.random() < 0.3 else 0 for _ in range(60)]
    assert commands_of(make_probe, lambda k: 0) == commands_of(make_probe, delays.__getitem__)


def test_p09_an_older_or_equal_header_is_no_new_sample(make_probe: Make) -> None:
    probe, node = run(make_probe, wired(rate=100.0))
    feed = Feed(probe, node)
    spans = []
    for at in (0, 10, 10, 30, 20, 40, -500, -490):
        feed(joints(BEGIN + at * MS, elbow=1.0))
        spans.append(round(node._times.spacing, 3))
    assert node._times.out_of_order == 2
    assert spans[:6] == [0.0, 0.01, 0.01, 0.02, 0.02, 0.01]
    assert node._times.clock_jumps >= 1  # half a second back is another clock
    assert spans[7] == 0.01


@pytest.mark.parametrize(('stamp', 'told'), [('header', True), ('source', False)])
def test_a_header_that_is_not_stamped_is_told_once(
    make_probe: Make, stamp: str, told: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    probe, node = run(make_probe, wired(wiring_stamp=stamp))
    feed = Feed(probe, node)
    for _ in range(5):
        feed(joints(0, elbow=1.0))
    probe.wait_until(lambda: len(probe.said()) > 2)
    said = ''
    probe.wait_until(lambda: len(probe.said()) > 3)
    said += capfd.readouterr().err
    assert said.count('has no stamp') == told
    assert node._times.out_of_order == 0 and node._times.spacing > 0.0


def test_a_clock_ahead_of_ours_is_told_and_receipts_are_taken(make_probe: Make) -> None:
    probe, node = run(make_probe, wired(rate=100.0))
    feed = Feed(probe, node)

    def told() -> bool:
        feed(joints(time.time_ns() + 1000 * MS, elbow=1.0))
        return any('a clock that is ahead of ours' in said[1] for said in probe.said())

    probe.wait_until(told)
    assert node._times.from_future > 3
    assert 0.0 < node._times.spacing < 1.0


def test_by_receipt_a_header_counts_for_nothing(make_probe: Make) -> None:
    probe, node = run(make_probe, wired(wiring_stamp='receipt'))
    feed = Feed(probe, node)
    feed(joints(BEGIN, elbow=1.0))
    begin = time.monotonic()
    probe.spin(0.2)
    feed(joints(BEGIN + MS, elbow=1.0))
    assert 0.2 <= node._times.spacing <= time.monotonic() - begin + 0.1


def test_with_headers_the_law_sees_simulated_time(make_probe: Make) -> None:
    parameters = {'controller': wired(use_sim_time=True)}
    probe = make_probe(parameters=parameters)
    clock = probe.node.create_publisher(Clock, '/clock', 10)
    node = probe.add(ControllerNode())
    feed = Feed(probe, node)
    for k in range(4):
        now = 5000 + 20 * k
        clock.publish(Clock(clock=joints(now * MS).header.stamp))
        probe.wait_until(lambda: node.get_clock().now().nanoseconds == now * MS)  # noqa: B023
        feed(joints((now - 3) * MS, elbow=1.0))
    assert node._times.spacing == pytest.approx(0.02)
    assert node._times.clock_jumps == node._times.from_future == 0
    assert 0.002 < node.latencies.summary()['latency_median_ms'] < 4.0


def test_p24_no_time_in_a_header_ends_a_node_that_sends_it_back(make_probe: Make) -> None:
    command = 'cmd_vel geometry_msgs/TwistStamped twist.angular.z'
    probe, node = run(make_probe, wired(wiring_command=command, rate=100.0))
    heard = listen(probe, TwistStamped, 'cmd_vel')
    feed = Feed(probe, node)
    extremes = (-(2**31), 2**31 - 1, 0, 1), (0, 1, 999_999_999, 10**9, 2**32 - 1)
    for sec, nanosec in product(*extremes):
        message = joints(0, elbow=1.0)
        message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
        feed(message)
    for k in range(5):
        feed(joints(time.time_ns(), elbow=1.0 + 0.1 * k))
        probe.spin(0.01)
    assert 0.0 < node._times.spacing < 1.0
    assert heard and not node.failure
