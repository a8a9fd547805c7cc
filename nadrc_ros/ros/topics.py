"""Float64 topics: quality of service, receiving with the message info, sending."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import copy
import functools
from math import nan
from struct import Struct
from typing import Any

import attrs
from diagnostic_msgs.msg import DiagnosticStatus
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
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
Info = dict[str, Any]
Receive = Callable[[float, Info], None]

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
FLOAT64 = 'std_msgs/msg/Float64'
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
    count: int = 0
    subscription: Any = None


class Sender:
    """A publisher of numbers, and how many it has published."""

    def __init__(self, node: Node, topic: str, qos: QoSProfile = SEND) -> None:
        qos = copy.copy(qos)  # rclpy writes overrides into it
        self.publisher: Publisher = node.create_publisher(
            Float64, topic, qos, qos_overriding_options=_overridable(node, topic, qos, 'publisher')
        )
        self.topic: str = self.publisher.topic_name
        self.count = 0

    @property
    def has_readers(self) -> bool:
        """Tell whether anybody subscribes."""
        return bool(self.publisher.get_subscription_count())

    def send(self, value: float) -> None:
        """Publish ``value``."""
        self.count += 1
        self.publisher.publish(_LITTLE.pack(_HEADER, value))

    def send_last(self, value: float) -> None:
        """Publish ``value``; nothing is raised at shutdown."""
        with suppress(RuntimeError):  # the context is gone: nobody is left to tell
            self.send(value)

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
) -> Input:
    """Subscribe ``callback(value, info)`` to a topic; if ``fixed``, YAML cannot change its QoS."""
    qos = copy.copy(qos)  # rclpy writes overrides into it
    heard = Input(
        topic=node.resolve_topic_name(topic), qos=qos, silence=silence, regular=regular, sole=sole
    )

    @with_info
    def call(data: bytes, info: Info) -> None:
        heard.count += 1
        callback(_number(data), info)

    heard.subscription = node.create_subscription(
        Float64,
        topic,
        call,
        qos,
        event_callbacks=_SILENT,
        qos_overriding_options=(None if fixed else _overridable(node, topic, qos, 'subscription')),
        raw=True,
    )
    return heard


def with_info(callback: Callable[[Any, Info], None]) -> Callable[..., None]:
    """Return a callback of a message and its info that works on every executor."""

    @functools.wraps(callback)
    def call(*args: Any) -> None:
        # In rclpy 7.1.6 the EventsExecutor passes message and info as ONE tuple.
        message, info = args if len(args) == 2 else args[0]
        callback(message, info)

    return call


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
