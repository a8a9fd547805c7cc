"""
The address of a number in a message: ``TOPIC [TYPE] FIELD [* NUMBER] [+ NUMBER]``.

For example ``/joint_states sensor_msgs/msg/JointState position[name=elbow] * -1``. It is parsed
once, and nothing in it is evaluated.
"""

from __future__ import annotations

from math import isfinite
import re

import attrs
from nadrc_ros.adrc.errors import UserError

GRAMMAR = 'TOPIC [TYPE] FIELD [* NUMBER] [+ NUMBER]'
_TYPE = re.compile(r'[a-zA-Z]\w*/(?:msg/)?[A-Z]\w*')
_TOPIC = re.compile(r'(?:~?/|~$)?(?:[A-Za-z_]\w*/)*[A-Za-z_]\w*|~')
_STEP = re.compile(r'([A-Za-z_]\w*)(?:\[(?:(-?\d+)|([A-Za-z_]\w*)=([^\]]+))\])?(?:\.|$)')


class AddressError(UserError):
    """An address is none, or names what is not in the message."""

    def __init__(self, address: object, why: str) -> None:
        super().__init__(address, why)
        self.address = address
        self.why = why

    def __str__(self) -> str:
        return f'{str(self.address)!r}: {self.why}'


@attrs.frozen
class Step:
    """
    One member on the way to the number.

    Attributes
    ----------
    member
        Its name.
    index
        Which element of the array that it is, from its end if negative; None for no array.
    key, value
        Instead of an index: the element at the place where the array ``key`` of the same message
        says ``value``. Empty otherwise.

    """

    member: str
    index: int | None = None
    key: str = ''
    value: str = ''

    @property
    def indexed(self) -> bool:
        """Tell whether it picks an element of an array."""
        return self.index is not None or bool(self.key)

    def __str__(self) -> str:
        if self.key:
            return f'{self.member}[{self.key}={self.value}]'
        return self.member if self.index is None else f'{self.member}[{self.index}]'


@attrs.frozen
class Address:
    """
    Where a signal is: topic, type of the message, way to the number, and its scale.

    The signal is ``factor`` times the number in the message, plus ``offset``. ``message_type`` is
    empty where the graph has to tell it, ``topic`` where the address is one within a message, and
    ``path`` where a topic has nothing but the number.
    """

    topic: str
    message_type: str = ''
    path: tuple[Step, ...] = ()
    factor: float = 1.0
    offset: float = 0.0

    @property
    def field(self) -> str:
        """Return the way to the number, as it is written."""
        return '.'.join(map(str, self.path))

    def __str__(self) -> str:
        words = [self.topic, self.message_type, self.field]
        words += ['*', _plain(self.factor)] if self.factor != 1.0 else []
        words += ['+', _plain(self.offset)] if self.offset != 0.0 else []
        return ' '.join(filter(None, words))


def _plain(number: float) -> str:
    """Return a number as one writes it, from which it can be read back to the bit."""
    short = f'{number:g}'
    return short if float(short) == number else repr(number)


def parse_address(text: str) -> Address:
    """
    Parse ``TOPIC [TYPE] FIELD [* NUMBER] [+ NUMBER]``.

    Raises
    ------
    AddressError
        Says which word is wrong, and what may stand there.

    """
    words = text.split()
    if len(words) < 2:
        topic, dot, field = text.strip().partition('.')
        meant = (
            f'did you mean {topic} {field}? ' if dot and field else ''
        )  # as other tools have it
        raise AddressError(text, f'{meant}an address is {GRAMMAR}')
    topic, rest = words[0], words[1:]
    if not _TOPIC.fullmatch(topic):
        raise AddressError(text, f'{topic} is no name of a topic')
    message_type = ''
    if _TYPE.fullmatch(rest[0]):
        message_type = full_type(rest.pop(0))
    if not rest:
        raise AddressError(text, f'no field of {message_type} is named; an address is {GRAMMAR}')
    path = parse_path(rest.pop(0), text)
    factor = _number_after('*', rest, text, 1.0)
    offset = _number_after('+', rest, text, 0.0)
    if rest:
        raise AddressError(text, f'{" ".join(rest)} is too much; an address is {GRAMMAR}')
    if factor == 0.0:
        raise AddressError(text, 'the factor is 0, which leaves nothing of the signal')
    return Address(topic, message_type, path, factor, offset)


def full_type(name: str) -> str:
    """Return ``package/msg/Name`` for ``package/Name`` too."""
    package, _, rest = name.partition('/')
    return f'{package}/msg/{rest.rpartition("/")[2]}'


def parse_path(field: str, text: str = '') -> tuple[Step, ...]:
    """
    Parse the way to a number within a message; ``text`` is the whole address.

    Raises
    ------
    AddressError
        Shows from where on it is none.

    """
    text = text or field
    steps, begin = [], 0
    while begin < len(field):
        step = _STEP.match(field, begin)
        if step is None:
            raise AddressError(
                text,
                f'{field[begin:]} is no field: members are joined by dots, elements of an array '
                'are [2], [-1] or [name=elbow]',
            )
        member, index, key, value = step.groups()
        steps.append(Step(member, None if index is None else int(index), key or '', value or ''))
        begin = step.end()
    if field.endswith('.'):
        raise AddressError(text, f'{field} ends with a dot')
    return tuple(steps)


def _number_after(sign: str, words: list[str], text: str, default: float) -> float:
    if not words or words[0] != sign:
        return default
    given = ' '.join(words[1:2])
    try:
        number = float(given)
    except ValueError:
        number = float('nan')
    if not isfinite(number):
        raise AddressError(text, f'after {sign} comes a finite number, not {given or "nothing"}')
    del words[:2]
    return number
