"""How controllers are wired into the graph: what starts a step, what is sent, several axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
import re

import attrs
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import choice, flag, integer, text
from nadrc_ros.records.recording import ESTIMATES
from nadrc_ros.ros.arguments import IN_A_NAME, NAME, NodeParser
from nadrc_ros.ros.topics import Sender
from rclpy.node import Node

# What gives the namespace; of several rules the first one counts.
_NAMESPACE_RULE = re.compile('(?:controller:)?__ns:=(/.*)')
# What one timer, and one way to be triggered, leave no choice in.
_SHARED = ('pacing', 'trigger', 'use_sim_time')
_TOPICS = tuple(f'~/{topic}' for topic in ESTIMATES.values())
_DESCRIPTION = 'ADRC of one axis, or of several in one process.'
_EXAMPLES = """
  ros2 run nadrc_ros controller --ros-args -p b0:=2.0
  ros2 run nadrc_ros controller --axes x y z --ros-args -r __ns:=/robot --params-file axes.yaml

Each axis is a node of its own, /x/controller, /y/controller, ..., with its own topics,
parameters, services, diagnostics, fault policy and trace; one timer ticks all of them.
In the file, a key like /robot/x/controller is for one axis, and /** for all of them.
All axes have the same trigger, and with trigger: timer the same rate; with trigger:
measurement, and in lockstep, each goes by its own samples. If one of them fails, all
send their safe command, and the process ends.
"""


@attrs.frozen(kw_only=True)
class LoopSettings:
    """How the controller is wired into the graph; fixed at start."""

    trigger: str = choice(
        'timer',
        ('timer', 'measurement'),
        'what starts a step: a fixed-rate timer, or each received measurement',
        live=False,
    )
    enabled_at_start: bool = flag(True, 'whether the loop is closed from the start', live=False)
    share_command: bool = flag(
        False,
        'whether to command beside another node; if not, who hears another before its first '
        'command, or up to 5 s later and has sent fewer, is disabled',
        live=False,
    )
    estimate_divisor: int = integer(
        1,
        1,
        10000,
        'estimates are published with every N-th command; lockstep publishes all',
        live=False,
    )
    trace: str = text(
        '', 'new file for one record per step, from which the run can be replayed', live=False
    )


class Estimates:
    """
    Publishes the estimates that somebody reads, or in lockstep ``always`` all of them.

    There is a topic for each of so many ``levels``; a retune may add some, and none goes away.
    """

    def __init__(self, make_sender: Callable[[str], Sender], levels: int, *, always: bool) -> None:
        self._make_sender = make_sender
        self._always = always
        self._senders: list[Sender] = []
        self._read: list[int] = []
        self._add(levels)

    def look(self) -> None:
        """Find out which topics have readers: asked at every step, it would double its time."""
        self._read = [i for i, s in enumerate(self._senders) if self._always or s.has_readers]

    def send(self, controller: Controller) -> None:
        """Publish the estimates of the last step."""
        levels = controller.design.levels
        if len(self._senders) < len(_TOPICS) + levels:
            self._add(levels)
        if not self._read:
            return
        values = [controller.tracking, controller.output_estimate, controller.total_disturbance]
        values += controller.disturbances
        for i in self._read:
            if i < len(values) and isfinite(values[i]):
                self._senders[i].send(values[i])

    def _add(self, levels: int) -> None:
        topics = [*_TOPICS, *(f'~/level_{k + 1}/disturbance' for k in range(levels))]
        self._senders += [self._make_sender(topic) for topic in topics[len(self._senders) :]]
        self.look()


def axes_parser() -> NodeParser:
    """Return what parses the command line of controllers."""
    parser = NodeParser('controller', _DESCRIPTION, _EXAMPLES)
    parser.add_argument(
        '--axes', nargs='+', metavar='NAME', default=[], help='one controller for each name'
    )
    return parser


def axes_asked(arguments: Sequence[str]) -> list[str]:
    """
    Return the names of the axes on a command line, none where one nameless axis is meant.

    Raises
    ------
    UserError
        For a name that is no name, or is there twice.

    """
    names: list[str] = axes_parser().parse(arguments).axes
    for name in names:
        if not NAME.fullmatch(name):
            raise UserError(f'the axis {name!r} has no name to make a namespace of: {IN_A_NAME}')
        if names.count(name) > 1:
            raise UserError(f'the axis {name!r} is there twice')
    return names


def axis_namespace(name: str, arguments: Sequence[str]) -> str:
    """Return the namespace of an axis, inside the one that the command line gives."""
    rules = filter(None, map(_NAMESPACE_RULE.fullmatch, arguments))
    base = next((rule[1] for rule in rules), '/')
    return f'{base.rstrip("/")}/{name}'


def refuse_unequal(first: Node, other: Node) -> None:
    """
    Refuse an axis that cannot share a timer with the first one.

    Raises
    ------
    UserError
        Names both of them, and what differs.

    """
    timed = first.get_parameter('trigger').value == 'timer'
    for name in (*_SHARED, 'rate') if timed else _SHARED:
        values = [node.get_parameter(name).value for node in (first, other)]
        if values[0] != values[1]:
            nodes = [node.get_fully_qualified_name() for node in (first, other)]
            raise UserError(
                f'{name} is {values[0]} for {nodes[0]} and {values[1]} for {nodes[1]}: '
                'the axes of one process share it'
            )
