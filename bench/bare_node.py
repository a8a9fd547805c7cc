"""The least that answers a measurement with a command: what ROS alone takes, in as many nodes."""

from __future__ import annotations

import sys

import rclpy
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import Float64

BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def executor() -> Executor:
    """Return the executor that the nodes of this package choose."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def echo(node: Node) -> None:
    """Answer each measurement at once with a command of the same value."""
    command = node.create_publisher(Float64, 'command', 1)
    node.create_subscription(Float64, 'measurement', command.publish, BEST_EFFORT)


def main() -> None:
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.ALL)
    node = rclpy.create_node('controller')
    echo(node)
    running = executor()
    running.add_node(node)
    try:
        while rclpy.ok():
            running.spin_until_future_complete(Future(), timeout_sec=60.0)
    except KeyboardInterrupt:
        pass


if __name__ == '__main__':
    main()
