"""
Reading one number out of serialised messages, without making a message of them.

The way to the number is walked once, and what it depended on is kept: lengths, and the names among
which one was looked up. A message in which these are the same has its number at the same place, so
that most messages cost two reads; any other is walked. A few ways are kept, as publishers that
tell parts of a machine take turns on one topic.
"""

from __future__ import annotations

from collections.abc import Callable
from math import asin, atan2, copysign, hypot, nan, pi
from struct import Struct
from typing import NamedTuple

from nadrc_ros.adrc.errors import did_you_mean
from nadrc_ros.wiring.address import Address, AddressError, Step
from nadrc_ros.wiring.layout import (
    Array,
    HEADER,
    layout_of,
    Malformed,
    MembersOf,
    Message,
    Number,
    ORDERS,
    Type,
    Unsupported,
    Walk,
)

# How far the norm of a quaternion may be from 1.
ROTATION = 0.9, 1.1
_SECOND = 1_000_000_000
_STAMP = {'>': Struct('>iI'), '<': Struct('<iI')}


def _roll(x: float, y: float, z: float, w: float) -> float:
    return _upper(atan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z))


def _pitch(x: float, y: float, z: float, w: float) -> float:
    sine = 2.0 * (w * y - z * x) / (w * w + x * x + y * y + z * z)
    return asin(sine) if abs(sine) < 1.0 else copysign(0.5 * pi, sine)


def _yaw(x: float, y: float, z: float, w: float) -> float:
    return _upper(atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z))


def _upper(angle: float) -> float:
    return pi if angle == -pi else angle


# Pseudo-fields: of a quaternion its angles (roll about x, then pitch about y, then yaw about z,
# all about fixed axes, REP 103), of a vector its length.
ANGLES: dict[str, Callable[..., float]] = {'roll': _roll, 'pitch': _pitch, 'yaw': _yaw}
QUATERNION = ['x', 'y', 'z', 'w']
_KEPT = 4
# Anybody may send names: so many of them are shown, and so much of each.
_SHOWN, _LONGEST = 20, 60


class Absent(NamedTuple):
    """No element of that name is in a message."""

    wanted: str
    there: tuple[str, ...]

    def __str__(self) -> str:
        shown = [name if name.isprintable() else repr(name) for name in self.there[:_SHOWN]]
        more = len(self.there) - len(shown)
        names = ', '.join(name[:_LONGEST] for name in shown) + (
            f' and {more} more' if more else ''
        )
        return f'{self.wanted} is not among {names or "none"}'


class Way(NamedTuple):
    """
    Where the number is in messages in which ``known`` unpacks to ``expected``.

    ``size`` is the least length of these, ``number`` is how the number at ``at`` is packed, and
    ``absent`` what is not there, instead.
    """

    size: int
    known: Struct
    expected: tuple[object, ...]
    at: int
    number: Struct
    absent: Absent | None


class Reader:
    """
    Reads the number at an address out of messages of one type.

    Parameters
    ----------
    address
        Where it is.
    message_type
        Of the messages, ``package/msg/Name``.
    members_of
        What tells the members of types.

    Attributes
    ----------
    absent
        What the last message did not have, None if it had the number.
    layout
        Of the messages.
    has_header
        Whether the messages begin with a stamped header.

    Raises
    ------
    AddressError
        When there is no number at the address: it says what there is.

    """

    def __init__(self, address: Address, message_type: str, members_of: MembersOf) -> None:
        self.address = address
        try:
            self.layout = layout_of(message_type, members_of)
        except LookupError:
            raise AddressError(address, f'the message type {message_type} is not known') from None
        except Unsupported as error:
            raise AddressError(address, f'{message_type} contains {error}') from None
        self._factor, self._offset = address.factor, address.offset
        # A number that is not scaled stays what it is: -0.0 + 0.0 is 0.0.
        self._scaled = (address.factor, address.offset) != (1.0, 0.0)
        self._path, self._leaf, self._of = _resolve(address, self.layout)
        first = next(iter(self.layout.members.items()), ('', None))
        self.has_header = (
            first[0] == 'header'
            and isinstance(first[1], Message)
            and first[1].name == 'std_msgs/Header'
        )
        self.absent: Absent | None = None
        self._ways: list[Way] = []

    def read(self, data: bytes) -> float | None:
        """
        Return the number in a message; nan where it is damaged, None where it is not there.

        Nothing is raised: see :attr:`absent` for what was missing.
        """
        for way in self._ways:
            if len(data) >= way.size and way.known.unpack_from(data) == way.expected:
                break
        else:
            try:
                way = self._locate(data)
            except Malformed:
                self.absent = None
                return nan
            self._ways = [way, *self._ways[: _KEPT - 1]]
        self.absent = way.absent
        if way.absent is not None:
            return None
        values = way.number.unpack_from(data, way.at)
        value = float(values[0]) if self._of is None else self._of(*values)
        return self._factor * value + self._offset if self._scaled else value

    def place(self, data: bytes) -> tuple[int, Struct]:
        """
        Return where in a message the number is, and how it is packed.

        Raises
        ------
        AddressError
            When this message has no such number, or the address is of a computed one.

        """
        if self._of is not None:
            raise AddressError(self.address, 'that is computed, and cannot be written')
        try:
            way = self._locate(data)
        except Malformed:
            raise AddressError(self.address, 'there is no such element') from None
        if way.absent is not None:
            raise AddressError(self.address, str(way.absent))
        return way.at, way.number

    def stamp(self, data: bytes) -> int | None:
        """Return the time in the header [ns], None where it has none, or one that is no time."""
        if not self.has_header or len(data) < HEADER + 8 or data[1] not in ORDERS:
            return None
        seconds, nanoseconds = _STAMP[ORDERS[data[1]]].unpack_from(data, HEADER)
        if nanoseconds >= _SECOND:
            return None
        return (seconds * _SECOND + nanoseconds) or None

    @staticmethod
    def put_stamp(data: bytearray, stamp: int) -> None:
        """Write a time [ns] into the header that a message begins with."""
        _STAMP[ORDERS[data[1]]].pack_into(data, HEADER, *divmod(stamp, _SECOND))

    def _locate(self, data: bytes) -> Way:
        """Find where the number is, and what that depends on."""
        walk = Walk.over_message(data)
        kind: Type = self.layout
        for step in self._path:
            assert isinstance(kind, Message)
            absent = self._descend(walk, kind, step)
            if absent is not None:
                return _way(walk, 0, Struct(''), absent)
            kind = kind.members[step.member]
            if isinstance(kind, Array):
                kind = kind.element
        code, count = self._leaf
        number = Struct(f'{walk.order}{count}{code}')
        return _way(walk, HEADER + walk.to(number.size // count, count), number, None)

    def _descend(self, walk: Walk, message: Message, step: Step) -> Absent | None:
        """Go to the member that a step names; return what is not there, if it is not."""
        names: list[str] | None = None
        for member, kind in message.members.items():
            if member == step.member:
                break
            if member == step.key:
                assert isinstance(kind, Array)
                names = walk.strings(walk.count(kind))
            else:
                walk.over(kind)
        if not isinstance(kind, Array):
            return None
        count, begin = walk.count(kind), walk.at
        index = step.index
        if step.key:
            if names is None:
                names = self._names_behind(walk, message, step, kind, count)
                walk.at = begin
            if step.value not in names:
                return Absent(step.value, tuple(names))
            index = names.index(step.value)
        assert index is not None
        if index < 0:
            index += count
        if not 0 <= index < count:
            raise Malformed
        walk.over_elements(kind.element, index)
        return None

    def _names_behind(
        self, walk: Walk, message: Message, step: Step, kind: Array, count: int
    ) -> list[str]:
        """Return the names in an array that comes after the one in question."""
        walk.over_elements(kind.element, count)
        members = iter(message.members.items())
        for member, _ in members:
            if member == step.member:
                break
        for member, behind in members:
            if member == step.key:
                assert isinstance(behind, Array)
                return walk.strings(walk.count(behind))
            walk.over(behind)
        raise Malformed


def _way(walk: Walk, at: int, number: Struct, absent: Absent | None) -> Way:
    """Return a way that a later message is compared with in one read."""
    form, end, expected = walk.order + 'xB', 2, [walk.data[1]]
    for begin, code, value in sorted(set(walk.shape)):
        form += f'{HEADER + begin - end}x{code}'
        end = HEADER + begin + Struct(code).size
        expected.append(value)  # type: ignore[arg-type]
    known = Struct(form)
    return Way(max(known.size, at + number.size), known, tuple(expected), at, number, absent)


def _resolve(
    address: Address, layout: Message
) -> tuple[tuple[Step, ...], tuple[str, int], Callable[..., float] | None]:
    """Return the way to a number, its code and count, and what makes one number of several."""
    kind: Type = layout
    path = list(address.path)
    for i, step in enumerate(address.path):
        if not isinstance(kind, Message):
            raise AddressError(address, f'{_written(path[:i])} is a number and has no members')
        if step.member not in kind.members:
            last = i == len(path) - 1
            pseudo = computed_fields(kind)
            if last and step.member in pseudo and not step.indexed:
                return tuple(path[:i]), *pseudo[step.member]
            raise AddressError(
                address,
                f'{kind.name} has no {step.member}: '
                + did_you_mean(step.member, [*kind.members, *pseudo]),
            )
        kind = _element(address, kind, step, _written(path[: i + 1]))
    if isinstance(kind, Number):
        return tuple(path), (kind.code, 1), None
    if isinstance(kind, Message):
        inside = [f'{address.field}.{name}' for name in (*kind.members, *computed_fields(kind))]
        raise AddressError(address, f'that is a whole {kind.name}; name one of {_list(inside)}')
    raise AddressError(address, f'{address.field} is a string, and a signal is a number')


def _element(address: Address, message: Message, step: Step, written: str) -> Type:
    """Return the type of what a step leads to."""
    kind = message.members[step.member]
    if not isinstance(kind, Array):
        if step.indexed:
            raise AddressError(address, f'{step.member} is no array')
        return kind
    if not step.indexed:
        choices = [f'[{name}=...]' for name in message.keys if name != step.member]
        raise AddressError(
            address,
            f'{written} is an array; say which element: {_list([*choices, "[0]", "[-1]"])}',
        )
    if step.key and step.key not in message.keys:
        raise AddressError(
            address,
            f'{message.name} has no array of strings called {step.key}: '
            + did_you_mean(step.key, message.keys),
        )
    fixed = kind.count
    if step.index is not None and fixed is not None and not -fixed <= step.index < fixed:
        raise AddressError(address, f'{step.member} has {fixed} elements')
    return kind.element


def computed_fields(message: Message) -> dict[str, tuple[tuple[str, int], Callable[..., float]]]:
    """Return what can be computed of a message: code and count of its numbers, and how."""
    codes = {kind.code if isinstance(kind, Number) else '' for kind in message.members.values()}
    if len(codes) != 1 or not codes <= {'f', 'd'}:
        return {}
    leaf = (codes.pop(), len(message.members))
    if list(message.members) == QUATERNION:
        return {name: (leaf, _checked(angle)) for name, angle in ANGLES.items()}
    if set(message.members) <= {'x', 'y', 'z'}:
        return {'norm': (leaf, hypot)}
    return {}


def _checked(angle: Callable[..., float]) -> Callable[..., float]:
    """Return an angle of rotations alone: nan for a quaternion that is none."""

    def of(*parts: float) -> float:
        return angle(*parts) if ROTATION[0] <= hypot(*parts) <= ROTATION[1] else nan

    return of


def _written(path: list[Step]) -> str:
    return '.'.join(map(str, path))


def _list(names: list[str]) -> str:
    return ', '.join(names)
