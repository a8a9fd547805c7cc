"""Which controller a program is for: the one that was asked for, or the only one on the graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import os
import re
import time

from nadrc_ros.adrc.errors import did_you_mean, UserError
from rclpy.node import Node

# Controllers are looked for at least so long, until none was new for so long, and at most [s].
_SEARCH, _QUIET, _LONGEST = 1.5, 0.5, 5.0
# What is discovered by then needs no word [s].
SILENT = 0.6
_NODE = re.compile(r'(/[A-Za-z_]\w*)+', re.ASCII)
_SET_BOOL = 'std_srvs/srv/SetBool'
_USUAL = 'controller'


def node_names(
    controller: str, namespace: str, remark: Callable[[str], object]
) -> tuple[str, str]:
    """
    Return the namespace and the name of the controller that is meant.

    Parameters
    ----------
    controller, namespace
        As they were asked for; empty for the only controller there is.
    remark
        Called with whom this waits for, if that takes more than a second.

    Raises
    ------
    UserError
        For several controllers of which none was named, or a bad name.

    """
    name = controller or (_USUAL if namespace else _only_one(remark))
    before, _, last = full_name(name, namespace).rpartition('/')
    return before or '/', last


def full_name(name: str, namespace: str) -> str:
    """
    Return the full name of a node.

    Raises
    ------
    UserError
        For what is no name.

    """
    space = namespace.strip('/')
    full = name if name.startswith('/') else f'/{space}/{name}' if space else f'/{name}'
    if not _NODE.fullmatch(full):
        raise UserError(f'{full}: not the name of a node, such as /arm/controller')
    return full


def _only_one(remark: Callable[[str], object]) -> str:
    """Return the only controller of the graph, or a usual name if there is none yet."""
    node = Node('live_search')
    space = node.get_namespace().rstrip('/')
    found = search(node, controllers, '', remark)
    node.destroy_node()
    if space:
        return f'{space}/{_USUAL}'
    if len(found) > 1:
        raise UserError(f'there are {len(found)} controllers: say which, of {", ".join(found)}')
    return found[0] if found else f'/{_USUAL}'


def search(
    node: Node,
    there: Callable[[Node], list[str]],
    wanted: str,
    remark: Callable[[str], object],
    *,
    silent: float = SILENT,
    longest: float = _LONGEST,
) -> list[str]:
    """
    Return which controllers are ``there``, once the ``wanted`` one is, or no other comes.

    After ``silent`` [s] ``remark`` is called with whom this waits for, for at most ``longest``.
    """
    usual = f'{node.get_namespace().rstrip("/")}/{_USUAL}'
    now = begin = since = time.monotonic()
    found = there(node)
    while now - begin < longest:
        settled = found and now - begin > _SEARCH and now - since > _QUIET
        if wanted in found or (settled and not wanted):
            break
        if (wanted or not found) and now - begin > silent:
            remark(absence(found, wanted or usual))
        time.sleep(0.05)  # the middleware finds them by itself
        before, found, now = found, there(node), time.monotonic()
        since = now if found != before else since
    return found


def once(remark: Callable[[str], object]) -> Callable[[str], None]:
    """Give what remarks nothing twice, and no end of a wait that was no news."""
    last = ''

    def changed(text: str) -> None:
        nonlocal last
        if text != last and (last or text.startswith('waiting')):
            remark(text)
            last = text

    return changed


def controllers(node: Node) -> list[str]:
    """Return the full names of the controllers of this package on the graph."""
    services = node.get_service_names_and_types()
    enabled = [
        name.removesuffix('/enable')
        for name, types in services
        if name.endswith('/enable') and _SET_BOOL in types
    ]
    return sorted(name for name in enabled if node.count_publishers(f'{name}/output_estimate'))


def absence(there: Sequence[str], name: str) -> str:
    """Say that a controller is waited for, and which ones are there instead."""
    if name in there:
        return f'waiting for the parameters of {name}'
    if there:
        return f'waiting for {name}, which is not there: {did_you_mean(name, there)}'
    domain = os.environ.get('ROS_DOMAIN_ID') or 0
    return f'waiting for {name}: no controller is running in ROS domain {domain}'
