"""Which field of which message a signal of a node is, and what reads it from the bytes."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
import time
from typing import Any

import attrs
from nadrc_ros.adrc.errors import near_to, UserError
from nadrc_ros.ros.versions import distribution
from nadrc_ros.wiring.address import Address, AddressError, full_type, GRAMMAR
from nadrc_ros.wiring.layout import Members
from nadrc_ros.wiring.reader import Reader
from rclpy.node import Node

PREFIX = 'wiring.'
FLOAT64 = 'std_msgs/msg/Float64'
# The graph is asked again so often for a type that nobody told [s].
_LOOK = 0.05
_MOST_LISTED = 12


def message_class(name: str) -> Any:
    """
    Return the class of the messages of a type, ``package/Name`` or ``package/msg/Name``.

    Raises
    ------
    LookupError
        When there is none.

    """
    package, _, kind = full_type(name).partition('/msg/')
    try:
        return getattr(import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError):
        raise LookupError(name) from None


def members_of(name: str) -> Members:
    """Return the members of a message type, as :data:`~nadrc_ros.wiring.layout.MembersOf` does."""
    members: Members = message_class(name).get_fields_and_field_types()
    return members


def missing_type(name: str) -> str:
    """Return why there are no messages of a type, and what to do."""
    package, _, kind = full_type(name).partition('/msg/')
    try:
        there = import_module(f'{package}.msg')
    except ImportError:
        wheel = f'ros-{distribution()}-{package.replace("_", "-")}'
        return f'the message package {package} is not installed: {wheel} has it (apt or pip)'
    near = near_to(kind, [each for each in dir(there) if each[0].isupper()])
    return f'{package} has no message {kind}' + (f': did you mean {near}?' if near else '')


@attrs.define(eq=False)
class Wire:
    """
    A signal of a node in messages of some type.

    Attributes
    ----------
    name
        What it is called in messages to the user, the parameter that has its address.
    reader
        Of the number in a message.
    kind
        Class of the messages.
    stamp
        ``header``, ``source`` or ``receipt``: which time of a message is that of the sample.
    now
        The node's clock in simulated time [ns], of which headers and receipts are then; else None.
    unstamped
        Messages whose header was not set.

    """

    name: str
    reader: Reader
    kind: Any
    stamp: str
    now: Callable[[], int] | None = None
    unstamped: int = 0

    @property
    def address(self) -> Address:
        """Where the number is, with the type of the messages."""
        return self.reader.address

    @property
    def message_type(self) -> str:
        """Type of the messages."""
        return self.address.message_type

    @property
    def by_header(self) -> bool:
        """Tell whether samples are in the order of what their headers say."""
        return self.stamp == 'header' and self.reader.has_header

    @property
    def keyed(self) -> bool:
        """Tell whether its number is looked up by a name, among those of several publishers."""
        return any(step.key for step in self.address.path)

    def timed(self, data: bytes, info: dict[str, Any]) -> dict[str, Any]:
        """Return the info of a message with the time of its sample in place of the source's."""
        if self.by_header:
            stamp = self.reader.stamp(data)
            self.unstamped += stamp is None
            if self.now is not None:
                now = self.now()
                return {**info, 'source_timestamp': stamp or now, 'received_timestamp': now}
            if stamp is not None:
                return {**info, 'source_timestamp': stamp}
        elif self.stamp == 'receipt':
            return {**info, 'source_timestamp': info['received_timestamp']}
        return info


def make_wire(node: Node, name: str, address: Address, stamp: str, wait: float) -> Wire:
    """
    Find the type of a signal's messages and the way to its number in them.

    Parameters
    ----------
    node
        On whose graph the topic is.
    name
        Of the signal, ``measurement`` or the like.
    address
        Where it is; a type that is left out is that of the topic on the graph.
    stamp
        See :class:`Wire`.
    wait
        Longest time to wait for the topic where the type is left out [s].

    Raises
    ------
    UserError
        When there is no such type, or no number there, or nobody told the type.

    """
    parameter = PREFIX + name
    if not address.message_type:
        said = f'{parameter} {str(address)!r}'
        address = attrs.evolve(
            address, message_type=type_on_graph(node, said, address.topic, wait)
        )
    try:
        kind = message_class(address.message_type)
    except LookupError:
        raise UserError(
            f'{parameter} {str(address)!r}: {missing_type(address.message_type)}'
        ) from None
    try:
        reader = Reader(address, address.message_type, members_of)
    except AddressError as error:
        raise UserError(f'{parameter} {error}') from None
    simulated = node.get_parameter('use_sim_time').value
    clock = node.get_clock()
    now = (lambda: clock.now().nanoseconds) if simulated else None
    return Wire(parameter, reader, kind, stamp, now)


def type_on_graph(node: Node, who: str, topic: str, wait: float) -> str:
    """
    Return the type that a topic has on the graph, ``who`` needs it.

    Raises
    ------
    UserError
        When it has none within ``wait`` [s], or several.

    """
    topic = node.resolve_topic_name(topic)
    end = time.monotonic() + wait
    while True:
        infos = node.get_publishers_info_by_topic(topic)
        infos = infos or node.get_subscriptions_info_by_topic(topic)
        types = sorted({info.topic_type for info in infos})
        if len(types) == 1:
            found: str = types[0]
            return found
        if getattr(node, 'told_to_stop', False) or time.monotonic() > end:
            break
        time.sleep(_LOOK)
    if types:
        raise UserError(f'{who}: {topic} has the types {", ".join(types)}: name one, as {GRAMMAR}')
    own = f'{node.get_fully_qualified_name()}/'
    there = {
        name: kinds[0]
        for name, kinds in node.get_topic_names_and_types()
        if node.count_publishers(name) and not name.startswith(own)
    }
    near = near_to(topic, there, 0.8)
    listed = [f'{name} {kind}' for name, kind in sorted(there.items())]
    more = f' and {len(listed) - _MOST_LISTED} more' if len(listed) > _MOST_LISTED else ''
    raise UserError(
        f'{who}: after {wait:g} s nobody has a topic {topic}, and no type is named; '
        f'{f"did you mean {near}? " if near else ""}'
        f'published are {", ".join(listed[:_MOST_LISTED]) or "none"}{more}'
    )
