"""The command does not wait for those who read it, however slow they are."""

from __future__ import annotations

import resource
import time
from typing import Any

from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.topics import SEND, Sender
from probe import Probe, Processes
from rclpy.qos import ReliabilityPolicy

READERS = 8
# Eight participants that have reliable readers and never take a message.
SLOW = f"""
import sys, time
from nadrc_ros.ros.runtime import init_ros
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64
keep = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
nodes = []
for number in range({READERS}):
    init_ros([], context := Context())
    nodes.append(Node(f'slow_{{number}}', context=context))
    nodes[-1].create_subscription(Float64, sys.argv[1], print, keep)
while True:
    time.sleep(1.0)
"""


def waits(publish: Any, count: int = 400) -> float:
    """Return the share of publications that this thread waited in, for anything but the CPU."""
    waited = 0
    for number in range(count):
        before = resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw
        publish(float(number))
        waited += resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw > before
        time.sleep(0.002)
    return waited / count


def test_the_command_waits_for_no_slow_reader(probe: Probe, start: Processes) -> None:
    sender = Sender(probe.node, 'command')
    start.run('slow', '-c', SLOW, sender.topic)
    probe.wait_until(lambda: sender.publisher.get_subscription_count() == READERS)
    assert SEND.reliability == ReliabilityPolicy.RELIABLE
    assert waits(lambda value: time.sleep(1e-4), count=20) == 1.0
    assert waits(sender.send) < 0.05


def test_a_command_can_be_best_effort(probe: Probe) -> None:
    """Then nothing is kept, repeated or acknowledged for any reader."""
    topic = f'{probe.namespace}/command'
    name = f'qos_overrides.{topic}.publisher.reliability'
    probe.add(ControllerNode(parameters={name: 'best_effort', 'share_command': True}))
    (info,) = probe.node.get_publishers_info_by_topic(topic)
    assert info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
