"""Which controller is commissioned: the one that was asked for, or the only one on the graph."""

from __future__ import annotations

from collections.abc import Callable

from nadrc_ros.adrc.errors import did_you_mean, UserError
from nadrc_ros.live.search import full_name, once, search, SILENT
from nadrc_ros.nodes.commission import START
from rclpy.node import Node

_START = START.removeprefix('~')
# One that has a name, or was just started, is looked for so long, and not missed for so long [s].
_LONGEST, _STARTING = 10.0, 3.0


def _commissionable(node: Node) -> list[str]:
    """Return the full names of the controllers that run experiments."""
    services = [name for name, _ in node.get_service_names_and_types()]
    return sorted(name.removesuffix(_START) for name in services if name.endswith(_START))


def find_controller(
    node: Node, wanted: str, remark: Callable[[str], object], started: bool
) -> str:
    """
    Return the full name of the controller that is meant, of '' the only one there is.

    ``remark`` is called with whom this waits for, later where it was ``started`` just now.

    Raises
    ------
    UserError
        When it is not there, or when there is more than one.

    """
    wanted = wanted and full_name(wanted, node.get_namespace())
    waits = {'silent': _STARTING if started else SILENT}
    waits |= {'longest': _LONGEST} if wanted or started else {}
    remark = once(remark)
    there = search(node, _commissionable, wanted, remark, **waits)
    if wanted and wanted not in there:
        known = f': {did_you_mean(wanted, there)}' if there else ''
        raise UserError(f'{wanted} is no running controller of this package{known}')
    if not there:
        raise UserError(
            'no controller runs that could be commissioned: start one with -p '
            'enabled_at_start:=false, in this ROS_DOMAIN_ID, or give its --params file'
        )
    if not wanted and len(there) > 1:
        raise UserError(f'several controllers run: --controller {" or ".join(there)}')
    found = wanted or there[0]
    remark(f'{found} is there')
    return found
