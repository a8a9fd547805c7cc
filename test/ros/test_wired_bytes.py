"""Numbers out of bytes: what rclpy's own deserialiser gives, and nothing of what is no message."""

from __future__ import annotations

from math import inf, isfinite, isnan, nan
import random
import struct
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from nadrc_ros.adrc.status import Status
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.exchange import Exchange
from nadrc_ros.ros.wires import make_wire, members_of, message_class
from nadrc_ros.wiring.address import parse_address
from nadrc_ros.wiring.layout import layout_of
from nadrc_ros.wiring.reader import Reader
from probe import Probe
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from wired import Make, wired
from wiring_helpers import numbers, serialised, values

TYPES = [
    'sensor_msgs/JointState',
    'sensor_msgs/Imu',
    'sensor_msgs/Range',
    'sensor_msgs/BatteryState',
    'sensor_msgs/PointCloud2',
    'nav_msgs/Odometry',
    'geometry_msgs/TwistStamped',
    'trajectory_msgs/JointTrajectory',
    'std_msgs/Float64MultiArray',
    'std_msgs/UInt8MultiArray',
    'diagnostic_msgs/DiagnosticArray',
    'rcl_interfaces/ParameterEvent',
]


def number_at(message: Any, field: str) -> float:
    """Return the number at a field by index, as Python has it."""
    for part in field.replace('[', '.[').split('.'):
        message = message[int(part[1:-1])] if part[0] == '[' else getattr(message, part)
    return float(message[0] if isinstance(message, bytes) else message)


@pytest.mark.parametrize('name', TYPES)
@settings(max_examples=25)
@given(data=st.data(), order=st.sampled_from('<>'))
def test_the_plan_gives_what_the_deserialiser_gives(
    name: str, data: st.DataObject, order: str
) -> None:
    kind = layout_of(name, members_of)
    value = data.draw(values(kind))
    raw = serialised(kind, value, order)
    message = deserialize_message(raw, message_class(name))
    again = serialize_message(message)
    for field, number in numbers(kind, value):
        if not field.startswith('[') and '.[' not in field:
            reader = Reader(parse_address(f'/t {field}'), name, members_of)
            assert reader.read(raw) == number_at(message, field) == number
            assert reader.read(again) == number


FIELDS = [
    'sensor_msgs/JointState position[name=elbow]',
    'nav_msgs/Odometry pose.pose.orientation.yaw',
    'sensor_msgs/Imu angular_velocity.z',
    'sensor_msgs/Range range',
    'std_msgs/Float64MultiArray data[1]',
]


@pytest.mark.parametrize('field', FIELDS)
def test_p24_what_is_no_message_is_counted_and_leaves_the_state_to_the_bit(
    field: str, make_probe: Make
) -> None:
    """4,000 byte strings of each of five types, random, truncated and with a bit turned."""
    probe = make_probe(parameters={'controller': wired(wiring_measurement=f'y {field}')})
    node = probe.add(ControllerNode())
    ((_, takers),) = node._wiring.exchange._takers.values()
    name = field.split()[0]
    kind, dice = layout_of(name, members_of), random.Random(4)
    filled = {'name': ['shoulder', 'elbow'], 'position': [1.0, 2.0], 'data': [1.0, 2.0]}
    message = message_class(name)(
        **{key: value for key, value in filled.items() if key in kind.members}
    )
    whole = bytes(serialize_message(message))
    fresh = Reader(parse_address(f'/t {field}'), name, members_of)
    taken = refused = absent = 0
    for k in range(4000):
        data = bytearray(whole)
        if k % 3 == 0:
            del data[dice.randrange(len(data)) :]
        elif k % 3 == 1:
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
        else:
            data[4:] = dice.randbytes(dice.randrange(len(whole)))
        number = fresh.read(bytes(data))
        state = node.controller.state
        before = bits(state)
        info = {'source_timestamp': 10**18 + k * 10**7, 'received_timestamp': 10**18 + k * 10**7}
        takers[0](bytes(data), info | {'publication_sequence_number': k + 1})
        if number is None or isnan(number):
            assert bits(node.controller.state) == before
        absent += number is None
        refused += number is not None and isnan(number)
        taken += number is not None and not isnan(number)
    counts = node.controller.counts
    used = sum(n for status, n in counts.items() if status < Status.NO_MEASUREMENT)
    assert node.inputs[0].absences == absent
    assert sum(counts.values()) == 4000 - absent
    assert counts[Status.NO_MEASUREMENT] >= refused > 0
    assert used <= taken


def bits(state: Any) -> bytes:
    flat = [x for level in state.levels for x in level]
    return struct.pack(f'{len(flat)}d', *flat)


OUT = [
    *('Float32 data', 'Int8 data', 'UInt16 data', 'Int64 data', 'UInt64 data', 'Bool data'),
    *('Byte data', 'Char data', 'Int16MultiArray data[2]', 'ByteMultiArray data[1]'),
    *('Float32MultiArray data[1]', 'Float64MultiArray data[1]'),
]
VALUES = (0.0, -0.0, 1.0, 127.5, -1e19, 1e19, 2.0**63, 5e-324, 1e308, -1e308, inf, -inf, nan)


@pytest.mark.parametrize('scale', ['', ' * -1e-300', ' * 3 + 1e308'])
@pytest.mark.parametrize('field', OUT)
def test_p02_p03_whatever_is_sent_the_number_in_the_message_is_one_of_its_type(
    field: str, scale: str, probe: Probe
) -> None:
    address = parse_address(f'out std_msgs/{field}{scale}')
    wire = make_wire(probe.node, 'command', address, 'header', 0.0)
    sender: Any = Exchange().sender(probe.node, wire, 0.0, '', 1.0)
    plain = Reader(parse_address(f'out {field.split()[1]}'), address.message_type, members_of)
    for value in VALUES:
        before = bytes(sender._message._data)
        sender.send(value)
        data = bytes(sender._message._data)
        deserialize_message(data, wire.kind)
        number = plain.read(data)
        assert number is not None and isfinite(number)
        if isnan(value):
            assert data == before
        elif not scale and abs(value) < 100.0:
            assert abs(number - value) <= 0.5
