"""What the constructor of a node takes, as rclpy wants it: names and remappings, parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import re
from typing import Any

from nadrc_ros.adrc.errors import SettingError
from rclpy.parameter import Parameter

NAME = re.compile('(?!.*__)[A-Za-z_][A-Za-z0-9_]*')
IN_A_NAME = 'letters, digits and single _, and no digit first'
# As rcl reads them; what the name of a topic may be, rcl says itself.
SIDE_OF_RULE = re.compile('[^:=\\s]+')
# What rclpy itself asks of a node, half of which would be left there by its own refusal.
FLAGS = ('use_sim_time', 'start_type_description_service')


def own_rules(namespace: str, node_name: str, remappings: Mapping[str, str]) -> list[str] | None:
    """
    Return the arguments of one node, which win over those of its process; None where it has none.

    Raises
    ------
    SettingError
        For a name that is none.

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
            if not SIDE_OF_RULE.fullmatch(side):
                raise SettingError('remappings', side, 'the name of a topic or a service')
        rules.append(f'{old}:={new}')
    return ['--ros-args', *(part for rule in rules for part in ('-r', rule))] if rules else None


def overrides(parameters: Mapping[str, Any]) -> list[Parameter]:
    """
    Return values by name, which may be nested as in a file, as parameters.

    Raises
    ------
    SettingError
        For a value that no parameter can have.

    """
    made = []
    for name, value in _flat(parameters):
        try:
            parameter = Parameter(name, value=value)
        except TypeError:
            parameter = Parameter(name)
        if parameter.type_ == Parameter.Type.NOT_SET:
            raise SettingError(name, value, 'true or false, a number, a string or a list of one')
        if name in FLAGS and parameter.type_ != Parameter.Type.BOOL:
            raise SettingError(name, value, 'true or false')
        made.append(parameter)
    return made


def _flat(parameters: Mapping[str, Any], above: Sequence[str] = ()) -> Iterator[tuple[str, Any]]:
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            yield from _flat(value, (*above, str(name)))
        else:
            yield '.'.join((*above, str(name))), value
