"""Promise 16: nothing from outside ends a node, or makes it run what it does not show."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import json
from math import isfinite
from pathlib import Path
from random import Random
from typing import Any

from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.ros.topics import LATEST, SEND
from probe import INTERRUPTS, Probe, Processes
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import Float64, String
from storm import number, operation, request

SEED = 16
REQUESTS = {'controller': 1000, 'plant': 120, 'reference': 120, 'recorder': 120}
TOPICS = ('measurement', 'reference', 'reference/rate', 'command', 'plant/output')
# As many requests on their way at once as a service queues.
AT_ONCE = 8
# The bytes of no Float64.
CUT = (b'', b'\x00', b'\x00\x01\x00\x00', b'\x00\x01\x00\x00abc', b'\xff' * 12)


class Storm:
    """Requests to all services of the nodes, and garbage on their topics, from one seed."""

    def __init__(self, probe: Probe, seed: int) -> None:
        self.probe = probe
        self.random = Random(seed)
        self.publishers = [probe.node.create_publisher(Float64, topic, SEND) for topic in TOPICS]
        self.accepted = 0
        self.refused = 0

    def blow(self, node: str, count: int) -> None:
        """Send ``count`` requests to a node, and garbage meanwhile; each of them is answered."""
        shown = self.probe.all_parameters(node)
        for _ in range(0, count, AT_ONCE):
            calls = [self._some_call(node, shown) for _ in range(AT_ONCE)]
            for _ in range(AT_ONCE):
                self._publish()
            for answer in self.probe.call_all(calls):
                self._count(answer)

    def _some_call(self, node: str, shown: dict[str, Any]) -> tuple[Any, Any]:
        if node in ('controller', 'recorder') and self.random.random() < 0.05:
            service, kind, content = operation(self.random, node)
        else:
            service, kind, content = request(self.random, shown)
        return self.probe.client(kind, f'{node}/{service}'), content

    def _publish(self) -> None:
        value: Any = Float64(data=number(self.random))
        if self.random.random() < 0.1:
            value = self.random.choice(CUT)
        self.random.choice(self.publishers).publish(value)

    def _count(self, answer: Any) -> None:
        results = getattr(answer, 'results', None) or [getattr(answer, 'result', None)]
        for result in results:
            good = getattr(result, 'successful', None)
            self.accepted += good is True
            self.refused += good is False


@contextmanager
def odd_publishers(namespace: str) -> Iterator[None]:
    """Publish on the topics of the loop with another type, and with a quality that is too low."""
    context = Context()
    context.init(args=[])  # one context has one type for a topic
    node = Node('odd', namespace=namespace, context=context)
    for topic in TOPICS[:2]:
        node.create_publisher(String, topic, SEND).publish(String(data='text'))
    for topic in TOPICS[2:]:
        node.create_publisher(Float64, topic, LATEST).publish(Float64(data=1.0))
    yield
    node.destroy_node()
    context.shutdown()


def check_trace(trace: Path) -> tuple[set[float], dict[str, Any]]:
    """See that each command was inside the limits of its time; return all, and the settings."""
    settings: dict[str, Any] = {}
    commands = set()
    for line in trace.read_text(encoding='utf-8').splitlines():
        record = json.loads(line)
        settings = record.get('settings', settings)
        if 'u' in record:
            assert settings['command_min'] <= record['u'] <= settings['command_max'], record
            commands.add(record['u'])
    return commands, settings


def test_p16_a_storm_of_requests_and_garbage_leaves_every_node_as_it_shows_itself(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    trace = tmp_path / 'trace.jsonl'
    given: dict[str, dict[str, Any]] = {
        'plant': {'plant': 'chain', 'order': 2},
        'reference': {},
        'recorder': {'directory': str(tmp_path / 'runs')},
        'controller': {'trace': str(trace)},
    }
    # on a topic of its own, to which no one else writes
    ours = {'controller': ('-r', 'command:=sent')}
    nodes = {
        name: start(name, *ours.get(name, ()), rate=100.0, **parameters)
        for name, parameters in given.items()
    }
    sent = probe.listen('sent')

    def met_odd_one(topic: str) -> bool:
        full = probe.node.resolve_topic_name(topic)
        there = probe.node.get_publishers_info_by_topic(full)
        return 'odd' in [info.node_name for info in there]

    probe.wait_until(lambda: set(nodes) <= set(probe.nodes()) and sent)
    storm = Storm(probe, SEED)
    with odd_publishers(probe.namespace):
        probe.wait_until(lambda: all(map(met_odd_one, TOPICS[2:])))
        for name, count in REQUESTS.items():
            storm.blow(name, count)
    assert all(node.running for node in nodes.values())
    assert storm.accepted > 50 and storm.refused > 500

    shown = probe.all_parameters('controller')
    n = len(sent)
    assert probe.enable().success
    probe.wait_until(lambda: len(sent) > n + 5)
    for (name, node), interrupt in zip(nodes.items(), 2 * INTERRUPTS):
        node.signal(interrupt)
        assert probe.end_of(node) == 0, name
        assert 'Traceback' not in node.said, node.said
        assert len(node.said.splitlines()) < 100, node.said
    assert all(map(isfinite, sent))
    commands, running = check_trace(trace)
    assert set(sent) <= commands | {running['safe_command']}
    assert {key: shown[key] for key in declared(ControllerSettings)} == running
