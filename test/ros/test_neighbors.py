"""What a node says of the others on its machine: too many, none at all, behind a late network."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros import graph, neighbors
from nadrc_ros.ros.diagnostics import OK, Remarks, WARN
from nadrc_ros.ros.neighbors import Neighbors, networks
from probe import Probe
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from test_graph import CONTROL, told

Meet = Callable[[], Node]


@pytest.fixture
def meet() -> Iterator[Meet]:
    """Return what makes another participant."""
    made: list[tuple[Context, Node]] = []

    def make() -> Node:
        context = Context()
        rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
        made.append((context, Node(f'other_{len(made)}', context=context)))
        return made[-1][1]

    yield make
    for context, node in made:
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def said(probe: Probe) -> str:
    return probe.said()[-1][1] if probe.said() else ''


def test_who_is_alone_is_told_until_somebody_is_discovered(
    probe: Probe, meet: Meet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(graph, 'GRACE', 0.5)
    probe.add(ControllerNode(parameters=CONTROL))
    alone = 'nobody publishes it; no other process with ROS was ever discovered'
    told(probe, alone)
    meet()
    probe.wait_until(lambda: 'nobody publishes it' in said(probe) and alone not in said(probe))


def test_a_crowd_of_participants_is_told(
    probe: Probe, meet: Meet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Participants are counted, not nodes: those of one process are one."""
    monkeypatch.setattr(neighbors, 'CROWD_LOCALHOST', 3)
    probe.add(ControllerNode(parameters=CONTROL))
    meet()
    probe.wait_until(lambda: len(probe.said()) > 2)
    assert 'processes with ROS' not in said(probe)
    meet()
    told(probe, '3 processes with ROS are on this machine in this domain; beyond 33 with LOCAL')


@pytest.mark.parametrize(
    ('name', 'value', 'crowd'),
    [
        ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST', 26),
        ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET', 80),
        ('ROS_LOCALHOST_ONLY', '1', 26),
    ],
)
def test_the_crowd_is_smaller_on_localhost(
    name: str, value: str, crowd: int, probe: Probe, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv('ROS_AUTOMATIC_DISCOVERY_RANGE')
    monkeypatch.setenv(name, value)
    assert Neighbors(probe.node, Remarks(probe.node.get_logger())).crowd == crowd


def test_a_network_that_came_up_late_is_named(
    probe: Probe, meet: Meet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    routes = tmp_path / 'route'
    monkeypatch.setattr(neighbors, '_ROUTES', str(routes))
    head, wire, radio = 'Iface Destination', 'eth0 0009090A', 'wlan0 000009090A'
    routes.write_text(f'{head}\n{wire}\n')
    other = meet()
    remarks = Remarks(probe.node.get_logger())
    watched = Neighbors(probe.node, remarks)

    def has_met() -> bool:
        watched.look()
        return 'ever discovered' not in watched.unseen()

    probe.wait_until(has_met)
    assert other and watched.unseen() == ''
    routes.write_text(f'{head}\n{wire}\n{radio}\n{radio}\n')
    assert watched.unseen().startswith('; wlan0 came up after this node')
    routes.unlink()
    assert networks() == frozenset() and watched.unseen() == ''
    assert remarks.added_to(OK, '')[0] < WARN
