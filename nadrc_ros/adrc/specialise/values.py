"""What the evaluator knows of a value: all of it, or the code that will give it."""

from __future__ import annotations

import ast
from typing import Any

import attrs


class Refused(Exception):
    """The source has what the evaluator does not know; the message names the line."""


@attrs.frozen
class Code:
    """A number that is not known: an expression, its kind, and whether it is positive."""

    node: ast.expr
    kind: str = 'float'
    positive: bool = False


class _Unloaded:
    """The type of :data:`UNLOADED`."""

    def __repr__(self) -> str:
        return 'UNLOADED'


# An entry that is in memory, and in no name.
UNLOADED = _Unloaded()


@attrs.define(eq=False)
class Row:
    """A vector at a ``place`` whose entries are values; without a place they are all there is."""

    name: str
    cells: list[Any]
    place: ast.expr | None
    kind: str = 'float'


@attrs.frozen(eq=False)
class Memory:
    """A vector, or with a ``width`` a matrix, that is read and written at its place each time."""

    place: ast.expr
    size: int
    width: int | None = None
    kind: str = 'float'


@attrs.frozen(eq=False)
class Record:
    """Something with fields: a design, a state, or a named tuple, which then has its ``cls``."""

    fields: dict[str, Any]
    place: ast.expr | None = None
    cls: Any = None


@attrs.define(eq=False)
class Function:
    """A function that was evaluated: its parameters with their kinds, and its statements."""

    name: str
    parameters: dict[str, Any]
    body: list[ast.stmt]
    gives: tuple[str, ...]


def load(name: str) -> ast.Name:
    """Return the code that reads a name."""
    return ast.Name(name, ast.Load())


def store(name: str) -> ast.Name:
    """Return the code that writes a name."""
    return ast.Name(name, ast.Store())


def is_load(statement: ast.stmt) -> bool:
    """Tell whether a statement only reads an entry from memory."""
    match statement:
        case ast.Assign(targets=[ast.Name()], value=ast.Subscript()):
            return True
    return False


def kind_of(value: Any) -> str:
    """Return float, int or bool."""
    return value.kind if isinstance(value, Code) else type(value).__name__


def wider(first: Any, second: Any) -> str:
    """Return the kind that holds two values."""
    kinds = {kind_of(first), kind_of(second)}
    return kinds.pop() if len(kinds) == 1 else 'float' if 'float' in kinds else 'int'


def names_in(value: Any) -> set[str]:
    """Return the names in the code of a value."""
    if not isinstance(value, Code):
        return set()
    return {node.id for node in ast.walk(value.node) if isinstance(node, ast.Name)}


def rows_of(value: Any) -> list[Row]:
    """Return all vectors of something."""
    if isinstance(value, Row):
        return [value]
    if isinstance(value, Record):
        return [row for part in value.fields.values() for row in rows_of(part)]
    if isinstance(value, (tuple, list)):
        return [row for part in value for row in rows_of(part)]
    return []


def record_of(value: Any) -> Any:
    """Return a named tuple that is known as one of which each field is."""
    if isinstance(value, tuple) and hasattr(value, '_fields'):
        fields = {name: record_of(part) for name, part in zip(value._fields, value)}
        return Record(fields, None, type(value))
    return value


def same(first: Any, second: Any) -> bool:
    """Tell whether two values are one, to the bit; False if that is not known."""
    if first is second:
        return True
    if isinstance(first, Code) and isinstance(second, Code):
        return ast.dump(first.node) == ast.dump(second.node)
    if type(first) is type(second) and isinstance(first, (bool, int, float)):
        return repr(first) == repr(second)
    if isinstance(first, tuple) and isinstance(second, tuple) and len(first) == len(second):
        return all(map(same, first, second))
    if isinstance(first, Memory) and isinstance(second, Memory):
        return ast.dump(first.place) == ast.dump(second.place)
    if isinstance(first, Record) and isinstance(second, Record) and first.cls is second.cls:
        return first.cls is not None and all(
            same(part, second.fields[name]) for name, part in first.fields.items()
        )
    return False
