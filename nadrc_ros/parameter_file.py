"""What is in a file of ROS parameters, read without ROS."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
import re
from typing import Any

from nadrc_ros.adrc.errors import UserError

# Below this key a file has the parameters of a node.
VALUES = 'ros__parameters'


def parameters_in(file: str) -> dict[str, dict[str, Any]]:
    """
    Return the parameters of each node or pattern in a file, by their dotted names.

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
        nodes = {key: dict(flat(values)) for key, values in _nodes(tree)}
        if (line := alias_line(text)) is not None:
            raise UserError(f'line {line}: ROS knows no aliases (*name): write out what is meant')
        return nodes
    except OSError as error:
        raise UserError(f'{file}: cannot be read: {error.strerror}') from None
    except UnicodeDecodeError as error:
        raise UserError(f'{file}: not UTF-8 text (byte {error.start})') from None
    except UserError as error:
        raise UserError(f'{file}: {error}') from None


def in_force(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return what holds for each node that is named, and for patterns that mean none of these."""
    patterns = [key for key in parameters if '*' in key]
    named = [key for key in parameters if key not in patterns]
    found: dict[str, dict[str, Any]] = {key: {} for key in named}
    for pattern in patterns:
        meant = [key for key in named if means(pattern, key)]
        for key in meant or [pattern]:
            found.setdefault(key, {}).update(parameters[pattern])
    for key in named:
        found[key].update(parameters[key])
    return found


def flat(parameters: Mapping[str, Any], above: Sequence[str] = ()) -> Iterator[tuple[str, Any]]:
    """Yield values, which may be nested, by their dotted names."""
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            yield from flat(value, (*above, str(name)))
        else:
            yield '.'.join((*above, str(name))), value


def means(key: str, full: str) -> bool:
    """Tell whether a node is meant: * stands for one part of a name, ** for any number."""
    parts = {'*': r'/\w+', '**': r'(/\w+)*'}
    pattern = ''.join(parts.get(part, f'/{re.escape(part)}') for part in key.split('/')[1:])
    return re.fullmatch(pattern, full) is not None


def _nodes(tree: Any, namespace: str = '') -> Iterator[tuple[str, Mapping[Any, Any]]]:
    if not isinstance(tree, dict):
        where = namespace or 'the file'
        raise UserError(f'{where} has a value that is not below the key {VALUES} of a node')
    for key, value in tree.items():
        if key != VALUES:
            yield from _nodes(value, f'{namespace}/{str(key).strip("/")}')
        elif isinstance(value, dict):
            _refuse_odd_lists(value)
            yield namespace, value
        else:
            raise UserError(f'{VALUES} of {namespace} must be a mapping of names to values')


def _refuse_odd_lists(values: Mapping[Any, Any], above: str = '') -> None:
    for key, value in values.items():
        name = f'{above}{key}'
        if isinstance(value, dict):
            _refuse_odd_lists(value, f'{name}.')
        if not isinstance(value, list):
            continue
        kinds = {type(item) for item in value}
        if kinds == {int, float}:
            raise UserError(f'{name} = {value}: write {[float(item) for item in value]}')
        if len(kinds) > 1 or kinds & {list, dict, type(None)}:
            raise UserError(f'{name} = {value}: a list must have numbers, strings or flags only')
