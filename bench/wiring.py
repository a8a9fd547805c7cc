"""
What a sample costs that is a field of a message, over one that is a Float64.

    python -m bench.wiring

In turns, of which the quickest counts: the path of a sample from its bytes to the callback of a
node, with its time; beside it rclpy's own deserialiser for the same bytes. Then messages that a
publisher sends to a subscription of the same process, from ``publish`` to the callback, with all
that the middleware does, which grows with their size.

Keys: ``wiring.<message>.take_us``, ``.deserialise_us``, ``.whole_us``; the first and the last also
over those of Float64, ``added_us`` and ``added_whole_us``.
"""

from __future__ import annotations

from statistics import median
from time import perf_counter_ns
from typing import Any

from bench.results import save, show
from geometry_msgs.msg import Quaternion
from nadrc_ros.ros.runtime import init_ros, private_domain
from nadrc_ros.ros.topics import Input, LATEST, receive, SEND
from nadrc_ros.ros.versions import make_executor, spin_for
from nadrc_ros.ros.wires import make_wire
from nadrc_ros.wiring.address import parse_address
from nav_msgs.msg import Odometry
import rclpy
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.task import Future
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64

TURNS, CALLS = 40, 500
MESSAGES = 2000
INFO = {'source_timestamp': 1, 'received_timestamp': 2, 'publication_sequence_number': 3}


def messages() -> dict[str, tuple[Any, str]]:
    """Return a message of each kind, and the field that is read of it, none for plain Float64."""
    names = [f'joint_{k}' for k in range(7)]
    joints = JointState(name=names, position=[0.1] * 7, velocity=[0.2] * 7, effort=[0.0] * 7)
    odometry = Odometry(child_frame_id='base_link')
    odometry.pose.pose.orientation = Quaternion(z=0.6, w=0.8)
    imu = Imu()
    for stamped in (joints, odometry, imu):
        stamped.header.stamp.sec = 1
        stamped.header.frame_id = 'odom'
    return {
        'Float64': (Float64(data=0.1), ''),
        'Float64, wired': (Float64(data=0.1), 'data'),
        'JointState of 7': (joints, 'position[name=joint_5]'),
        'Odometry, yaw': (odometry, 'pose.pose.orientation.yaw'),
        'Imu': (imu, 'angular_velocity.z'),
    }


class Subject:
    """One kind of message, and how a node takes it."""

    def __init__(self, node: Node, index: int, message: Any, field: str) -> None:
        self.kind = type(message)
        self.data = bytes(serialize_message(message))
        self._heard = Future()
        self.topic = f'bench_{index}'
        package = self.kind.__module__.split('.')[0]
        address = parse_address(f'{self.topic} {package}/{self.kind.__name__} {field or "data"}')
        wire = make_wire(node, 'measurement', address, 'header', 0.0) if field else None

        def join(_: Input, take: Any, subscribe: Any) -> Any:
            self.take = take
            return subscribe(take)

        receive(node, self.topic, self._hear, LATEST, fixed=True, wire=wire, join=join)
        self.publisher = node.create_publisher(self.kind, self.topic, SEND)

    def _hear(self, value: float, info: Any) -> None:
        self._heard.set_result(None)

    def taking(self) -> float:
        """Return the time from the bytes to the callback [us]."""
        take, data = self.take, self.data
        begin = perf_counter_ns()
        for _ in range(CALLS):
            take(data, INFO)
        return (perf_counter_ns() - begin) * 1e-3 / CALLS

    def deserialising(self) -> float:
        """Return the time of rclpy for a message of these bytes [us]."""
        begin = perf_counter_ns()
        for _ in range(CALLS):
            deserialize_message(self.data, self.kind)
        return (perf_counter_ns() - begin) * 1e-3 / CALLS

    def sending(self, executor: Executor) -> float:
        """Return the time from ``publish`` to the callback [us]."""
        self._heard = Future()
        begin = perf_counter_ns()
        self.publisher.publish(self.data)
        spin_for(executor, 0.05, self._heard)
        return (perf_counter_ns() - begin) * 1e-3


def main() -> None:
    """Run the bench."""
    private_domain()
    init_ros()
    node, executor = Node('bench_wiring'), make_executor()
    executor.add_node(node)
    subjects = {name: Subject(node, k, *each) for k, (name, each) in enumerate(messages().items())}
    spin_for(executor, 1.0)
    samples: dict[str, list[float]] = {}
    for _ in range(TURNS):
        for name, subject in subjects.items():
            samples.setdefault(f'{name}.take_us', []).append(subject.taking())
            samples.setdefault(f'{name}.deserialise_us', []).append(subject.deserialising())
    for _ in range(MESSAGES):
        for name, subject in subjects.items():
            samples.setdefault(f'{name}.whole_us', []).append(subject.sending(executor))
    rows = {
        name: {
            'take_us': min(samples[f'{name}.take_us']),
            'deserialise_us': min(samples[f'{name}.deserialise_us']),
            'whole_us': median(samples[f'{name}.whole_us']),
        }
        for name in subjects
    }
    for row in rows.values():
        row['added_us'] = row['take_us'] - rows['Float64']['take_us']
        row['added_whole_us'] = row['whole_us'] - rows['Float64']['whole_us']
    show('A sample out of a message [us]', rows, 'take: from its bytes to the callback.')
    figures = {f'{name}.{key}': value for name, row in rows.items() for key, value in row.items()}
    save('wiring', figures, samples)
    rclpy.shutdown()


if __name__ == '__main__':
    main()
