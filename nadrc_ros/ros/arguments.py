"""What a node is told by who starts it: on the command line, in files, in its constructor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
import re
from typing import Any

from nadrc_ros.adrc.errors import near_to, SettingError, UserError
from nadrc_ros.parameter_file import flat, means, parameters_in, VALUES
from rclpy.node import Node
from rclpy.parameter import Parameter

NAME = re.compile('(?!.*__)[A-Za-z_][A-Za-z0-9_]*')
IN_A_NAME = 'letters, digits and single _, and no digit first'
# As rcl reads them; what the name of a topic may be, rcl says itself.
_SIDE_OF_RULE = re.compile('[^:=\\s]+')
_REMAP = {'-r', '--remap'}
# What one remaps for all nodes of a machine at once, whether or not they have it.
_COMMON = {
    *('reference', 'reference/rate', 'reference/acceleration', 'measurement', 'command'),
    'b0_variable',
    *('clock', 'diagnostics', 'parameter_events', 'rosout', 'tf', 'tf_static'),
}
_ALIKE = 0.75
# What rclpy itself asks of a node, half of which would be left there by its own refusal.
_FLAGS = ('use_sim_time', 'start_type_description_service')
# The nodes of this package, which may share a file.
_OURS = {'controller', 'plant', 'reference', 'recorder'}
# As the last part of a key these name no node.
_WILDCARDS = {'*', '**'}
# What one argument says of one node: `node:parameter:=value`, `node:topic:=topic`.
_RULE_FLAGS = {'-p', '--param', *_REMAP}
_FOR_A_NODE = re.compile(r'([\w/]+):[^/=:][^=:]*:=')


def own_rules(namespace: str, node_name: str, remappings: Mapping[str, str]) -> list[str] | None:
    """
    Return the arguments of one node, which win over those of its process; None where it has none.

    A name that is none is refused by a :class:`SettingError`.
    """
    rules = []
    if namespace:
        parts = namespace.removeprefix('/').split('/')
        if namespace != '/' and not all(map(NAME.fullmatch, parts)):
            allowed = f'names with / between them, each of {IN_A_NAME}'
            raise SettingError('namespace', namespace, allowed)
        rules.append(f'__ns:=/{namespace.removeprefix("/")}')
    if node_name:
        if not NAME.fullmatch(node_name):
            raise SettingError('node_name', node_name, IN_A_NAME)
        rules.append(f'__node:={node_name}')
    for old, new in remappings.items():
        for side in (old, new):
            if not _SIDE_OF_RULE.fullmatch(side):
                raise SettingError('remappings', side, 'the name of a topic or a service')
        rules.append(f'{old}:={new}')
    return ['--ros-args', *(part for rule in rules for part in ('-r', rule))] if rules else None


def rules_of(arguments: Sequence[str]) -> list[str]:
    """Return the remappings on a command line."""
    return [rule for flag, rule in pairwise(arguments) if flag in _REMAP and ':=' in rule]


def tell_unused(nodes: Sequence[Node], rules: Iterable[str]) -> None:
    """Log which remappings of topics and services concern no node: misspelt ones."""
    told: set[str] = set()
    for rule in rules:
        left, _, new = rule.partition(':=')
        old = left.rpartition(':')[2].removeprefix('//')  # without a node or a kind before it
        if old.startswith('__') or old.lstrip('/') in _COMMON or old in told:
            continue
        told.add(old)  # of two rules for one name the first one counts
        if any(node.resolve_topic_name(new, only_expand=True) in _names(node) for node in nodes):
            continue
        known = {form for node in nodes for name in _names(node) for form in _forms(node, name)}
        near = near_to(old, sorted(known), _ALIKE)
        log, who = nodes[0].get_logger(), ', '.join(n.get_fully_qualified_name() for n in nodes)
        text = f'-r {rule}: no topic or service of {who} is called {old}'
        if near:
            log.warning(f'{text}: did you mean {near}?')
        else:
            log.info(text)


def _names(node: Node) -> set[str]:
    """Return the topics and services of a node, as they are called on the graph."""
    topics = {each.topic_name for each in (*node.publishers, *node.subscriptions)}
    services = {each.srv_name for each in (*node.services, *node.clients)}  # as they were made
    return topics | set(map(node.resolve_service_name, services))


def _forms(node: Node, name: str) -> list[str]:
    """Return how one may write a full name for a node."""
    space, own = node.get_namespace().rstrip('/'), node.get_fully_qualified_name()
    short = [name.removeprefix(space + '/')] if name.startswith(space + '/') else []
    return [name, *short, *(['~' + name.removeprefix(own)] if name.startswith(own + '/') else [])]


def overrides(parameters: Mapping[str, Any]) -> list[Parameter]:
    """
    Return values by name, which may be nested as in a file, as parameters.

    A value that no parameter can have is refused by a :class:`SettingError`.
    """
    made = []
    for name, value in flat(parameters):
        try:
            parameter = Parameter(name, value=value)
        except TypeError:
            parameter = Parameter(name)
        if parameter.type_ == Parameter.Type.NOT_SET:
            raise SettingError(name, value, 'true or false, a number, a string or a list of one')
        if name in _FLAGS and parameter.type_ != Parameter.Type.BOOL:
            raise SettingError(name, value, 'true or false')
        made.append(parameter)
    return made


def refuse_malformed(arguments: Sequence[str]) -> None:
    """
    Refuse a parameter file that is none, or that says something twice or in what ROS cannot read.

    ROS takes the last of two equal keys, and says of the rest only that parsing failed: also of
    aliases, and of lists in lists or of several types, in which 2 is no 2.0. The
    :class:`UserError` names the file, and the line where there is one.
    """
    for file in _files(arguments):
        parameters_in(file)


def refuse_unheard(
    node: Node, executable: str, arguments: Sequence[str], axes: Sequence[str] = ()
) -> None:
    """
    Refuse what is given to this process, but for a node of another name or namespace.

    ROS passes over that, and a controller would run with the default limits. A file may be for
    other nodes of ours alone: one file often serves a whole loop. What it has for ``/**`` is no
    excuse, as it may be the clock alone. Of several axes none may be left out where others are
    meant, if there is nothing for ``/**``. The :class:`UserError` names the file or argument, whom
    it is for, and how to write it.

    Parameters
    ----------
    node
        Any of the process: their names differ in the namespace only.
    executable
        What the node is called unless it was renamed.
    arguments
        The command line.
    axes
        The namespaces of all nodes of the process, where there may be several.

    """
    name, full = node.get_name(), node.get_fully_qualified_name()
    for flag, rule in pairwise(arguments):
        meant = _FOR_A_NODE.match(rule) if flag in _RULE_FLAGS else None
        if meant and meant[1].rpartition('/')[2] not in {name, executable}:
            raise UserError(f'{flag} {rule}: there is no {meant[1]} here, this is {full}')
    here = [f'{space}/{name}' for space in axes] or [full]
    others = _OURS - {name, executable}
    found: list[str] = []
    for file in _files(arguments):
        keys = list(parameters_in(file))
        if full != here[0]:  # the first axis has looked for all
            found += keys
            continue
        meaning_us = [key for key in keys if any(means(key, each) for each in here)]
        found += keys
        if any(_last(key) not in _WILDCARDS for key in meaning_us):
            continue
        strange = [key for key in keys if key not in meaning_us and _last(key) not in others]
        if strange or not keys:
            raise _unheard(file, strange, full)
        if not meaning_us:
            node.get_logger().info(f'{file} has no parameters of {full}: it runs without them')
    own = [key for key in found if _last(key) == name]
    if own and not any(means(key, full) for key in found):
        near = near_to(full, own, _ALIKE) if len(here) > 1 else ''
        raise _unheard(', '.join(_files(arguments)), own, full, near)


def _files(arguments: Sequence[str]) -> list[str]:
    return [path for flag, path in pairwise(arguments) if flag == '--params-file']


def _unheard(files: str, keys: Sequence[str], full: str, near: str = '') -> UserError:
    question = f' (did you mean {near}?)' if near else ''
    return UserError(
        f'{files}: parameters of {", ".join(keys) or "no node"} and none of {full}{question}; for '
        f'any namespace name them /**/{_last(full)} (with {VALUES}: {{}} if there are none)'
    )


def _last(name: str) -> str:
    return name.rpartition('/')[2]
