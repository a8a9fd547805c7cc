"""Inputs that nobody feeds are told, with the reason, and no more than once for each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.ros import graph
from nadrc_ros.ros.diagnostics import AGAIN, OK, Remarks, WARN
from nadrc_ros.ros.graph import InputWatch
from nadrc_ros.ros.topics import Input, LATEST, SEND
from probe import Probe
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float32, Float64

CONTROL: dict[str, Any] = {
    'rate': 50.0,
    'plant_order': 1,
    'b0': 1.0,
    'inner_bandwidth': 15.0,
    'outer_bandwidth': 15.0,
}
ASK_FOR_RELIABLE = 'qos_overrides.{}.subscription.reliability'


@pytest.fixture(autouse=True)
def impatience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(graph, 'GRACE', 0.5)


@pytest.fixture
def driver(namespace: str) -> Iterator[Node]:
    """Return a node of another participant: one has a single type for each topic."""
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = Node('driver', namespace=namespace, context=context)
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=context)


def told(probe: Probe, words: str, node: str = 'controller') -> None:
    """Wait until a report warns in these words."""

    def is_told() -> bool:
        level, message, _ = probe.said(node)[-1] if probe.said(node) else (b'', '', {})
        return level >= WARN and words in message

    probe.wait_until(is_told)


def test_the_patience_is_such_that_it_is_told_within_five_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.undo()
    assert graph.GRACE + 1.0 <= 5.0


@pytest.mark.parametrize(
    ('topic', 'kind', 'words'),
    [
        ('other', Float64, 'nobody publishes it'),
        (
            'measurements',
            Float64,
            'nobody publishes it, but {ns}/driver publishes {ns}/measurements as '
            'std_msgs/msg/Float64: did you mean to remap?',
        ),
        (
            'arm/measurement',
            Float64,
            'nobody publishes it, but {ns}/driver publishes {ns}/arm/measurement as '
            'std_msgs/msg/Float64: did you mean to remap?',
        ),
        (
            'measurement',
            Float32,
            '{ns}/driver publishes it as std_msgs/msg/Float32, and std_msgs/msg/Float64 is needed',
        ),
        ('measurement', Float64, '{ns}/driver publishes it, and sends nothing'),
    ],
)
def test_what_is_wrong_with_an_input_is_told_by_name(
    topic: str,
    kind: Any,
    words: str,
    probe: Probe,
    driver: Node,
    capfd: pytest.CaptureFixture[str],
) -> None:
    driver.create_publisher(kind, topic, SEND)
    probe.add(ControllerNode(parameters=CONTROL))
    space = probe.namespace
    line = f'nothing comes on {space}/measurement: ' + words.format(ns=space)
    told(probe, line.partition('{')[0])
    reports = len(probe.said())
    probe.wait_until(lambda: len(probe.said()) > reports + 1)
    assert capfd.readouterr().err.count(line) == 1


def test_a_quality_of_service_that_does_not_fit_is_told_with_the_remedy(probe: Probe) -> None:
    name = ASK_FOR_RELIABLE.format(f'{probe.namespace}/measurement')
    probe.node.create_publisher(Float64, 'measurement', LATEST)
    probe.add(ControllerNode(parameters=CONTROL | {name: 'reliable'}))
    told(
        probe,
        f'{probe.namespace}/probe publishes it as best effort, heard only with '
        f'-p {name}:=best_effort',
    )


def test_when_samples_come_that_is_said_and_the_warning_ends(
    probe: Probe, capfd: pytest.CaptureFixture[str]
) -> None:
    probe.add(ControllerNode(parameters=CONTROL))
    told(probe, 'nobody publishes it')
    measure = probe.publisher('measurement')
    told(probe, f'{probe.namespace}/probe publishes it, and sends nothing')
    timer = probe.node.create_timer(0.02, lambda: measure(0.0))
    probe.wait_until(lambda: 'nothing comes' not in probe.said()[-1][1])
    assert f'samples come on {probe.namespace}/measurement' in capfd.readouterr().err
    timer.cancel()  # and when they cease, that is told too
    told(probe, 'sends nothing')


def test_several_publishers_of_the_reference_are_told(probe: Probe) -> None:
    probe.add(ControllerNode(parameters=CONTROL))
    probe.publisher('reference'), probe.publisher('reference')
    space = probe.namespace
    told(probe, f'several publishers of {space}/reference: {space}/probe, {space}/probe')


def test_a_plant_and_a_recorder_tell_it_too(
    probe: Probe, driver: Node, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    driver.create_publisher(Float32, 'command', SEND)
    probe.add(PlantNode(parameters={'rate': 50.0}))
    probe.add(RecorderNode(parameters={'rate': 50.0, 'directory': str(tmp_path / 'runs')}))
    line = f'nothing comes on {probe.namespace}/command: {probe.namespace}/driver publishes it as '
    for node in ('plant', 'recorder'):
        told(probe, line, node)
    log = capfd.readouterr().err
    assert log.count(line) == 2
    # one line for all that has one reason
    lines = [said for said in log.splitlines() if 'nothing comes on' in said]
    assert sum('/controller/' in said for said in lines) == 1


class Watched:
    """An input of a node, looked at once per second of a time of its own."""

    def __init__(self, node: Node, topic: str, silence: bytes | None, *, regular: bool) -> None:
        self.time = 0.0
        self.input = Input(
            topic=f'{node.get_namespace()}/{topic}',
            qos=LATEST,
            silence=silence,
            regular=regular,
            sole=True,
        )
        self.remarks = Remarks(node.get_logger(), lambda: self.time)
        self.watch = InputWatch(node, [self.input], self.remarks, 0.005, lambda: self.time)

    def run(self, seconds: int, every: int = 0) -> list[bool]:
        """Let time pass, with a sample in each so many seconds; return when a warning held."""
        held = []
        for second in range(seconds):
            self.time += 1.0
            self.input.count += bool(every) and second % every == 0
            self.watch.look()
            held.append(self.remarks.added_to(OK, '')[0] == WARN)
        return held


def test_a_slow_sensor_is_no_silence_and_no_flood(
    driver: Node, capfd: pytest.CaptureFixture[str]
) -> None:
    watched = Watched(driver, 'measurement', WARN, regular=True)
    assert not any(watched.run(3600, every=10)[20:])
    assert capfd.readouterr().err.count(' come') <= 2
    assert any(watched.run(100))  # it broke
    watched.run(10, every=1)
    assert any(watched.run(5))  # and is not believed to be so slow as it was silent


def test_an_input_that_flickers_is_logged_once_a_minute(
    driver: Node, capfd: pytest.CaptureFixture[str]
) -> None:
    watched = Watched(driver, 'measurement', WARN, regular=True)
    for _ in range(100):
        watched.run(8, every=1)
        watched.run(4)
    assert capfd.readouterr().err.count('nothing comes') <= 1 + watched.time / AGAIN


def test_the_graph_is_searched_now_and_then_and_for_an_optional_input_once(
    driver: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched, search = [0], driver.get_topic_names_and_types

    def counted() -> Any:
        searched[0] += 1
        return search()

    monkeypatch.setattr(driver, 'get_topic_names_and_types', counted)
    Watched(driver, 'measurement', WARN, regular=True).run(300)
    assert 2 <= searched[0] <= 11
    searched[0] = 0
    Watched(driver, 'reference/rate', None, regular=False).run(300)
    assert searched[0] == 1


@pytest.mark.parametrize('of', ('nobody', 'another axis', 'a reader'))
def test_what_another_axis_or_anybody_reads_is_not_meant(
    of: str, namespace: str, driver: Node, capfd: pytest.CaptureFixture[str]
) -> None:
    def add(name: str, axis: str) -> Node:
        made.append(Node(name, namespace=f'{namespace}/{axis}', context=driver.context))
        return made[-1]

    made: list[Node] = []
    node, topic = add('controller', 'x'), f'{namespace}/y/reference/rate'
    driver.create_publisher(Float64, topic, SEND)
    other = add('controller' if of == 'another axis' else 'planner', 'y')
    if of == 'a reader':
        other.create_subscription(Float64, topic, print, SEND)
    watched = Watched(node, 'reference/rate', None, regular=False)
    needed = Watched(node, 'reference/rate', WARN, regular=True)
    assert not any(watched.run(60))
    assert ('did you mean' in capfd.readouterr().err) == (of == 'nobody')
    needed.run(60)
    assert ('did you mean' in needed.remarks.added_to(OK, '')[1]) == (of == 'nobody')
    for each in made:
        each.destroy_node()


def test_a_setpoint_that_stands_still_and_a_silent_controller_are_no_warning_of_a_recorder(
    probe: Probe, tmp_path: Path
) -> None:
    probe.add(RecorderNode(parameters={'directory': str(tmp_path / 'runs')}))
    publish = {name: probe.publisher(name) for name in ('reference', 'command', 'measurement')}
    for name in publish:
        told(probe, f'{probe.namespace}/{name}', 'recorder')
    probe.wait_until(lambda: all(map(probe.readers, publish)))
    probe.node.create_timer(0.02, lambda: publish['measurement'](0.0))
    publish['reference'](1.0), publish['command'](0.0)
    probe.wait_until(lambda: 'nothing comes' not in probe.said('recorder')[-1][1])
    n = len(probe.said('recorder'))
    probe.wait_until(lambda: len(probe.said('recorder')) > n + 3)
    assert not any('nothing comes' in message for _, message, _ in probe.said('recorder')[n:])


@pytest.mark.parametrize('topic', ('comand', 'arm/command', 'velocity'))
def test_a_command_that_nobody_takes_is_told_in_control_with_who_may_be_meant(
    topic: str, probe: Probe, driver: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(graph, 'LOOKS', 2)
    driver.create_subscription(Float64, topic, print, SEND)
    node = probe.add(ControllerNode(parameters=CONTROL))
    measure, space = probe.publisher('measurement'), probe.namespace
    nobody = f'nobody subscribes to {space}/command, so the commands move nothing'
    probe.wait_until(lambda: len(probe.said()) > 4)
    assert not any(nobody in message for _, message, _ in probe.said())
    probe.node.create_timer(0.02, lambda: measure(0.0))
    like = f', but {space}/driver subscribes to {space}/{topic}: did you mean to remap?'
    told(probe, nobody + like * (topic != 'velocity'))
    assert ('did you mean' in probe.said()[-1][1]) == (topic != 'velocity')
    assert node.controller.enabled
    probe.listen('command')
    probe.wait_until(lambda: nobody not in probe.said()[-1][1])
