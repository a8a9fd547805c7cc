"""Message types as plain tables, random messages of them, and their bytes in both byte orders."""

from __future__ import annotations

from collections.abc import Iterator
from struct import pack
from typing import Any

from hypothesis import strategies as st
from nadrc_ros.wiring.layout import Array, Message, Number, String, Type

TYPES: dict[str, dict[str, str]] = {
    'builtin_interfaces/Time': {'sec': 'int32', 'nanosec': 'uint32'},
    'std_msgs/Header': {'stamp': 'builtin_interfaces/Time', 'frame_id': 'string'},
    'std_msgs/Float64': {'data': 'double'},
    'std_msgs/Empty': {},
    'std_msgs/WString': {'data': 'wstring'},
    'sensor_msgs/JointState': {
        'header': 'std_msgs/Header',
        'name': 'sequence<string>',
        **dict.fromkeys(('position', 'velocity', 'effort'), 'sequence<double>'),
    },
    'geometry_msgs/Point': dict.fromkeys('xyz', 'double'),
    'geometry_msgs/Quaternion': dict.fromkeys('xyzw', 'double'),
    'geometry_msgs/Pose': {
        'position': 'geometry_msgs/Point',
        'orientation': 'geometry_msgs/Quaternion',
    },
    # Everything that a type may have, in an order that needs padding, names behind the values.
    'own/Everything': {
        'flag': 'boolean',
        'wide': 'int64',
        'small': 'uint8',
        'nothing': 'std_msgs/Empty',
        'short': 'int16',
        'single': 'float',
        'label': 'string<9>',
        'fixed': 'double[3]',
        'value': 'sequence<float, 9>',
        'poses': 'sequence<geometry_msgs/Pose>',
        'odd': 'uint8[3]',
        'name': 'sequence<string<5>>',
        'last': 'double',
    },
}
NAMES = ('elbow', 'wrist', 'w', '')


def members_of(name: str) -> dict[str, str]:
    """Return the members of a type of the table."""
    return TYPES[name]


def values(kind: Type) -> st.SearchStrategy[Any]:
    """Return random values of a type: numbers, text, lists, dictionaries."""
    if isinstance(kind, Number):
        if kind.code in 'fd':
            return st.floats(width=32 if kind.code == 'f' else 64, allow_nan=False)
        if kind.code == '?':
            return st.booleans()
        bits = 8 * kind.size
        low = 0 if kind.code.isupper() else -(2 ** (bits - 1))
        return st.integers(low, low + 2**bits - 1)
    if isinstance(kind, String):
        return st.sampled_from(NAMES)
    if isinstance(kind, Array):
        least, most = (0, 3) if kind.count is None else (kind.count, kind.count)
        return st.lists(values(kind.element), min_size=least, max_size=most)
    return st.fixed_dictionaries({name: values(inner) for name, inner in kind.members.items()})


def serialised(kind: Message, value: Any, order: str = '<') -> bytes:
    """Return a message as it travels."""
    out = bytearray()
    _write(kind, value, order, out)
    return bytes((0, order == '<', 0, 0)) + bytes(out)


def _write(kind: Type, value: Any, order: str, out: bytearray) -> None:
    if isinstance(kind, Number):
        out += b'\xaa' * (-len(out) % kind.size)  # padding may be anything
        out += pack(order + kind.code, value)
    elif isinstance(kind, String):
        text = value.encode() + b'\0'
        _write(Number('I'), len(text), order, out)
        out += text
    elif isinstance(kind, Array):
        if kind.count is None:
            _write(Number('I'), len(value), order, out)
        for element in value:
            _write(kind.element, element, order, out)
    else:
        if not kind.members:
            out += b'\0'
        for name, inner in kind.members.items():
            _write(inner, value[name], order, out)


def numbers(kind: Type, value: Any, field: str = '') -> Iterator[tuple[str, float]]:
    """Yield the field of every number in a message, by index, and the number."""
    if isinstance(kind, Number):
        yield field, float(value)
    elif isinstance(kind, Array):
        for i, element in enumerate(value):
            yield from numbers(kind.element, element, f'{field}[{i}]')
    elif isinstance(kind, Message):
        for name, inner in kind.members.items():
            yield from numbers(inner, value[name], f'{field}.{name}' if field else name)
