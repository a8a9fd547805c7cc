"""What a node says about itself on /diagnostics."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR

Report = Callable[[], tuple[bytes, str, Mapping[str, object]]]


class Diagnostics:
    """
    Publishes level, message and values of a node once per second, and at once when asked.

    Simulated time that stands still from one second to the next is an ERROR: no timeout passes.
    """

    def __init__(self, node: Node, report: Report) -> None:
        self._node = node
        self._report = report
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._now = -1
        self._stands_still = False
        node.create_timer(1.0, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish(self) -> None:
        """Publish now."""
        level, message, values = self._report()
        level, message = self._node.remarks.added_to(level, message)
        if self._stands_still:
            level, message = ERROR, f'{message}; /clock stands still'
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            message=message,
            hardware_id='nadrc_ros',
            values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()]
            + [KeyValue(key='scheduling', value=self._node.scheduling)],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

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


def _text(value: object) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
