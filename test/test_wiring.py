"""A number inside any message: its address, and reading it out of the serialised bytes."""

from __future__ import annotations

from math import cos, isnan, nan, pi, remainder, sin
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from nadrc_ros.wiring.address import AddressError, parse_address, parse_path, Step
from nadrc_ros.wiring.layout import layout_of, Malformed, Message
from nadrc_ros.wiring.listing import numbers_in
from nadrc_ros.wiring.reader import Reader
import pytest
from wiring_helpers import members_of, numbers, serialised, TYPES, values

LAYOUTS = {name: layout_of(name, members_of) for name in TYPES if name != 'std_msgs/WString'}
JOINTS = LAYOUTS['sensor_msgs/JointState']
EVERYTHING = LAYOUTS['own/Everything']
ORDERS = st.sampled_from('<>')
HEADER = {'stamp': {'sec': 3, 'nanosec': 5}, 'frame_id': 'base'}


def reader(text: str, kind: Message = JOINTS) -> Reader:
    address = parse_address(text if text.startswith('/') else f'/topic {text}')
    return Reader(address, kind.name, members_of)


def joints(order: str = '<', **positions: float) -> bytes:
    mapping = {'header': HEADER, 'name': list(positions), 'position': list(positions.values())}
    return serialised(JOINTS, mapping | {'velocity': [], 'effort': []}, order)


def test_an_address_is_parsed_into_its_parts_and_written_as_it_was() -> None:
    text = '/joint_states sensor_msgs/msg/JointState position[name=elbow] * -2 + 0.5'
    address = parse_address(text)
    assert (
        address.topic == '/joint_states' and address.message_type == 'sensor_msgs/msg/JointState'
    )
    assert address.path == (Step('position', key='name', value='elbow'),)
    assert (address.factor, address.offset) == (-2.0, 0.5)
    assert str(address) == text
    exact = 'imu angular_velocity.z * 0.0174532925199432957'
    assert parse_address(str(parse_address(exact))) == parse_address(exact)
    assert parse_address('imu sensor_msgs/Imu a.b[-1].c').message_type == 'sensor_msgs/msg/Imu'
    assert parse_path('a.b[-1].c') == (Step('a'), Step('b', -1), Step('c'))
    assert parse_address('~/own data').topic == '~/own'
    assert parse_address('imu a').message_type == ''


J = '/j sensor_msgs/JointState '
P = '/p geometry_msgs/Pose '
E = '/e own/Everything '
REFUSED = [
    ('', 'TOPIC [TYPE] FIELD'),
    ('/j', 'TOPIC [TYPE] FIELD'),
    ('/j sensor_msgs/JointState', 'no field of sensor_msgs/msg/JointState'),
    ('/j.position[1]', 'did you mean /j position[1]?'),
    ('/j! data', 'no name of a topic'),
    ('/j//k data', 'no name of a topic'),
    ('/j/ data', 'no name of a topic'),
    ('3j data', 'no name of a topic'),
    ('/j .x', '.x is no field'),
    ('/j x.', 'ends with a dot'),
    ('/j x..y', '.y is no field'),
    ('/j x[]', 'x[] is no field'),
    ('/j x[1.5]', 'is no field'),
    ('/j x[name]', 'is no field'),
    ('/j x[name=]', 'is no field'),
    ('/j x[1][2]', 'is no field'),
    ('/j x[1', 'is no field'),
    ('/j x-y', 'is no field'),
    ('/j x *', 'after * comes a finite number, not nothing'),
    ('/j x * two', 'not two'),
    ('/j x * inf', 'not inf'),
    ('/j x * 0', 'the factor is 0'),
    ('/j x + nan', 'after + comes a finite number'),
    ('/j x + 1 * 2', '* 2 is too much'),
    ('/j x / 2', '/ 2 is too much'),
    ('/j x 2', '2 is too much'),
    ('/j own/Unknown x', 'own/msg/Unknown is not known'),
    ('/j std_msgs/WString data', 'contains wide strings'),
    (J + 'positoin[0]', 'did you mean position?'),
    (J + 'position', 'say which element: [name=...], [0], [-1]'),
    (J + 'position[nam=elbow]', 'did you mean name?'),
    (J + 'header[0].frame_id', 'header is no array'),
    (J + 'header', 'name one of header.stamp'),
    (J + 'header.frame_id', 'is a string'),
    (J + 'name[0]', 'is a string'),
    (J + 'header.stamp.sec.x', 'is a number and has no members'),
    (J + 'header.stamp.norm', 'has no norm'),
    (P + 'orientation', 'orientation.roll'),
    (P + 'orientation.jaw', 'did you mean yaw?'),
    (P + 'orientation.yaw[0]', 'has no yaw'),
    (P + 'position.yaw', 'has no yaw'),
    (E + 'fixed[3]', 'fixed has 3 elements'),
    (E + 'fixed[-4]', 'fixed has 3 elements'),
    (E + 'fixed', 'say which element'),
    (E + 'poses[0]', 'that is a whole geometry_msgs/Pose'),
    (E + 'nothing', 'that is a whole std_msgs/Empty'),
]


@pytest.mark.parametrize(('text', 'why'), REFUSED, ids=[text or '(empty)' for text, _ in REFUSED])
def test_a_malformed_address_is_refused_with_what_there_is(text: str, why: str) -> None:
    with pytest.raises(AddressError) as caught:
        address = parse_address(text)
        Reader(address, address.message_type or 'sensor_msgs/JointState', members_of)
    assert why in str(caught.value)
    assert '\n' not in str(caught.value)


@given(data=st.data(), order=ORDERS)
def test_every_number_of_any_message_is_read_in_both_byte_orders(
    data: st.DataObject, order: str
) -> None:
    kind = LAYOUTS[data.draw(st.sampled_from(sorted(LAYOUTS)))]
    message = data.draw(values(kind))
    for field, number in numbers(kind, message):
        found = reader(field, kind)
        assert found.read(serialised(kind, message, order)) == number


@given(messages=st.lists(st.tuples(values(EVERYTHING), ORDERS), min_size=1, max_size=6))
def test_what_was_kept_of_one_message_never_misleads_in_the_next(
    messages: list[tuple[Any, str]],
) -> None:
    """The same reader on a stream of messages reads what a new one does in each."""
    for field in ('last', 'value[1]', 'value[-1]', 'value[name=elbow]', 'poses[0].orientation.w'):
        kept = reader(field, EVERYTHING)
        for message, order in messages:
            data = serialised(EVERYTHING, message, order)
            fresh = reader(field, EVERYTHING)
            expected = fresh.read(data)
            found = kept.read(data)
            assert found == expected or (isnan(found or 0.0) and isnan(expected or 0.0))
            assert kept.absent == fresh.absent


def test_an_element_is_found_by_its_name_wherever_it_moves() -> None:
    elbow = reader('position[name=elbow]')
    for _ in range(2):
        assert elbow.read(joints(shoulder=1.0, elbow=2.0)) == 2.0
        assert elbow.read(joints(elbow=3.0, shoulder=1.0)) == 3.0
        assert elbow.read(joints('>', elbow=4.0)) == 4.0


def test_who_is_not_there_is_no_sample_and_named() -> None:
    elbow = reader('position[name=elbow]')
    assert elbow.read(joints(shoulder=1.0, wrist=2.0)) is None
    assert str(elbow.absent) == 'elbow is not among shoulder, wrist'
    names: Any = {'\n': 1.0} | {f'joint_{k}' * 20: 1.0 for k in range(500)}
    many = joints(**names)
    assert elbow.read(many) is None and len(str(elbow.absent)) < 1500
    assert str(elbow.absent).endswith(' and 481 more') and '\n' not in str(elbow.absent)
    assert elbow.read(joints()) is None
    assert str(elbow.absent) == 'elbow is not among none'
    assert elbow.read(joints(elbow=1.0)) == 1.0
    assert elbow.absent is None


def test_an_array_that_is_shorter_than_its_names_is_a_bad_sample() -> None:
    short = {'header': HEADER, 'name': ['a', 'elbow'], 'position': [1.0]}
    data = serialised(JOINTS, short | {'velocity': [], 'effort': []})
    assert isnan(reader('position[name=elbow]').read(data) or 0.0)
    assert isnan(reader('velocity[0]').read(data) or 0.0)
    assert reader('position[name=a]').read(data) == 1.0


@given(data=st.binary(max_size=120), order=ORDERS, cut=st.integers(0, 120))
def test_p01_no_bytes_raise(data: bytes, order: str, cut: int) -> None:
    for field, kind in (
        ('position[name=elbow]', JOINTS),
        ('last', EVERYTHING),
        ('value[name=w]', EVERYTHING),
        ('orientation.yaw', LAYOUTS['geometry_msgs/Pose']),
    ):
        found = reader(field, kind)
        found.read(data)
        found.read(bytes((0, order == '<', 0, 0)) + data)
        whole = joints(order, elbow=2.0)
        found.read(whole[:cut])
        found.stamp(data)


def test_of_a_message_cut_short_nothing_is_read() -> None:
    whole = joints(shoulder=1.0, elbow=2.0)
    end = 4 + 8 + 4 + 5 + 3 + 4 + 4 + 9 + 3 + 4 + 6 + 2 + 4 + 16
    elbow = reader('position[name=elbow]')
    assert elbow.read(whole) == elbow.read(whole[:end]) == 2.0
    assert all(isnan(elbow.read(whole[:cut]) or 0.0) for cut in range(end))


def test_a_message_of_another_encoding_is_a_bad_sample() -> None:
    whole = joints(elbow=2.0)
    for encoding in ((0, 2), (0, 7), (1, 1)):
        assert isnan(reader('position[0]').read(bytes(encoding) + whole[2:]) or 0.0)


def pose(x: float, y: float, z: float, w: float) -> bytes:
    rotation = {'x': x, 'y': y, 'z': z, 'w': w}
    position = {'x': 1.0, 'y': 2.0, 'z': -2.0}
    kind = LAYOUTS['geometry_msgs/Pose']
    return serialised(kind, {'position': position, 'orientation': rotation})


@pytest.mark.parametrize(
    ('rotation', 'roll', 'pitch', 'yaw'),
    [
        ((0.0, 0.0, 0.0, 1.0), 0.0, 0.0, 0.0),
        ((0.0, 0.0, 0.6, 0.8), 0.0, 0.0, 1.2870022175865687),
        ((0.6, 0.0, 0.0, 0.8), 1.2870022175865687, 0.0, 0.0),
        ((0.0, 0.6, 0.0, 0.8), 0.0, 1.2870022175865687, 0.0),
        ((0.0, 0.0, -1.0, 0.0), 0.0, 0.0, pi),
        ((0.0, 0.5**0.5, 0.0, 0.5**0.5), 0.0, pi / 2, 0.0),
        ((0.0, 0.0, 0.66, 0.88), 0.0, 0.0, 1.2870022175865687),
        ((0.0, 0.0, 0.0, 0.0), nan, nan, nan),
        ((0.0, 0.0, 0.0, 1.2), nan, nan, nan),
        ((nan, 0.0, 0.0, 1.0), nan, nan, nan),
    ],
)
def test_angles_are_computed_of_rotations_alone(
    rotation: tuple[float, float, float, float], roll: float, pitch: float, yaw: float
) -> None:
    kind = LAYOUTS['geometry_msgs/Pose']
    for name, expected in (('roll', roll), ('pitch', pitch), ('yaw', yaw)):
        found = reader(f'orientation.{name}', kind).read(pose(*rotation))
        if not (name != 'pitch' and abs(pitch - pi / 2) < 1e-9):  # roll and yaw are one there
            assert found == pytest.approx(expected, abs=1e-12, nan_ok=True)
    assert reader('position.norm', kind).read(pose(*rotation)) == 3.0
    assert reader('position.norm * -2 + 1', kind).read(pose(*rotation)) == -5.0


def test_the_yaw_of_ten_turns_is_above_minus_pi_and_at_most_pi() -> None:
    yaw = reader('orientation.yaw', LAYOUTS['geometry_msgs/Pose'])
    for k in range(-360, 361):
        angle = 2.0 * pi * k / 36.0
        found = yaw.read(pose(0.0, 0.0, sin(0.5 * angle), cos(0.5 * angle)))
        assert found is not None and -pi < found <= pi
        assert remainder(found - angle, 2.0 * pi) == pytest.approx(0.0, abs=1e-9)


def test_the_stamp_of_a_header_is_told_where_there_is_one_that_is_set() -> None:
    for order in '<>':
        assert reader('position[0]').stamp(joints(order, a=1.0)) == 3_000_000_005
    odd = {'stamp': {'sec': 2**31 - 1, 'nanosec': 2**32 - 1}, 'frame_id': ''}
    filled: dict[str, Any] = {key: [] for key in JOINTS.members if key != 'header'}
    assert reader('position[0]').stamp(serialised(JOINTS, filled | {'header': odd})) is None
    unset = {'stamp': {'sec': 0, 'nanosec': 0}, 'frame_id': ''}
    empty: dict[str, Any] = {key: [] for key in JOINTS.members if key != 'header'}
    assert reader('position[0]').stamp(serialised(JOINTS, empty | {'header': unset})) is None
    assert reader('last', EVERYTHING).stamp(joints(a=1.0)) is None


def test_numbers_are_listed_as_addresses_that_read_them() -> None:
    data = joints(shoulder=1.0, elbow=2.0)
    listed = dict(numbers_in(data, JOINTS.name, members_of))
    assert listed == {
        'header.stamp.sec': 3.0,
        'header.stamp.nanosec': 5.0,
        'position[name=shoulder]': 1.0,
        'position[name=elbow]': 2.0,
    }
    listed = dict(numbers_in(pose(0.0, 0.0, 0.6, 0.8), 'geometry_msgs/Pose', members_of))
    assert listed['position.norm'] == 3.0
    assert listed['orientation.yaw'] == pytest.approx(1.287, abs=1e-3)
    for cut in range(20):
        with pytest.raises(Malformed):
            list(numbers_in(data[:cut], JOINTS.name, members_of))


@given(message=values(EVERYTHING), order=ORDERS)
def test_the_list_is_whole(message: Any, order: str) -> None:
    listed = dict(numbers_in(serialised(EVERYTHING, message, order), EVERYTHING.name, members_of))
    plain = {field: number for field, number in numbers(EVERYTHING, message) if '[' not in field}
    assert plain.items() <= listed.items()
    assert len([f for f in listed if f.startswith('value[')]) <= len(message['value'])
