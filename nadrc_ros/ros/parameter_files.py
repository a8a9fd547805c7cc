"""Parameter files at the start: read before ROS does, and refused if they are for another node."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
import re
from typing import Any

from nadrc_ros.adrc.errors import UserError
from rclpy.node import Node

# The nodes of this package, which may share a file.
_OURS = {'controller', 'plant', 'reference', 'recorder'}
_VALUES = 'ros__parameters'
# As the last part of a key these name no node.
_WILDCARDS = {'*', '**'}
# What one argument says of one node: `node:parameter:=value`, `node:topic:=topic`.
_FLAGS = {'-p', '--param', '-r', '--remap'}
_FOR_A_NODE = re.compile(r'([\w/]+):[^/=:][^=:]*:=')


def refuse_malformed(arguments: Sequence[str]) -> None:
    """
    Refuse a parameter file that is none, or that says something twice or in what ROS cannot read.

    ROS takes the last of two equal keys, and says of the rest only that parsing failed: also of
    aliases, and of lists in lists or of several types, in which 2 is no 2.0.

    Raises
    ------
    UserError
        Names the file, and the line where there is one.

    """
    for file in _files(arguments):
        _node_keys(file)


def refuse_unheard(
    node: Node, executable: str, arguments: Sequence[str], axes: Sequence[str] = ()
) -> None:
    """
    Refuse what is given to this process, but for a node of another name or namespace.

    ROS passes over that, and a controller would run with the default limits. A file may be for
    other nodes of ours alone: one file often serves a whole loop. What it has for ``/**`` is no
    excuse, as it may be the clock alone. Of several axes none may be left out where others are
    meant, if there is nothing for ``/**``.

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

    Raises
    ------
    UserError
        Names the file or argument, whom it is for, and how to write it.

    """
    name, full = node.get_name(), node.get_fully_qualified_name()
    for flag, rule in pairwise(arguments):
        meant = _FOR_A_NODE.match(rule) if flag in _FLAGS else None
        if meant and meant[1].rpartition('/')[2] not in {name, executable}:
            raise UserError(f'{flag} {rule}: there is no {meant[1]} here, this is {full}')
    here = [f'{space}/{name}' for space in axes] or [full]
    if full != here[0]:  # the first axis has looked for all
        return
    others = _OURS - {name, executable}
    found: list[str] = []
    for file in _files(arguments):
        keys = _node_keys(file)
        meaning_us = [key for key in keys if any(_means(key, each) for each in here)]
        found += keys
        if any(_last(key) not in _WILDCARDS for key in meaning_us):
            continue
        strange = [key for key in keys if key not in meaning_us and _last(key) not in others]
        if strange or not keys:
            raise _unheard(file, strange, full)
        if not meaning_us:
            node.get_logger().info(f'{file} has no parameters of {full}: it runs without them')
    own = [key for key in found if _last(key) == name]
    for each in here if own else []:
        if not any(_means(key, each) for key in found):
            raise _unheard(', '.join(_files(arguments)), own, each)


def _files(arguments: Sequence[str]) -> list[str]:
    return [path for flag, path in pairwise(arguments) if flag == '--params-file']


def _unheard(files: str, keys: Sequence[str], full: str) -> UserError:
    return UserError(
        f'{files}: parameters of {", ".join(keys) or "no node"} and none of {full}; for any '
        f'namespace name them /**/{_last(full)} (with {_VALUES}: {{}} if there are none)'
    )


def _node_keys(file: str) -> list[str]:
    """
    Return the nodes or patterns of a parameter file with their namespaces.

    Raises
    ------
    UserError
        What is wrong with the file.

    """
    from nadrc_ros.yaml_text import alias_line, read_yaml

    try:
        text = Path(file).read_text(encoding='utf-8')
        tree = read_yaml(text)
        if tree is None or tree == {}:
            raise UserError('there are no parameters in it, it is empty')
        keys = list(_keys(tree))
        if (line := alias_line(text)) is not None:
            raise UserError(f'line {line}: ROS knows no aliases (*name): write out what is meant')
        return keys
    except OSError as error:
        raise UserError(f'{file}: cannot be read: {error.strerror}') from None
    except UnicodeDecodeError as error:
        raise UserError(f'{file}: not UTF-8 text (byte {error.start})') from None
    except UserError as error:
        raise UserError(f'{file}: {error}') from None


def _keys(tree: Any, namespace: str = '') -> Iterator[str]:
    if not isinstance(tree, dict):
        where = namespace or 'the file'
        raise UserError(f'{where} has a value that is not below the key {_VALUES} of a node')
    for key, value in tree.items():
        if key != _VALUES:
            yield from _keys(value, f'{namespace}/{str(key).strip("/")}')
        elif isinstance(value, dict):
            _refuse_odd_lists(value)
            yield namespace
        else:
            raise UserError(f'{_VALUES} of {namespace} must be a mapping of names to values')


def _refuse_odd_lists(values: Mapping[Any, Any], above: str = '') -> None:
    for key, value in values.items():
        name = f'{above}{key}'
        if isinstance(value, dict):
            _refuse_odd_lists(value, f'{name}.')
        if not isinstance(value, list):
            continue
        kinds = {type(item) for item in value}
        if kinds == {int, float}:
            raise UserError(f'{name} = {value}: write all numbers with a decimal point')
        if len(kinds) > 1 or kinds & {list, dict, type(None)}:
            raise UserError(f'{name} = {value}: a list must have numbers, strings or flags only')


def _means(key: str, full: str) -> bool:
    """Tell whether a node is meant: * stands for one part of a name, ** for any number."""
    parts = {'*': r'/\w+', '**': r'(/\w+)*'}
    pattern = ''.join(parts.get(part, f'/{re.escape(part)}') for part in key.split('/')[1:])
    return re.fullmatch(pattern, full) is not None


def _last(name: str) -> str:
    return name.rpartition('/')[2]
