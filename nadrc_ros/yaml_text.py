"""
YAML as this package reads it: PyYAML's safe subset, stricter in one way and wider in another.

A key that appears twice in a mapping is refused (YAML forbids it, PyYAML keeps the last), and
``1e-4`` is a number (YAML 1.1 wants ``1.0e-4`` and would read a string).
"""

from __future__ import annotations

import re
from typing import Any

from nadrc_ros.adrc.errors import UserError
import yaml

_FLOAT_TAG = 'tag:yaml.org,2002:float'
_EXPONENT = re.compile(r'[-+]?(\.[0-9]+|[0-9]+\.?[0-9]*)[eE][-+]?[0-9]+$')
_LARGEST_INTEGER = 2**63 - 1


class _Loader(yaml.SafeLoader):
    """Composes a mapping only if no key appears in it twice."""

    def compose_mapping_node(self, anchor: Any) -> Any:
        node = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            line = key.start_mark.line + 1
            if key.value in lines:
                raise UserError(
                    f'line {line}: the key {key.value!r} was given before, in line '
                    f'{lines[key.value]}'
                )
            lines[key.value] = line
        return node

    def construct_yaml_int(self, node: Any) -> int:
        value: int = super().construct_yaml_int(node)
        if abs(value) > _LARGEST_INTEGER:
            raise UserError(f'line {node.start_mark.line + 1}: an integer is too large')
        return value


class _Dumper(yaml.SafeDumper):
    """Writes every value in full, without anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_yaml_int)
for _kind in (_Loader, _Dumper):
    _kind.add_implicit_resolver(_FLOAT_TAG, _EXPONENT, list('-+.0123456789'))


def read_yaml(text: str) -> Any:
    """
    Return what ``text`` says, None if it says nothing.

    Raises
    ------
    UserError
        Names line and column of what is not YAML.

    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        raise UserError(_explain(error)) from None
    except RecursionError:
        raise UserError('not YAML: it is nested too deeply') from None
    except (yaml.YAMLError, ValueError) as error:
        if isinstance(error, UserError):
            raise
        raise UserError('not YAML: ' + ' '.join(str(error).split())) from None


def alias_line(text: str) -> int | None:
    """Return the line of the first alias in a text that is YAML, None if it has none."""
    for event in yaml.parse(text):
        if isinstance(event, yaml.AliasEvent) and event.start_mark is not None:
            return event.start_mark.line + 1
    return None


def write_yaml(data: Any) -> str:
    """Return ``data`` as YAML that reads back to the same, innermost collections on one line."""
    text: str = yaml.dump(data, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=99)
    return text


def _explain(error: yaml.MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    where = f'line {mark.line + 1}, column {mark.column + 1}: ' if mark else ''
    return f'{where}not YAML: {error.problem or error.context}'
