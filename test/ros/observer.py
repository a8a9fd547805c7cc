"""
Writes what a node hears, as it comes: one JSON list per line.

    python observer.py FILE TOPIC... --ros-args ...

A value on a topic gives [topic, value, publication number, source time [s]], a report on
/diagnostics ["/diagnostics", node, level, values, receipt time [s]].
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any, TextIO

from diagnostic_msgs.msg import DiagnosticArray
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.runtime import run
from nadrc_ros.ros.topics import receive, RECORD
from rclpy.utilities import remove_ros_args


class Observer(LiveNode):
    """Listens to what its topics and /diagnostics say, and writes it down."""

    default_name = 'observer'

    def __init__(self, file: TextIO, topics: list[str]) -> None:
        self._file = file
        self._topics = topics
        super().__init__(arguments=sys.argv)

    def set_up(self) -> None:
        for topic in self._topics:
            receive(self, topic, self._taker(topic), RECORD)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_report, 100)

    def _write(self, *entry: object) -> None:
        self._file.write(json.dumps(entry) + '\n')

    def _taker(self, topic: str) -> Any:
        def take(value: float, info: dict[str, Any]) -> None:
            number = info['publication_sequence_number']
            self._write(topic, value, number, info['source_timestamp'] * 1e-9)

        return take

    def _on_report(self, array: DiagnosticArray) -> None:
        for status in array.status:
            values = {pair.key: pair.value for pair in status.values}
            self._write('/diagnostics', status.name, ord(status.level), values, time.time())


def main() -> int:
    path, *topics = remove_ros_args(sys.argv)[1:]
    with open(path, 'x', buffering=1, encoding='utf-8') as file:
        return run(lambda: Observer(file, topics))


if __name__ == '__main__':
    raise SystemExit(main())
