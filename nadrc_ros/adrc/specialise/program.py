"""The functions of the law that are evaluated, and what they are given."""

from __future__ import annotations

import ast
from collections.abc import Collection, Sequence
import inspect
from typing import Any

import attrs
from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.specialise.evaluator import Evaluator, Leave
from nadrc_ros.adrc.specialise.expressions import gives_of, signature
from nadrc_ros.adrc.specialise.tidy import tidied
from nadrc_ros.adrc.specialise.values import (
    Code,
    Function,
    load,
    Memory,
    Record,
    Row,
    store,
    UNLOADED,
)
from nadrc_ros.adrc.state import blank_state, State
from nadrc_ros.adrc.supervisor import PolicyState, Stall

# What of a design the code depends on; all else are numbers that it is given.
SHAPE = frozenset(
    (
        *('order', 'states', 'levels', 'cancelled', 'chained', 'nonlinear', 'shaped'),
        *('equal_poles', 'special', 'known', 'error_based', 'linear', 'feedback_level'),
        *('gain_source', 'stall_stops', 'reach', 'sizes', 'no_reference'),
    )
)
# Features that are off at 0, and leave no code then.
SWITCHES = frozenset(
    (
        *('tracking_acceleration', 'input_delay', 'measurement_period', 'error_deadband'),
        *('command_rate_limit', 'feed_forward_timeout'),
    )
)
_NAMES = tuple(field.name for field in attrs.fields(Design) if field.init)
# Vectors that are looked up at places which are known at run time only.
_LOOKED_UP = frozenset(('delay_line', 'fed_line', 'b0_table'))


def shape_of(design: Design) -> tuple[Any, ...]:
    """Return what of a design the code depends on."""
    shape: list[Any] = []
    for name in _NAMES:
        value = getattr(design, name)
        if name in SHAPE:
            shape.append(tuple(value) if isinstance(value, list) else value)
        elif isinstance(value, list):
            shape.append(len(value))
        elif name in SWITCHES:
            shape.append(value > 0.0)
    return tuple(shape)


class Program:
    """
    Functions of the law, evaluated for the shape of a design.

    ``original`` are called as they are, ``apart`` become functions of their own; those that are
    ``rolled`` do so too, and keep their loops. The code ends with the statements ``leave`` where
    it would call what is ``left`` to others.
    """

    def __init__(
        self,
        design: Design,
        original: Collection[Any] = (),
        apart: Collection[Any] = (),
        rolled: Collection[Any] = (),
        left: Collection[Any] = (),
        leave: Leave = list,
    ) -> None:
        self.design = design
        self.functions: dict[Any, Function] = {}
        self.called: dict[str, Any] = {}
        self._original = original
        self._apart = apart
        self._rolled = rolled
        self._left = left
        self._leave = leave

    def add(self, function: Any, **sizes: int) -> Function:
        """
        Evaluate a function of a design, of states, of vectors and of numbers that are not known.

        A vector has as many entries as a reference, n + 1, where no other size is given.
        """
        given = {
            name: Row(name, [UNLOADED] * sizes[name], load(name)) if name in sizes else None
            for name in signature(function).parameters
        }
        made = self._evaluate(function, given, function.__name__)
        self.functions[function,] = made
        return made

    def _called_apart(self, function: Any, bound: dict[str, Any]) -> str | None:
        if function in self._original:
            self.called[function.__name__] = function
            return str(function.__name__)
        if function not in self._apart and function not in self._rolled:
            return None
        key = function, *(_size(value) for value in bound.values())
        if key not in self.functions:
            number = sum(1 for each in self.functions if each[0] is function)
            name = function.__name__.strip('_') + (f'_{number + 1}' if number else '')
            self.functions[key] = self._evaluate(function, bound, name)
        return self.functions[key].name

    def _evaluate(self, function: Any, bound: dict[str, Any], name: str) -> Function:
        rolled = function in self._rolled
        evaluator = self._evaluator(bound, rolled)
        arguments = []
        for each in signature(function).parameters.values():
            arguments.append(self._argument(evaluator, each, bound.get(each.name), rolled))
        body = tidied(evaluator.run(function, arguments))
        self.called |= evaluator.called
        return Function(name, dict(zip(bound, arguments)), body, gives_of(function))

    def _evaluator(self, parameters: Collection[str], rolled: bool) -> Evaluator:
        return Evaluator(parameters, self._called_apart, self._left, self._leave, rolled)

    def _argument(
        self, evaluator: Evaluator, parameter: inspect.Parameter, given: Any, rolled: bool
    ) -> Any:
        place = load(parameter.name)
        if isinstance(given, Row) and not rolled:
            return evaluator.row(parameter.name, len(given.cells), place, given.kind)
        if isinstance(given, Row):
            return Memory(place, len(given.cells), None, given.kind)
        if isinstance(given, Memory):
            return attrs.evolve(given, place=place)
        match parameter.annotation:
            case 'Design':
                return symbolic_design(evaluator, self.design, place, rolled)
            case 'State':
                return symbolic_state(evaluator, self.design, place, rolled)
            case 'Vector':
                return evaluator.row(parameter.name, self.design.order + 1, place)
            case 'Sample':
                return symbolic_tuple(evaluator, Sample, place)
            case 'PolicyState':
                return symbolic_tuple(evaluator, PolicyState, place)
        return Code(place, str(parameter.annotation))


def _size(value: Any) -> int | None:
    """Return the size of a vector: for each a function is another one."""
    if isinstance(value, Row):
        return len(value.cells)
    return value.size if isinstance(value, Memory) else None


def symbolic_design(
    evaluator: Evaluator, design: Design, place: ast.Name, rolled: bool = False
) -> Record:
    """Return a design of this shape whose numbers are not known."""
    fields: dict[str, Any] = {}
    for field in attrs.fields(Design):
        if not field.init:
            continue
        name, value = field.name, getattr(design, field.name)
        own = ast.Attribute(place, name, ast.Load())
        if name in SHAPE:
            fields[name] = tuple(value) if isinstance(value, list) else value
        elif isinstance(value, list):
            fields[name] = _vector(evaluator, name, value, own, rolled)
        elif name in SWITCHES:
            fields[name] = Code(own, 'float', True) if value > 0.0 else 0.0
        else:
            fields[name] = Code(own, type(value).__name__)
    return Record(fields, place, Design)


def symbolic_state(
    evaluator: Evaluator, design: Design, place: ast.Name, rolled: bool = False
) -> Record:
    """Return a state of this shape."""
    blank = blank_state(design)
    fields = {}
    for field in attrs.fields(State):
        if not field.init:
            continue
        own = ast.Attribute(place, field.name, ast.Load())
        value = getattr(blank, field.name)
        fields[field.name] = _vector(evaluator, field.name, value, own, rolled)
    return Record(fields, place, State)


def _vector(
    evaluator: Evaluator, name: str, value: list[Any], place: ast.Attribute, rolled: bool
) -> Any:
    """Return a vector, or a matrix as the vectors that its rows are."""
    matrix = bool(value) and isinstance(value[0], list)
    if rolled or name in _LOOKED_UP:
        return Memory(place, len(value), len(value[0]) if matrix else None)
    assert isinstance(place.value, ast.Name)
    name = f'{place.value.id}_{name}'
    return (
        matrix_of(evaluator, name, value, place)
        if matrix
        else evaluator.row(name, len(value), place)
    )


def matrix_of(
    evaluator: Evaluator, name: str, matrix: Sequence[Any], place: ast.expr | None
) -> tuple[Row, ...]:
    """Return the vectors that the rows of a matrix are, which may have no place."""
    return tuple(
        evaluator.row(
            f'{name}_{i}',
            len(row),
            None if place is None else ast.Subscript(place, ast.Constant(i), ast.Load()),
        )
        for i, row in enumerate(matrix)
    )


def symbolic_tuple(evaluator: Evaluator, cls: Any, place: ast.Name) -> Record:
    """Return a named tuple of which nothing is known, taken apart at the beginning."""
    fields: dict[str, Any] = {}
    begin = len(evaluator.body)
    targets: list[ast.expr] = []
    for field, annotation in cls.__annotations__.items():
        kind = getattr(annotation, '__forward_arg__', annotation)
        own = load(evaluator.fresh(f'{place.id}_{field}'))
        targets.append(store(own.id))
        fields[field] = Code(own, kind)
        if kind == Stall.__name__:
            fields[field] = symbolic_tuple(evaluator, Stall, own)
    unpack = ast.Assign([ast.Tuple(targets, ast.Store())], place)
    evaluator.line = inspect.getsourcefile(cls) or '', inspect.getsourcelines(cls)[1]
    evaluator.body.insert(begin, evaluator.sourced(unpack))
    return Record(fields, place, cls)
