"""What happened to a node, told when it happens, for whoever records it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nadrc_ros.ros.diagnostics import OK
from nadrc_ros.ros.topics import Info, with_info
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

PROFILE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
# Name of the node, kind of the event, what it says, and the info of the message.
Take = Callable[[str, str, str, Info], None]


class Events:
    """
    Publishes the events of a node on ``~/event``, each in a message of its own.

    A message has the stamp of the node's clock and one status: the name of the node, the event in
    words, and its ``kind`` among the values. Every change is told, where the log leaves some out.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, '~/event', PROFILE)

    def tell(self, kind: str, message: str, level: bytes = OK) -> None:
        """Publish an event that happens now."""
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            message=message,
            hardware_id='nadrc_ros',
            values=[KeyValue(key='kind', value=kind)],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


def receive_events(node: Node, source: str, take: Take) -> None:
    """Subscribe to the events of the node ``source``."""
    node.create_subscription(
        DiagnosticArray, f'{source}/event', with_info(partial(_pass_on, take)), PROFILE
    )


def _pass_on(take: Take, array: DiagnosticArray, info: Info) -> None:
    for status in array.status:
        kinds = [pair.value for pair in status.values if pair.key == 'kind']
        take(status.name, kinds[0] if kinds else '', status.message, info)
