"""What a node says of itself: on /diagnostics, in the log, and as events for who records it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from math import inf
import time

import attrs
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nadrc_ros.ros.pacing import steady_timer
from nadrc_ros.ros.topics import Info
from nadrc_ros.ros.versions import with_info
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR
# What comes and goes is logged again after so many seconds, and not before.
AGAIN = 60.0
_EVENTS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)

# Level, message and values of a node, for /diagnostics.
Report = tuple[bytes, str, Mapping[str, object]]
# Name of the node, kind of the event, what it says, and the info of the message.
TakeEvent = Callable[[str, str, str, Info], None]


@attrs.define
class _Remark:
    """A remark of one key: since how many looks it has a text, and what stands of it."""

    looks: int = 0
    level: bytes = OK
    text: str = ''
    over: str = ''


class Remarks:
    """
    Standing remarks on what is not as it should be, each with a key of its own.

    A remark begins when it was put with a text so many times in a row, and stands until it is put
    without one. When it begins it is logged, but for what was logged less than a minute ago, and
    while it stands it is on /diagnostics. The text may change meanwhile, as it has numbers in it.

    Parameters
    ----------
    logger
        Of the node.
    now
        The time [s].
    event
        Tells an event: its kind, text and level.

    """

    def __init__(
        self,
        logger: RcutilsLogger,
        now: Callable[[], float] = time.monotonic,
        event: Callable[[str, str, bytes], None] = lambda kind, text, level: None,
    ) -> None:
        self._logger = logger
        self._now = now
        self._event = event
        self._remarks: dict[str, _Remark] = {}
        self._until: dict[str, float] = {}  # what was logged, and is not before then

    def put(
        self,
        key: str,
        text: str,
        level: bytes = WARN,
        *,
        looks: int = 1,
        over: str = '',
        event: str = '',
    ) -> None:
        """
        Say what holds under a key now, or with an empty text that nothing does.

        What is only news, of level OK, is logged once in the life of a node and not reported. The
        end of a remark is logged as ``over``, and beginning and end are events of kind ``event``.
        """
        remark = self._remarks.setdefault(key, _Remark())
        remark.looks = remark.looks + 1 if text else 0
        stood, standing = remark.text, text if remark.looks >= looks else ''
        remark.text, remark.level = standing, level
        if standing and not stood:
            remark.over = over
            if event:
                self._event(event, text, level)
            if self.due(key, inf if level == OK else AGAIN):
                self.log(text, level)
        elif stood and not standing and remark.over:
            if event:
                self._event(event, remark.over, OK)
            if self.due(f'{key} is over'):
                self.log(remark.over, OK)

    def hold(self, key: str, text: str, level: bytes) -> None:
        """Let a remark stand that was logged elsewhere; none where ``text`` is empty."""
        self._remarks[key] = _Remark(text=text, level=level)

    def due(self, name: str, pause: float = AGAIN) -> bool:
        """Tell whether to log what has this name now; if so, not again for ``pause`` [s]."""
        now = self._now()
        self._until = {each: until for each, until in self._until.items() if now < until}
        if name in self._until:
            return False
        self._until[name] = now + pause
        return True

    def log(self, text: str, level: bytes) -> None:
        """Write a line to the log."""
        # one call for each severity, as rclpy allows a line of the source one severity only
        if level == ERROR:
            self._logger.error(text)
        elif level == WARN:
            self._logger.warning(text)
        else:
            self._logger.info(text)

    def added_to(self, level: bytes, message: str) -> tuple[bytes, str]:
        """Return a level and a message with those of the remarks that are more than news."""
        for remark in self._remarks.values():
            if remark.text and remark.level != OK:
                level, message = max(level, remark.level), f'{message}; {remark.text}'
        return level, message


class Events:
    """
    Publishes the events of a node on ``~/event``, each in a message of its own.

    A message has the stamp of the node's clock and one status: the name of the node, the event in
    words, and its ``kind`` among the values. Every change is told, where the log leaves some out.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, '~/event', _EVENTS)

    def tell(self, kind: str, message: str, level: bytes = OK) -> None:
        """Publish an event that happens now."""
        self._publisher.publish(_array(self._node, level, message, {'kind': kind}))


def receive_events(node: Node, source: str, take: TakeEvent) -> None:
    """Subscribe to the events of the node ``source``."""
    pass_on = with_info(partial(_pass_on, take))
    node.create_subscription(DiagnosticArray, f'{source}/event', pass_on, _EVENTS)


def _pass_on(take: TakeEvent, array: DiagnosticArray, info: Info) -> None:
    for status in array.status:
        kinds = [pair.value for pair in status.values if pair.key == 'kind']
        take(status.name, kinds[0] if kinds else '', status.message, info)


class Diagnostics:
    """
    Publishes level, message and values of a node once per second, and at once when asked.

    Simulated time that stands still from one second to the next is an ERROR: no timeout passes.
    """

    def __init__(self, node: Node, report: Callable[[], Report]) -> None:
        self._node = node
        self._report = report
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._now = -1
        self._stands_still = False
        steady_timer(node, 1.0, self._on_timer)

    def publish(self) -> None:
        """Publish now."""
        level, message, values = self._report()
        level, message = self._node.remarks.added_to(level, message)
        if self._stands_still:
            level, message = ERROR, f'{message}; /clock stands still'
        self._publisher.publish(_array(self._node, level, message, values))

    def _on_timer(self) -> None:
        before, self._now = self._now, self._node.get_clock().now().nanoseconds
        self._stands_still = self._now == before
        for check in self._node.checks:
            check()
        self.publish()


class Latencies:
    """The last few thousand latencies [s], summarised in milliseconds."""

    def __init__(self, size: int = 4096) -> None:
        self._values: deque[float] = deque(maxlen=size)

    def add(self, seconds: float) -> None:
        """Add one."""
        self._values.append(seconds)

    def summary(self) -> dict[str, float]:
        """Return median and 99th percentile [ms]; empty before the first."""
        ordered = sorted(self._values)
        if not ordered:
            return {}
        return {
            'latency_median_ms': 1e3 * ordered[len(ordered) // 2],
            'latency_p99_ms': 1e3 * ordered[min(len(ordered) - 1, len(ordered) * 99 // 100)],
        }


def _array(
    node: Node, level: bytes, message: str, values: Mapping[str, object]
) -> DiagnosticArray:
    """Return a message of one status of a node, stamped by its clock."""
    status = DiagnosticStatus(
        level=level,
        name=node.get_fully_qualified_name(),
        message=message,
        hardware_id='nadrc_ros',
        values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
    )
    array = DiagnosticArray(status=[status])
    array.header.stamp = node.get_clock().now().to_msg()
    return array


def _text(value: object) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
