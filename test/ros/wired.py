"""Wired controllers under test: their parameters, joints to feed them with, what they send."""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any

from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.topics import SEND
from probe import Probe
from sensor_msgs.msg import JointState

Make = Callable[..., Probe]
MS = 1_000_000
BEGIN = 1_700_000_000_000 * MS
# Nominally so slow that no tick comes but by a sample; the headers say how far apart these are.
LAW: dict[str, Any] = {
    'plant_order': 1,
    'b0': 1.0,
    'inner_bandwidth': 30.0,
    'good_samples': 1,
    'max_dt': 10.0,
    'measurement_timeout': 100.0,
}
CONTROL: dict[str, Any] = {'rate': 1.0, **LAW, 'trigger': 'measurement', 'share_command': True}
ELBOW = 'joints sensor_msgs/msg/JointState position[name=elbow]'
EFFORT = 'efforts std_msgs/msg/Float64MultiArray data[1]'


def wired(**more: Any) -> dict[str, Any]:
    """Return parameters of a controller of the elbow; ``wiring_x`` is for ``wiring.x``."""
    given = {'wiring_measurement': ELBOW, 'wiring_command': EFFORT, **more}
    return CONTROL | {name.replace('wiring_', 'wiring.'): v for name, v in given.items()}


def joints(stamp: int, order: tuple[str, ...] = ('shoulder', 'elbow'), **at: float) -> JointState:
    message = JointState(name=order, position=[at.get(name, 7.0) for name in order])
    message.velocity = [nan] * len(order)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1000 * MS)
    return message


class Feed:
    """Publishes messages on a topic, and waits until the controller has taken each."""

    def __init__(self, probe: Probe, node: Any, kind: Any = JointState, topic: str = 'joints'):
        self.probe, self.node = probe, node
        self.publisher = probe.node.create_publisher(kind, topic, SEND)
        probe.wait_until(self.publisher.get_subscription_count)

    def __call__(self, message: Any) -> None:
        """Send a message, or the bytes of one."""
        heard = self.node.inputs[0]
        before = heard.count + heard.absences
        self.publisher.publish(message)
        self.probe.wait_until(lambda: heard.count + heard.absences > before)


def listen(probe: Probe, kind: Any, topic: str) -> list[Any]:
    heard: list[Any] = []
    probe.node.create_subscription(kind, topic, heard.append, 100)
    return heard


def run(make: Make, parameters: dict[str, Any], **more: Any) -> tuple[Probe, ControllerNode]:
    probe = make(parameters={'controller': parameters}, **more)
    return probe, probe.add(ControllerNode())


def steps(node: ControllerNode) -> dict[str, int]:
    return {status.name.lower(): n for status, n in node.controller.counts.items() if n}
