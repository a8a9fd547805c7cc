"""
The law for one shape of design, to be compiled: designs and states are one array each.

Entries of one array at places that are known are what a compiler likes best: beside tuples of
arrays a step takes a tenth of the time. All shapes have the same types, so that a loop that calls
them is compiled once for all.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable
from math import prod
from typing import Any

import attrs
from nadrc_ros.adrc import deadband, delay_line, gain, internal_model, law, state, tick, transfer
from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.reference import blank_memory
from nadrc_ros.adrc.specialise.program import Program, SHAPE
from nadrc_ros.adrc.specialise.python import SCOPE, text
from nadrc_ros.adrc.specialise.values import Code, Function, load, Record
from nadrc_ros.adrc.state import blank_state, State
from nadrc_ros.simulation import period
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
# What is large is a function of its own; of what has large matrices the loops stay.
APART = frozenset(
    (deadband.mind_deadband, gain.follow_gain, delay_line.pass_through, tick._without_sample)
)
ROLLED = frozenset((law._refuse, internal_model.place_known, period.estimate_derivatives))
# What happens at a start, or after a fault, is left to plain Python: it would take longer to
# compile than all else.
LEFT = frozenset((law._restart, tick._take_over, state.start, transfer.adopt_reference))
FUNCTIONS = period.regular_period, period.period, period.realise, period.estimate_derivatives


@attrs.frozen
class Field:
    """Where a field begins in the array, and its shape: () for a number."""

    begin: int
    shape: tuple[int, ...]


# The fields that are numbers of an array, in its order.
_FIELDS: dict[type[Any], list[str]] = {
    cls: [f.name for f in attrs.fields(cls) if f.init and (cls is State or f.name not in SHAPE)]
    for cls in (Design, State)
}


def layout(thing: Design | State) -> dict[str, Field]:
    """Return where the numbers of a design or of a state are in its array."""
    fields: dict[str, Field] = {}
    end = 0
    for name in _FIELDS[type(thing)]:
        shape = np.shape(getattr(thing, name))
        fields[name] = Field(end, shape)
        end += prod(shape)
    return fields


def flat(thing: Design | State) -> Array:
    """Return the numbers of a design or of a state as one array."""
    numbers: list[float] = []
    for name in _FIELDS[type(thing)]:
        value = getattr(thing, name)
        if not isinstance(value, list):
            numbers.append(value)
        elif value and isinstance(value[0], list):
            for row in value:
                numbers += row
        else:
            numbers += value
    return np.array(numbers, dtype=np.float64)


def unflat(numbers: Array, state: State) -> None:
    """Write the numbers of a state into it."""
    values, begin = numbers.tolist(), 0
    for row in state.rows:
        row[:] = values[begin : begin + len(row)]
        begin += len(row)


def sources(
    design: Design, functions: Iterable[Any] = FUNCTIONS
) -> tuple[dict[str, str], dict[str, Any]]:
    """Return the code of functions, and of those they call, by name; and what it uses."""
    program = Program(design, (), APART, ROLLED, LEFT, _leave)
    for function in functions:
        sizes = {'told': period.SIZE, 'gives': period.SIZE, 'memory': len(blank_memory())}
        names = function.__annotations__
        program.add(function, **{name: size for name, size in sizes.items() if name in names})
    layouts = {Design: layout(design), State: layout(blank_state(design))}
    return (
        {each.name: _source(each, layouts) for each in program.functions.values()},
        SCOPE | program.called,
    )


def _leave() -> list[ast.stmt]:
    """Say that the period is not done."""
    left = ast.Subscript(load('gives'), ast.Constant(period.LEFT), ast.Store())
    return [ast.Assign([left], ast.Constant(1.0)), ast.Return(None)]


def _source(function: Function, layouts: dict[Any, dict[str, Field]]) -> str:
    """Return the code of a function, annotated with the kinds of what it is given and gives."""
    things = {
        name: layouts[value.cls]
        for name, value in function.parameters.items()
        if isinstance(value, Record) and value.cls in layouts
    }
    flattened = _Flattened(things)
    body = [flattened.visit(statement) for statement in function.body] or [ast.Pass()]
    parameters = ', '.join(
        f'{name}: {value.kind if isinstance(value, Code) else "Vector"}'
        for name, value in function.parameters.items()
    )
    gives = ''.join(f'{kind}, ' for kind in function.gives if kind != 'None')
    return '\n'.join([f'def {function.name}({parameters}) -> ({gives}):', *text(body, 1)])


class _Flattened(ast.NodeTransformer):
    """Replaces fields of things by entries of arrays."""

    def __init__(self, things: dict[str, dict[str, Field]]) -> None:
        self._things = things

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        return self._entry(node, [], node.ctx)

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        indices: list[ast.expr] = []
        inner: ast.expr = node
        while isinstance(inner, ast.Subscript):
            indices.insert(0, self.visit(inner.slice))
            inner = inner.value
        if isinstance(inner, ast.Attribute):
            return self._entry(inner, indices, node.ctx)
        return ast.Subscript(self.visit(node.value), self.visit(node.slice), node.ctx)

    def _entry(
        self, node: ast.Attribute, indices: list[ast.expr], context: ast.expr_context
    ) -> ast.expr:
        assert isinstance(node.value, ast.Name)
        field = self._things[node.value.id][node.attr]
        place: ast.expr = ast.Constant(field.begin)
        size = 1
        for length in reversed(field.shape[len(indices) :]):
            size *= length
        stride = size
        for index, length in zip(reversed(indices), reversed(field.shape[: len(indices)])):
            place = _sum(place, index, stride)
            stride *= length
        if len(indices) < len(field.shape):
            place = ast.Slice(place, _sum(place, ast.Constant(size), 1))
        return ast.Subscript(load(node.value.id), place, context)


def _sum(place: ast.expr, index: ast.expr, stride: int) -> ast.expr:
    match place, index:
        case ast.Constant(int(begin)), ast.Constant(int(number)):
            return ast.Constant(begin + number * stride)
    if stride != 1:
        index = ast.BinOp(index, ast.Mult(), ast.Constant(stride))
    return ast.BinOp(place, ast.Add(), index)
