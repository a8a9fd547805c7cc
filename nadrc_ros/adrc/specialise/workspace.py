"""What is written so far, and what is known at the end of it: of names, and of entries."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from math import isfinite, isnan
from typing import Any

import attrs
from nadrc_ros.adrc.specialise.values import (
    Code,
    kind_of,
    load,
    Memory,
    Record,
    Refused,
    Row,
    same,
    store,
    UNLOADED,
    wider,
)

# In the values of a call: what it returned.
RETURNED = '<returned>'
Statements = list[ast.stmt]


@attrs.define
class Scope:
    """The names of one call, and what they are."""

    function: Any
    values: dict[str, Any]
    outermost: bool = False


@attrs.frozen
class Known:
    """What is known at one point of the code."""

    values: dict[str, Any]
    cells: list[list[Any]]


class Workspace:
    """
    The code that is being written, :attr:`body`, and what is known after it.

    A name of the code is one number for ever: what is assigned anew gets another one. The names
    alone that a loop goes on with are written again, at its end. An entry of a vector that was
    read or written has a name too. It is written to memory at once: so memory is always right, and
    where two branches differ it is read anew.
    """

    scope: Scope

    def __init__(self, parameters: Iterable[str]) -> None:
        self.body: Statements = []
        self.line: tuple[str, int] = '', 0
        self.called: dict[str, Any] = {}
        self.rows: list[Row] = []
        self._taken = set(parameters)

    def row(self, name: str, size: int, place: ast.expr | None, kind: str = 'float') -> Row:
        """Return a vector of which nothing is known, of zeros where it has no place."""
        row = Row(name, [0.0 if place is None else UNLOADED] * size, place, kind)
        self.rows.append(row)
        return row

    def refused(self, what: str) -> Refused:
        """Return the error that names the line."""
        return Refused(f'{self.line[0]}:{self.line[1]}: cannot be specialized: {what}')

    # ---- writing

    def emit(self, statement: ast.stmt) -> None:
        """Write a statement."""
        self.body.append(self.sourced(statement))

    def sourced(self, statement: ast.stmt) -> ast.stmt:
        """Note from which line of the source a statement is."""
        statement.source = self.line  # type: ignore[attr-defined]
        return statement

    def fresh(self, name: str) -> str:
        """Return a name that nothing has yet."""
        name = name.strip('_') or 'unused'
        free, number = name, 2
        while free in self._taken:
            free = f'{name}_{number}'
            number += 1
        self._taken.add(free)
        return free

    def named(self, name: str, value: Any, kind: str | None = None) -> Code:
        """Write a number into a new name."""
        free = self.fresh(name)
        self.emit(ast.Assign([store(free)], self.expression(value)))
        return Code(load(free), kind or kind_of(value))

    def kept(self, name: str, value: Any) -> Any:
        """Return a value that is not worked out anew each time it is used."""
        if isinstance(value, tuple):
            return tuple(self.kept(name, part) for part in value)
        at_hand = ast.Name, ast.Attribute, ast.Constant
        if isinstance(value, Code) and not isinstance(value.node, at_hand):
            return self.named(name, value)
        return value

    def read_now(self, value: Any) -> Any:
        """Return a value that what is written to memory from now on does not change."""
        if isinstance(value, tuple):
            return tuple(map(self.read_now, value))
        nodes = ast.walk(value.node) if isinstance(value, Code) else ()
        reads = any(isinstance(node, ast.Subscript) for node in nodes)
        return self.named('before', value) if reads else value

    def write(self, vector: Any, index: Any, value: Any) -> None:
        """Write an entry of a vector."""
        if isinstance(vector, Memory):
            place = ast.Subscript(vector.place, self.expression(index), ast.Store())
            self.emit(ast.Assign([place], self.expression(value)))
            return
        if not isinstance(vector, Row) or isinstance(index, Code):
            raise self.refused('what is written to is not known')
        targets: list[ast.expr] = []
        if vector.place is not None:
            targets.append(ast.Subscript(vector.place, ast.Constant(index), ast.Store()))
        if isinstance(value, Code):
            name = self.fresh(f'{vector.name}_{index}')
            self.emit(ast.Assign([store(name), *targets], value.node))
            value = Code(load(name), vector.kind)
        elif targets:
            value = float(value) if vector.kind == 'float' else value
            self.emit(ast.Assign(targets, self.expression(value)))
        vector.cells[index] = value

    def read(self, row: Row, index: int) -> Any:
        """Return an entry of a vector, read from memory if it must be."""
        value = row.cells[index]
        if value is UNLOADED:
            assert row.place is not None
            place = ast.Subscript(row.place, ast.Constant(index), ast.Load())
            value = self.named(f'{row.name}_{index}', Code(place, row.kind))
            row.cells[index] = value
        return value

    def expression(self, value: Any) -> ast.expr:
        """Return the code of a value."""
        match value:
            case Code():
                return value.node
            case bool() | int() | None:
                return ast.Constant(value)
            case float():
                if isfinite(value):
                    return ast.Constant(value)
                if isnan(value):
                    return load('nan')
                return load('inf') if value > 0.0 else ast.UnaryOp(ast.USub(), load('inf'))
            case tuple():
                return ast.Tuple([self.expression(each) for each in value], ast.Load())
            case Record() | Row() | Memory() if value.place is not None:
                return value.place
            case Record() if value.cls is not None:
                self.called[value.cls.__name__] = value.cls
                parts = [self.expression(each) for each in value.fields.values()]
                return ast.Call(load(value.cls.__name__), parts, [])
        raise self.refused(f'{value!r} cannot be handed on')

    # ---- what is known

    def known(self) -> Known:
        """Return what is known now."""
        return Known(dict(self.scope.values), [list(row.cells) for row in self.rows])

    def forget(self, known: Known) -> None:
        """Know what was known then."""
        self.scope.values = dict(known.values)
        for row, cells in zip(self.rows, known.cells):
            row.cells = list(cells)

    def merge(self, after: Known, then: Statements, other: Statements) -> None:
        """
        Know what is the same after two branches, and give a name to a number that is not.

        ``after`` is what is known at the end of the branch ``then``; now is the end of ``other``.
        """
        values = self.scope.values
        for name in list(values):
            if name not in after.values:
                del values[name]
                continue
            known = name
            if name == RETURNED:
                known = self.scope.function.__name__.strip('_') + '_gives'
            try:
                values[name] = self.join(known, after.values[name], values[name], then, other)
            except Refused:  # an error only if it is looked up
                del values[name]
        for row, cells in zip(self.rows, after.cells):
            for i, (cell, now) in enumerate(zip(cells, row.cells)):
                if same(cell, now):
                    continue
                row.cells[i] = UNLOADED
                if row.place is None:
                    row.cells[i] = self.join(f'{row.name}_{i}', cell, now, then, other)

    def join(self, name: str, first: Any, second: Any, then: Statements, other: Statements) -> Any:
        """Return what is one value after the branch ``then``, and another after ``other``."""
        if same(first, second):
            return first
        if isinstance(first, tuple) and isinstance(second, tuple) and len(first) == len(second):
            pairs = enumerate(zip(first, second))
            return tuple(self.join(f'{name}_{i}', a, b, then, other) for i, (a, b) in pairs)
        if isinstance(first, Record) and isinstance(second, Record) and first.cls is second.cls:
            fields = {
                field: self.join(f'{name}_{field}', part, second.fields[field], then, other)
                for field, part in first.fields.items()
            }
            return Record(fields, None, first.cls)
        if isinstance(first, Memory) and isinstance(second, Memory):
            match first.place, second.place:  # two rows of one matrix
                case ast.Subscript(matrix, index), ast.Subscript(its, its_index):
                    if ast.dump(matrix) == ast.dump(its):
                        indices = Code(index, 'int'), Code(its_index, 'int')
                        joined = self.join(f'{name}_at', *indices, then, other)
                        place = ast.Subscript(matrix, joined.node, ast.Load())
                        return attrs.evolve(first, place=place)
        if isinstance(first, Row) and isinstance(second, Row) and first.place and second.place:
            row = Row(name, [], None, first.kind)
            for i in range(len(first.cells)):
                one = Code(ast.Subscript(first.place, ast.Constant(i), ast.Load()), row.kind)
                two = Code(ast.Subscript(second.place, ast.Constant(i), ast.Load()), row.kind)
                row.cells.append(self.join(f'{name}_{i}', one, two, then, other))
            return row
        numbers = (Code, bool, int, float)
        if not (isinstance(first, numbers) and isinstance(second, numbers)):
            raise self.refused(f'{name} is one thing in one branch and another in the other')
        kind, target = wider(first, second), self.fresh(name)
        for branch, value in ((then, first), (other, second)):
            assignment = ast.Assign([store(target)], self.expression(value))
            branch.append(self.sourced(assignment))
        return Code(load(target), kind)
