"""Inputs that nobody feeds are told, with the reason, and no more than once for each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from nadrc_ros.nodes import inputs
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.diagnostics import WARN
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.nodes.topics import LATEST, SEND
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
    monkeypatch.setattr(inputs, 'GRACE', 0.5)


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
    assert inputs.GRACE + 1.0 <= 5.0


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
    told(probe, f'start with {name} = best_effort')


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
