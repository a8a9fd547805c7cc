"""The least that answers a measurement with a command: what ROS alone takes to start up."""

from __future__ import annotations

from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64


def main() -> None:
    rclpy.init()
    node = rclpy.create_node('controller')
    command = node.create_publisher(Float64, 'command', 1)
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_subscription(Float64, 'measurement', command.publish, best_effort)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == '__main__':
    main()
