"""Topics of numbers: quality of service, receiving with the message info, sending."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import copy
from math import nan
from struct import Struct
from typing import Any

import attrs
from diagnostic_msgs.msg import DiagnosticStatus
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.ros.versions import with_info
from nadrc_ros.ros.wires import FLOAT64, Wire
from nadrc_ros.wiring.reader import Absent
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from std_msgs.msg import Float64

# The reference and its derivatives, REFERENCE_DERIVATIVES of them.
REFERENCE_TOPICS = ('reference', 'reference/rate', 'reference/acceleration')
# What b0_table is over, if b0_source is topic.
GAIN_TOPIC = 'b0_variable'
# What of the command really acts, and what is to be added to it.
APPLIED_TOPIC, FEED_FORWARD_TOPIC = 'applied', 'feed_forward'
Info = dict[str, Any]
Receive = Callable[[float, Info], None]
Take = Callable[[bytes, Info], None]
# Has a callback called with the messages of an input, which the last argument subscribes to.
Join = Callable[['Input', Take, Callable[[Take], Any]], Any]

SEND = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
# Connects to every publisher, and never waits for an old sample.
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
RECORD = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
LOCKSTEP_SEND = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
LOCKSTEP_RECEIVE = QoSProfile(
    history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE
)
# The node itself says what does not fit, and destroying an input is safe without events.
_SILENT = SubscriptionEventCallbacks(use_default_callbacks=False)
# A Float64 as it travels: to make and take messages of Python doubles the time of both.
_HEADER = bytes((0, 1, 0, 0))  # the byte order
_LITTLE, _BIG = Struct('<4sd'), Struct('>4sd')


@attrs.define(eq=False)
class Input:
    """A topic that a node reads, by its full name, and how many samples came."""

    topic: str
    qos: QoSProfile
    silence: bytes | None  # level of what is said of it, None for nothing but a mistake
    regular: bool  # whether samples have to go on coming after the first one
    sole: bool  # whether there should be one publisher only
    message_type: str = FLOAT64
    count: int = 0
    absent: Absent | None = None  # what the last message did not have that came without the number
    absences: int = 0  # how many came so
    skipped: Callable[[int | None], object] = lambda number: None  # called with its number
    subscription: Any = None


class Sender:
    """
    A publisher of numbers.

    Attributes
    ----------
    topic, message_type
        Full name of the topic, and type of its messages.
    owner
        Full name of the node that has the publisher.
    count
        How many messages were published.
    told
        Called with the number of a message and the number in it, if it is not None.
    wire
        Where in messages the number is, None for a Float64.

    """

    message_type = FLOAT64
    wire: Wire | None = None

    def __init__(
        self, node: Node, topic: str, qos: QoSProfile = SEND, kind: Any = Float64
    ) -> None:
        qos = copy.copy(qos)  # rclpy writes overrides into it
        self.publisher: Publisher = node.create_publisher(
            kind, topic, qos, qos_overriding_options=_overridable(node, topic, qos, 'publisher')
        )
        self.topic: str = self.publisher.topic_name
        self.owner: str = node.get_fully_qualified_name()
        self.count = 0
        self.told: Callable[[int, float], None] | None = None

    @property
    def has_readers(self) -> bool:
        """Tell whether anybody subscribes."""
        return bool(self.publisher.get_subscription_count())

    def send(self, value: float, stamp: int = 0) -> None:
        """Publish ``value``, in answer to a sample of the time ``stamp`` [ns] where that fits."""
        self.count += 1
        self.publisher.publish(_LITTLE.pack(_HEADER, value))
        if self.told is not None:
            self.told(self.count, value)

    def rest(self, value: float) -> None:
        """Note what this sender would send if it were not silent, for messages of others."""

    def send_last(self, value: float, stamp: int = 0) -> None:
        """Publish ``value``; nothing is raised at shutdown."""
        with suppress(RuntimeError):  # the context is gone: nobody is left to tell
            self.send(value, stamp)

    def await_delivery(self, seconds: float) -> None:
        """Wait, but not for longer, until every reliable reader has what was sent."""
        with suppress(RuntimeError):
            self.publisher.wait_for_all_acked(Duration(seconds=seconds))


def receive(
    node: Node,
    topic: str,
    callback: Receive,
    qos: QoSProfile = LATEST,
    *,
    silence: bytes | None = DiagnosticStatus.OK,
    regular: bool = False,
    sole: bool = False,
    fixed: bool = False,
    wire: Wire | None = None,
    join: Join | None = None,
) -> Input:
    """
    Subscribe ``callback(value, info)`` to a topic.

    Parameters
    ----------
    node, topic, qos
        Of the subscription.
    callback
        Called with each sample; a message that has none is counted.
    silence, regular, sole
        See :class:`Input`.
    fixed
        Whether YAML cannot change the quality of service.
    wire
        Where the number is instead, in messages of which type on which topic.
    join
        Subscribes instead of the node, and may be subscribed already.

    """
    qos = copy.copy(qos)  # rclpy writes overrides into it
    kind = Float64
    if wire is not None:
        topic, kind = wire.address.topic, wire.kind
    heard = Input(
        topic=node.resolve_topic_name(topic),
        qos=qos,
        silence=silence,
        regular=regular,
        sole=sole and not (wire and wire.keyed),
        message_type=wire.message_type if wire else FLOAT64,
    )

    def call(data: bytes, info: Info) -> None:
        heard.count += 1
        callback(_number(data), info)

    take = _taker(heard, wire, callback) if wire else call

    def subscribe(call: Take) -> Any:
        return node.create_subscription(
            kind,
            topic,
            with_info(call),
            qos,
            event_callbacks=_SILENT,
            qos_overriding_options=(
                None if fixed else _overridable(node, topic, qos, 'subscription')
            ),
            raw=True,
        )

    heard.subscription = subscribe(take) if join is None else join(heard, take, subscribe)
    return heard


def _taker(heard: Input, wire: Wire, callback: Receive) -> Take:
    read, timed, reader = wire.reader.read, wire.timed, wire.reader

    def take(data: bytes, info: Info) -> None:
        value = read(data)
        if value is None:
            heard.absences += 1
            heard.absent = reader.absent
            heard.skipped(info['publication_sequence_number'])
            return
        heard.count += 1
        callback(value, timed(data, info))

    return take


def _number(data: bytes) -> float:
    """Return the number of a serialized Float64; nan where there is none."""
    if len(data) < _LITTLE.size:
        return nan
    layout = _LITTLE if data[1] & 1 else _BIG
    number: float = layout.unpack_from(data)[1]
    return number


def reference_topics(settings: ControllerSettings) -> tuple[str, ...]:
    """Return the topics that a controller takes the reference and its derivatives from."""
    count = 1 + settings.received_derivatives
    return REFERENCE_TOPICS[:count]


def _overridable(
    node: Node, topic: str, qos: QoSProfile, kind: str
) -> QoSOverridingOptions | None:
    """Let YAML override the profile of the topics that join nodes; lockstep depends on its own."""
    if qos.history == HistoryPolicy.KEEP_ALL or topic.startswith('~'):
        return None
    name = f'qos_overrides.{node.resolve_topic_name(topic)}.{kind}.depth'
    given = node._parameter_overrides.get(name)
    if given is not None and not (type(given.value) is int and 1 <= given.value < 2**31):
        raise SettingError(name, given.value, 'an integer from 1 on')
    return QoSOverridingOptions.with_default_policies()
