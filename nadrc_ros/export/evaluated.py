"""
The law of one design, evaluated with all its numbers: what is left depends on samples only.

At a fixed rate the gains of the observers and the decays of offsets, which depend on the time
since the last sample, are read from tables over the number of periods.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Sequence
import inspect
from math import exp, nan
from typing import Any

import attrs
from nadrc_ros.adrc import law, limiter, observer, state, tick, transfer
from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.specialise.evaluator import Evaluator
from nadrc_ros.adrc.specialise.expressions import signature
from nadrc_ros.adrc.specialise.program import matrix_of, Program
from nadrc_ros.adrc.specialise.values import Code, Function, load, Record, UNLOADED
from nadrc_ros.adrc.state import blank_state, State
from nadrc_ros.adrc.supervisor import PolicyState, Stall
from nadrc_ros.export.c_printer import c_name

# Functions of their own, as they are called from several places.
_APART = {
    *(law._refuse, law._restart, limiter.clamp, limiter.limit, state.match_command),
    *(state.raw_command, state.start, tick._without_sample, transfer.adopt_reference),
}
# Of a state, what the exported features need; the rest stays what it is at the beginning.
_MEMORY = ('levels', 'profile', 'offset', 'smoothed', 'startup', 'since_sample')
# Of a sample, what is the same for every one.
_ALWAYS: dict[str, Any] = {'age': 0.0, 'followed': True, 'gain_variable': nan, 'feed_forward': 0.0}


class Exported(Program):
    """Evaluates for a design whose numbers are known."""

    def __init__(self, design: Design, period: float | None) -> None:
        super().__init__(design, apart=_APART if period is not None else {*_APART, observer.place})
        self.period = period
        self.memory = _MEMORY if period is not None else (*_MEMORY, 'scratch')
        self.decays: list[float] = []

    def add(self, function: Any, **sizes: int) -> Function:
        """Evaluate a function once, whatever it is given; all sizes are those of the design."""
        if function not in self.functions:
            names = list(signature(function).parameters)
            made = self._evaluate(function, dict.fromkeys(names), c_name(function.__name__))
            self.functions[function] = made
        return self.functions[function]

    def _called_apart(self, function: Any, bound: dict[str, Any]) -> str | None:
        return self.add(function).name if function in self._apart else None

    def _evaluator(self, parameters: Collection[str], rolled: bool) -> Evaluator:
        return _Evaluator(self, parameters)

    def _argument(
        self, evaluator: Evaluator, parameter: inspect.Parameter, given: Any, rolled: bool
    ) -> Any:
        name = parameter.name
        place = load(name)
        match parameter.annotation:
            case 'Design':
                fields = {f.name: getattr(self.design, f.name) for f in attrs.fields(Design)}
                return Record({key: _known(value) for key, value in fields.items()}, place)
            case 'State':
                return self._state(evaluator, name)
            case 'Vector':
                return evaluator.row(name, self.design.order + 1, place)
            case 'Matrix':
                return matrix_of(evaluator, name, blank_state(self.design).scratch, place)
            case 'Sample':
                fields = {}
                for field, kind in Sample.__annotations__.items():
                    code = Code(load(evaluator.fresh(f'{name}_{field}')), kind.__forward_arg__)
                    fields[field] = _ALWAYS.get(field, code)
                return Record(fields, None, Sample)
            case 'PolicyState':
                return _record(PolicyState, place)
        return Code(place, str(parameter.annotation))

    def _state(self, evaluator: Evaluator, name: str) -> Record:
        blank = blank_state(self.design)
        fields: dict[str, Any] = {}
        for field in attrs.fields(State):
            if not field.init:
                continue
            value, own = getattr(blank, field.name), f'{name}_{field.name}'
            there = field.name in self.memory
            place = ast.Attribute(load(name), field.name, ast.Load()) if there else None
            if value and isinstance(value[0], list):
                fields[field.name] = matrix_of(evaluator, own, value, place)
            else:
                fields[field.name] = row = evaluator.row(own, len(value), place)
                if not there:
                    row.cells = list(value)
        return Record(fields, load(name))


class _Evaluator(Evaluator):
    """Evaluates with the tables of an export where the rate is fixed."""

    def __init__(self, program: Exported, parameters: Any) -> None:
        reserved = (c_name(each.__name__) for each in _APART)
        super().__init__(
            (*parameters, *reserved, 'GAINS', 'TIMES', 'softened'), program._called_apart
        )
        self._program = program
        self._periods: ast.expr | None = None

    def call(self, function: Any, positional: list[Any], named: dict[str, Any]) -> Any:
        """Evaluate a call; at a fixed rate gains are looked up."""
        if self._program.period is not None:
            if function is observer.place:
                self._place(*positional)
                return None
            if function is law.step:  # which asks whether the time of the last gains was another
                positional[5] = attrs.evolve(positional[5], positive=True)
        return super().call(function, positional, named)

    def call_by_name(self, name: str, gives: Sequence[str], arguments: list[Any]) -> Any:
        """Write a call; vectors without a place stay what they are."""
        cells = [(row, row.cells) for row in self.rows if row.place is None]
        result = super().call_by_name(name, gives, arguments)
        for row, before in cells:
            row.cells = before
        return result

    def _place(self, design: Any, dt: Code, speed: float, scratch: Any) -> None:
        assert speed == 1.0
        levels, states = self._program.design.levels, self._program.design.states
        periods = ast.BinOp(dt.node, ast.Div(), ast.Constant(self._program.period))
        index = ast.BinOp(ast.Call(load('int'), [periods], []), ast.Sub(), ast.Constant(1))
        self._periods = self.named('periods', Code(index, 'int')).node
        for k in range(levels):
            scratch[k].place = self._row_of('GAINS', k)
            scratch[k].cells = [UNLOADED] * states
        scratch[levels].cells = [1.0, *(self._time(m) for m in range(states - 1))]
        scratch[levels + 1].place = load('softened')  # an array of the function
        scratch[levels + 1].cells = [UNLOADED] * states

    def _row_of(self, table: str, column: int) -> ast.expr:
        assert self._periods is not None
        row = ast.Subscript(load(table), self._periods, ast.Load())
        return ast.Subscript(row, ast.Constant(column), ast.Load())

    def _time(self, column: int) -> Code:
        return Code(self._row_of('TIMES', column))

    def _primitive(self, function: Any, arguments: list[Any]) -> Any:
        if function is exp and self._periods is not None:
            match arguments[0].node:
                case ast.BinOp(left=ast.Constant(value=float() as rate), op=ast.Mult()):
                    decays = self._program.decays
                    if rate not in decays:
                        decays.append(rate)
                    return self._time(self._program.design.states - 1 + decays.index(rate))
        return super()._primitive(function, arguments)


def _known(value: Any) -> Any:
    return tuple(map(_known, value)) if isinstance(value, list) else value


def _record(cls: Any, place: ast.expr) -> Record:
    fields: dict[str, Any] = {}
    for field, reference in cls.__annotations__.items():
        kind = reference.__forward_arg__
        own = ast.Attribute(place, field, ast.Load())
        fields[field] = _record(Stall, own) if kind == 'Stall' else Code(own, kind)
    return Record(fields, place, cls)
