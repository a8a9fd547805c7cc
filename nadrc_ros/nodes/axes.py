"""Several axes in one process: their names, namespaces, and what they must share."""

from __future__ import annotations

from collections.abc import Sequence
import re
from typing import TypeVar

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.ros.arguments import IN_A_NAME, NAME
from nadrc_ros.ros.command_line import About, NodeParser
from rclpy.node import Node

T = TypeVar('T')
# What gives the namespace; of several rules the first one counts.
_NAMESPACE_RULE = re.compile('(?:controller:)?__ns:=(/.*)')
# What one timer, and one way to be triggered, leave no choice in.
_SHARED = ('pacing', 'trigger', 'use_sim_time')
_MAIN = ('plant_order', 'b0', 'controller_bandwidth', 'inner_bandwidth', 'command_max')
_ABOUT = About(
    purpose='Active disturbance rejection control of one axis, or of several in one process.',
    topics={
        'measurement': 'in: the output of the plant, from a sensor',
        'reference': 'in: the setpoint; without one the measurement at the start is held',
        'reference/rate': 'in, with reference/acceleration: its derivatives, where known',
        'command': 'out: the command to the actuator',
        '~/keep': 'in: hold to run, a lease [s] that has to be renewed while the loop is enabled',
        '~/event': 'out: events of the loop; and the estimates, on ~/...',
    },
    parameters={name: declared(ControllerSettings)[name] for name in _MAIN},
    examples=(
        'ros2 run nadrc_ros controller --ros-args -p b0:=2.0 -p rate:=500.0',
        'ros2 run nadrc_ros controller --axes x y --ros-args --params-file axes.yaml',
    ),
    options={
        '--axes NAME ...': 'one controller for each name, in a namespace of that name',
        '--managed': 'a managed node, enabled while it is active: ros2 lifecycle set /controller '
        'configure, then activate',
    },
    more=(
        'Services: ~/enable (std_srvs/SetBool) closes and opens the loop, ~/reset restarts the '
        'observers.',
        'Each axis is a node of its own, /x/controller, /y/controller, ..., with its own topics, '
        'parameters, services, diagnostics, fault policy and trace; one timer ticks all of them. '
        'In the file, a key like /robot/x/controller is for one axis, and /** for all of them. '
        'All axes have the same trigger, and with trigger: timer the same rate; with trigger: '
        'measurement, and in lockstep, each goes by its own samples. If one of them fails, all '
        'send their safe command, and the process ends.',
    ),
)


def axes_parser() -> NodeParser:
    """Return what parses the command line of controllers."""
    parser = NodeParser('controller', _ABOUT)
    parser.add_argument('--axes', nargs='+', metavar='NAME', default=[])
    parser.add_argument('--managed', action='store_true')
    return parser


def axis_spaces(arguments: Sequence[str]) -> dict[str, str]:
    """
    Return the namespaces of the axes on a command line by their names, inside the one it gives.

    There are none where one nameless axis is meant.

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
    rules = filter(None, map(_NAMESPACE_RULE.fullmatch, arguments))
    base = next((rule[1] for rule in rules), '/')
    return {name: f'{base.rstrip("/")}/{name}' for name in names}


def axis_of(kind: type[T], first: T | None, axes: Sequence[str]) -> type[T]:
    """Return the class of controllers that are ticked by the timers of the ``first`` of them."""
    return type(kind.__name__, (kind,), {'first': first, 'axes': axes})


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
