"""
The least that answers measurements with commands: what ROS alone takes.

    python -m bench.bare_node [AXIS ...]

One node that echoes each measurement at once; or one for each axis, all of them on one timer, each
in the namespace of its axis.
"""

from __future__ import annotations

from collections.abc import Callable
import signal
import sys

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import Float64

RATE = 100.0
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


def hold(node: Node) -> Callable[[], None]:
    """Return what sends the last measurement as the command."""
    command = node.create_publisher(Float64, 'command', 1)
    last = [Float64()]

    def take(message: Float64) -> None:
        last[0] = message

    node.create_subscription(Float64, 'measurement', take, BEST_EFFORT)
    return lambda: command.publish(last[0])


def loop(nodes: list[Node]) -> None:
    """Send for all nodes on one timer."""
    sends = [hold(node) for node in nodes]

    def tick() -> None:
        for send in sends:
            send()

    nodes[0].create_timer(1.0 / RATE, tick, clock=Clock(clock_type=ClockType.STEADY_TIME))


def main() -> None:
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    axes = rclpy.utilities.remove_ros_args(sys.argv)[1:]
    nodes = [Node('controller', namespace=axis) for axis in axes] or [Node('controller')]
    if axes:
        loop(nodes)
    else:
        echo(nodes[0])
    running = executor()
    for node in nodes:
        running.add_node(node)
    stopped = Future()
    signal.signal(signal.SIGINT, lambda *_: stopped.set_result(None))
    while not stopped.done():
        running.spin_until_future_complete(stopped, timeout_sec=0.5)
    # One that goes without a word is remembered for 20 s, and in the way of those that come.
    running.shutdown(timeout_sec=0.0)
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
