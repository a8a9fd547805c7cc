"""
How a message lies in its serialised bytes (XCDR version 1), and what its type says of it.

Source: OMG, Common Object Request Broker Architecture 3.3, part 2, section 9.3 (CDR): numbers are
aligned to their size, counted from the end of the encapsulation header of four bytes; strings and
sequences have their length before them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import re
import struct

import attrs

# Members of a message type by name, in their order, with their types as ROS writes them:
# 'double', 'float[3]', 'sequence<string>', 'sequence<double, 9>', 'geometry_msgs/Point'.
Members = Mapping[str, str]
# Returns the members of 'geometry_msgs/Point'; raises LookupError for a type that is not known.
MembersOf = Callable[[str], Members]

NUMBERS = {
    'boolean': '?',
    'octet': 'B',
    'char': 'B',
    'byte': 'B',
    'uint8': 'B',
    'int8': 'b',
    'int16': 'h',
    'uint16': 'H',
    'int32': 'i',
    'uint32': 'I',
    'int64': 'q',
    'uint64': 'Q',
    'float': 'f',
    'float32': 'f',
    'double': 'd',
    'float64': 'd',
    'bool': '?',
}
HEADER = 4
# Byte 1 of the encapsulation header: plain CDR, big and little endian.
ORDERS = {0: '>', 1: '<'}
_FIXED = re.compile(r'(.+)\[(\d+)\]')
_SEQUENCE = re.compile(r'sequence<([^,>]+(?:<\d+>)?)(?:, *\d+)?>')
_STRING = re.compile(r'string(?:<\d+>)?')


class Malformed(Exception):
    """The bytes are no message of that type."""


class Unsupported(Exception):
    """A type that cannot be walked over: the message names it."""


@attrs.frozen
class Number:
    """A number: its character of :mod:`struct`, which also tells its size."""

    code: str

    @property
    def size(self) -> int:
        """Return its size and alignment in bytes."""
        return struct.calcsize(self.code)


@attrs.frozen
class String:
    """A string."""


@attrs.frozen
class Array:
    """Elements of one type: ``count`` of them, or as many as the bytes say if that is None."""

    element: Type
    count: int | None


@attrs.frozen
class Message:
    """A message: its members by name."""

    name: str
    members: dict[str, Type]

    @property
    def keys(self) -> list[str]:
        """Return the members that are arrays of strings: in them an element can be looked up."""
        return [
            name
            for name, kind in self.members.items()
            if isinstance(kind, Array) and isinstance(kind.element, String)
        ]


Type = Number | String | Array | Message


def layout_of(name: str, members_of: MembersOf) -> Message:
    """
    Return the layout of a message type.

    Raises
    ------
    LookupError
        When it or one inside it is not known.
    Unsupported
        When it contains wide strings.

    """
    members = {
        member: _parse(kind, members_of) for member, kind in members_of(short_type(name)).items()
    }
    return Message(short_type(name), members)


def short_type(name: str) -> str:
    """Return ``package/Name`` for ``package/msg/Name``."""
    return name.replace('/msg/', '/')


def _parse(kind: str, members_of: MembersOf) -> Type:
    if kind in NUMBERS:
        return Number(NUMBERS[kind])
    if _STRING.fullmatch(kind):
        return String()
    if fixed := _FIXED.fullmatch(kind):
        return Array(_parse(fixed[1], members_of), int(fixed[2]))
    if sequence := _SEQUENCE.fullmatch(kind):
        return Array(_parse(sequence[1], members_of), None)
    if kind.startswith('wstring'):
        raise Unsupported('wide strings')
    return layout_of(kind, members_of)


@attrs.define
class Walk:
    """
    A walk over the bytes of one message.

    Attributes
    ----------
    data, order
        The bytes with their header, and ``<`` or ``>``.
    at
        Where it is, counted from the end of the header.
    shape
        What the way depended on: where it was read, the code of :mod:`struct`, what was there.

    """

    data: bytes
    order: str
    at: int = 0
    shape: list[tuple[int, str, int | bytes]] = attrs.field(factory=list)

    @classmethod
    def over_message(cls, data: bytes) -> Walk:
        """Begin a walk behind the encapsulation header, which tells the order."""
        if len(data) < HEADER or data[0] != 0 or data[1] not in ORDERS:
            raise Malformed
        return cls(data, ORDERS[data[1]])

    def to(self, size: int, count: int = 1) -> int:
        """Go over ``count`` numbers of a size and return where they began."""
        begin = self.at = (self.at + size - 1) & -size
        self.at += size * count
        if self.at > len(self.data) - HEADER:
            raise Malformed
        return begin

    def length(self) -> int:
        """Read a length; that many bytes at least have to follow."""
        begin = self.to(4)
        value: int = struct.unpack_from(self.order + 'I', self.data, HEADER + begin)[0]
        if value > len(self.data) - HEADER - self.at:
            raise Malformed
        self.shape.append((begin, 'I', value))
        return value

    def over(self, kind: Type) -> None:
        """Go over a value of a type."""
        if isinstance(kind, Number):
            self.to(kind.size)
        elif isinstance(kind, String):
            self.to(1, self.length())
        elif isinstance(kind, Array):
            self.over_elements(kind.element, self.count(kind))
        else:
            if not kind.members:  # an empty message has one byte
                self.to(1)
            for member in kind.members.values():
                self.over(member)

    def count(self, kind: Array) -> int:
        """Go to the first element of an array and return how many there are."""
        return self.length() if kind.count is None else kind.count

    def over_elements(self, element: Type, count: int) -> None:
        """Go over elements of a type."""
        if isinstance(element, Number):
            if count:  # an empty sequence is not aligned
                self.to(element.size, count)
            return
        for _ in range(count):
            self.over(element)

    def strings(self, count: int) -> list[str]:
        """Read strings; what they are belongs to the shape."""
        found = []
        for _ in range(count):
            size = self.length()
            begin = self.to(1, size)
            text = self.data[HEADER + begin : HEADER + begin + size]
            self.shape.append((begin, f'{size}s', text))
            found.append(text.rstrip(b'\0').decode(errors='replace'))
        return found
