"""Every number in a message, with its address: what a user chooses from."""

from __future__ import annotations

from collections.abc import Iterator

from nadrc_ros.wiring.address import Address, parse_path
from nadrc_ros.wiring.layout import (
    Array,
    layout_of,
    MembersOf,
    Message,
    Number,
    Type,
    Walk,
)
from nadrc_ros.wiring.reader import computed_fields, Reader

# Of an array of numbers without names, so many elements are listed, first and last.
FEW = 8


def numbers_in(
    data: bytes, message_type: str, members_of: MembersOf
) -> Iterator[tuple[str, float]]:
    """
    Yield the field of every number in a message, as an address names it, and its value.

    Elements of an array that has names beside it are named; of a long one without, the middle is
    left out. Computed ones (yaw, norm) come with the others.

    Raises
    ------
    Malformed
        When the bytes are no message of that type.

    """
    layout = layout_of(message_type, members_of)
    for field in _fields(Walk.over_message(data), layout, ''):
        value = Reader(Address('', message_type, parse_path(field)), message_type, members_of)
        number = value.read(data)
        if number is not None:
            yield field, number


def _fields(walk: Walk, message: Message, prefix: str) -> Iterator[str]:
    if not message.members:
        walk.over(message)
    names: dict[str, list[str]] = {}
    ahead = Walk(walk.data, walk.order, walk.at)
    for member, kind in message.members.items():
        if member in message.keys:
            assert isinstance(kind, Array)
            names[member] = ahead.strings(ahead.count(kind))
        else:
            ahead.over(kind)
    for member, kind in message.members.items():
        if isinstance(kind, Array):
            count = walk.count(kind)
            key = next((key for key, there in names.items() if _tells_apart(there, count)), '')
            for i in range(count):
                step = f'[{key}={names[key][i]}]' if key else f'[{i}]'
                shown = key or i < FEW or i == count - 1
                for field in _values(walk, kind.element, f'{prefix}{member}{step}'):
                    if shown:
                        yield field
        else:
            yield from _values(walk, kind, prefix + member)
    for name in computed_fields(message):
        yield prefix + name


def _tells_apart(names: list[str], count: int) -> bool:
    """Tell whether each of so many elements has a name of its own that an address can say."""
    sayable = all(name and not set(name) & set('] \t\n') for name in names)
    return len(set(names)) == len(names) == count > 0 and sayable


def _values(walk: Walk, kind: Type, field: str) -> Iterator[str]:
    if isinstance(kind, Message):
        yield from _fields(walk, kind, field + '.')
        return
    walk.over(kind)
    if isinstance(kind, Number):
        yield field
