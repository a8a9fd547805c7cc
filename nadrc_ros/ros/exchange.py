"""What the axes of one process share: a subscription, and an outgoing message, for each topic."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from math import isnan, nan
from struct import Struct
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.ros.topics import Info, Input, Sender, Take
from nadrc_ros.ros.wires import message_class, Wire
from nadrc_ros.wiring.address import Address, AddressError, Step
from nadrc_ros.wiring.layout import Array, Message, Number, Type
from nadrc_ros.wiring.reader import Reader
from rclpy.node import Node
from rclpy.serialization import serialize_message

# Of an array that a command is in, the most elements.
_LONGEST = 10_000
_LARGEST = {'d': 1.7976931348623157e308, 'f': 3.4028234663852886e38}


class Exchange:
    """
    Subscriptions and outgoing messages of one process, one for each topic and type.

    What several axes want to hear is taken once, and each is given it in turn; what they send in
    the same message goes out when all that were due have answered, with :meth:`flush`.
    """

    def __init__(self) -> None:
        self._takers: dict[tuple[str, str], tuple[Any, list[Take]]] = {}
        self._messages: dict[tuple[str, str], OutgoingMessage] = {}
        self._taking = False

    def join(self, heard: Input, take: Take, subscribe: Callable[[Take], Any]) -> Any:
        """Have ``take`` called with the messages of an input; return their subscription."""
        key = heard.topic, heard.message_type
        if key not in self._takers:
            takers: list[Take] = []

            def call(data: bytes, info: Info) -> None:
                self._taking = True
                try:
                    for each in takers:
                        each(data, info)
                finally:
                    self._taking = False
                self.flush()

            self._takers[key] = subscribe(call), takers
        subscription, takers = self._takers[key]
        # The last first: a reference is then there for the step that its measurement triggers.
        takers.insert(0, take)
        return subscription

    def sender(self, node: Node, wire: Wire, fill: float, frame_id: str, value: float) -> Sender:
        """
        Return what sends a command where its wire says; until it does, that is ``value``.

        Raises
        ------
        UserError
            When there is no place for a number, or another axis has it.

        """
        key = node.resolve_topic_name(wire.address.topic), wire.message_type
        if key not in self._messages:
            self._messages[key] = OutgoingMessage(node, wire, fill, frame_id)
        return self._messages[key].add(wire, fill, frame_id, value)

    def flush(self) -> None:
        """Publish each message of which something was sent since it last went out."""
        if not self._taking:
            for message in self._messages.values():
                message.flush()


class OutgoingMessage(Sender):
    """A message with the commands of one axis or more, all else in it as it is by default."""

    def __init__(self, node: Node, wire: Wire, fill: float, frame_id: str) -> None:
        super().__init__(node, wire.address.topic, kind=wire.kind)
        self.message_type = wire.message_type
        self._kind = wire.kind
        self._stamped = wire.reader.has_header
        self._fill, self._frame_id = fill, frame_id
        self._fields: list[Field] = []
        self._data = bytearray()
        self._due, self._stamp = False, 0

    def add(self, wire: Wire, fill: float, frame_id: str, value: float) -> Field:
        """
        Add a number to the message, ``value`` until another one is sent.

        Raises
        ------
        UserError
            When there is no place for it, another axis has it, or wants another message.

        """
        named = f'{wire.name} {str(wire.address)!r}'
        if frame_id and not self._stamped:
            raise UserError(
                f'{named}: {wire.message_type} has no header for wiring.frame_id {frame_id!r}'
            )
        if (fill, frame_id) != (self._fill, self._frame_id):
            raise UserError(f'{named}: wiring.fill and wiring.frame_id are one for all axes')
        if any(each.wire.address.path == wire.address.path for each in self._fields):
            raise UserError(f'{named}: another axis of this process commands it')
        field = Field(self, wire, value)
        self._fields.append(field)
        try:
            self._make()
        except AddressError as error:
            raise UserError(f'{wire.name} {error}') from None
        return field

    def take(self, stamp: int) -> None:
        """Note that a number in it was set in answer to a sample of this time [ns]."""
        self._due, self._stamp = True, max(self._stamp, stamp)
        if len(self._fields) == 1:
            self.flush()

    def put(self, at: int, form: Struct, number: float) -> None:
        """Write a number into the message, as it is packed there."""
        form.pack_into(self._data, at, number)

    def flush(self) -> None:
        """Publish the message if a number in it was set since."""
        if not self._due:
            return
        if self._stamped:
            Reader.put_stamp(self._data, self._stamp)
        self._due, self._stamp = False, 0
        self.count += 1
        data = bytes(self._data)
        self.publisher.publish(data)
        for each in self._fields:
            each.went(self.count, data)

    def _make(self) -> None:
        """Make the message anew, large enough for all that is put into it."""
        message = self._kind()
        if self._frame_id:
            message.header.frame_id = self._frame_id
        for _ in range(2):  # the second time arrays have a place for each name that came later
            for each in self._fields:
                _make_room(each.wire, message, self._fill)
        self._data = bytearray(serialize_message(message))
        for each in self._fields:
            each.find(bytes(self._data))


class Field(Sender):
    """The number of one axis in an outgoing message; others may have theirs in it."""

    def __init__(self, message: OutgoingMessage, wire: Wire, value: float) -> None:
        self.publisher = message.publisher
        self.topic, self.message_type, self.owner = (
            message.topic,
            message.message_type,
            message.owner,
        )
        self.count = 0
        self.told = None
        self.wire: Wire = wire
        self._message = message
        self._value = value
        self._at, self._form, self._low, self._high = 0, Struct(''), 0.0, 0.0
        self._sent = False

    def find(self, data: bytes) -> None:
        """Find the number in a message of the size that it has now, and set it."""
        self._at, self._form = self.wire.reader.place(data)
        self._low, self._high = number_range(self._form.format[-1])
        self.rest(self._value)

    def rest(self, value: float) -> None:
        """Set the number without a message for it: others' messages will have it."""
        if isnan(value):  # no number is ever made full actuator by the clamp
            return
        self._value = value
        address = self.wire.address
        number = (value - address.offset) / address.factor
        number = max(self._low, min(self._high, number))
        whole = isinstance(self._low, int)
        self._message.put(self._at, self._form, round(number) if whole else number)

    def send(self, value: float, stamp: int = 0) -> None:
        """Set the number; the message goes out when all axes that are due have set theirs."""
        self._sent = True
        self.rest(value)
        self._message.take(stamp)

    def send_last(self, value: float, stamp: int = 0) -> None:
        """Publish ``value`` at once; nothing is raised at shutdown."""
        with suppress(RuntimeError):  # the context is gone: nobody is left to tell
            self.send(value, stamp)
            self._message.flush()

    def went(self, number: int, data: bytes) -> None:
        """Note that a message was published."""
        self.count += self._sent
        self._sent = False
        if self.told is not None:
            read = self.wire.reader.read(data)
            self.told(number, nan if read is None else read)


def number_range(code: str) -> tuple[float, float]:
    """Return the least and the greatest number of a type of :mod:`struct`, integers as such."""
    if code in 'fd':
        return -_LARGEST[code], _LARGEST[code]
    if code == '?':
        return 0, 1
    bits = 8 * Struct(code).size
    return (0, 2**bits - 1) if code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def _make_room(wire: Wire, message: Any, fill: float) -> None:
    """
    Let a message have the number of a wire: its arrays get elements, and the names to find them.

    Raises
    ------
    AddressError
        When there is no place for it.

    """
    address, kind = wire.address, wire.reader.layout
    for step in address.path:
        if step.member not in kind.members:  # computed ones are refused where they are placed
            return
        inner: Type = kind.members[step.member]
        if isinstance(inner, Array):
            index = _index(address, step, message)
            there = len(getattr(message, step.key)) if step.key else 0
            _extend(address, message, step.member, inner, max(there, index + 1), fill)
            inner, message = inner.element, getattr(message, step.member)[index]
        else:
            message = getattr(message, step.member)
        if not isinstance(inner, Message):
            return
        kind = inner


def _index(address: Address, step: Step, message: Any) -> int:
    """Return which element a step means, which is given its name if it needs one."""
    if step.key:
        names = list(getattr(message, step.key))
        if step.value not in names:
            setattr(message, step.key, names := [*names, step.value])
        return names.index(step.value)
    assert step.index is not None
    if not 0 <= step.index < _LONGEST:
        raise AddressError(address, f'of what is sent, elements are [0] to [{_LONGEST - 1}]')
    return step.index


def _extend(
    address: Address, message: Any, member: str, kind: Array, size: int, fill: float
) -> None:
    there = list(getattr(message, member))
    if isinstance(kind.element, Message):
        make = message_class(kind.element.name)
        there += [make() for _ in range(size - len(there))]
    elif isinstance(kind.element, Number):
        low, high = number_range(kind.element.code)
        filler: float = max(low, min(high, fill))
        filler = round(filler) if isinstance(low, int) else filler
        fixed = kind.count is not None
        there = [filler] * len(there) if fixed else there + [filler] * (size - len(there))
    try:
        setattr(message, member, there)
    except AssertionError:  # of rclpy, for an array with a bound
        raise AddressError(address, f'{member} has no room for {size} elements') from None
