"""
The law for one shape of design as straight-line Python: the same bits in less time.

All numbers stay variables: a live change of a bandwidth goes on with the same code.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
import math
from typing import Any

import attrs
from nadrc_ros.adrc import (
    angle,
    deadband,
    delay_line,
    gain,
    internal_model,
    law,
    state,
    tick,
    transfer,
)
from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.specialise.expressions import signature
from nadrc_ros.adrc.specialise.program import Program, shape_of
from nadrc_ros.adrc.specialise.tidy import joined
from nadrc_ros.adrc.specialise.values import load, store
from nadrc_ros.adrc.state import blank_state, State

# What is rare is called as it is: it would be evaluated for nothing.
RARE = frozenset(
    (
        *(law._refuse, law._restart, internal_model.update_known, deadband.mind_deadband),
        *(gain.follow_gain, delay_line.pass_through, angle.receive, angle.recentre),
        *(tick._take_over, tick._without_sample, state.start, transfer.adopt_reference),
    )
)
# By function and shape.
_MADE: dict[Any, Any] = {}
_MATHEMATICS = ('exp', 'expm1', 'sqrt', 'sin', 'log', 'floor', 'copysign', 'isfinite', 'isnan')
SCOPE = {name: getattr(math, name) for name in (*_MATHEMATICS, 'nan', 'inf')}


def specialised(function: Any, design: Design, make: bool = True) -> Any:
    """
    Return ``law.step`` or ``tick.tick`` for designs of this shape.

    Where nothing is to be made, and it was not made before, that is the function as it is.
    """
    key = function, shape_of(design)
    if make and key not in _MADE:
        source, scope = source_of(function, design)
        _MADE[key] = defined(function.__name__, source, scope, f'<law of {key[1]}>')
    return _MADE.get(key, function)


def defined(name: str, source: str, scope: dict[str, Any], file: str) -> Any:
    """Return a function from its source, that of a ``file`` in what is said of it."""
    exec(compile(source, file, 'exec'), scope)
    return scope[name]


def source_of(function: Any, design: Design) -> tuple[str, dict[str, Any]]:
    """Return the code, and what it calls by name."""
    program = Program(design, original=RARE)
    made = program.add(function)
    parameters = signature(function).parameters.values()
    head = ', '.join(
        each.name if each.default is each.empty else f'{each.name}={each.default!r}'
        for each in parameters
    )
    lines = [f'def {made.name}({head}):', *text(joined(_quickened(made.body, design)), 1)]
    return '\n'.join(lines), SCOPE | program.called


def text(body: list[ast.stmt], depth: int) -> Iterator[str]:
    """Return the lines of statements, each with that of the source that it comes from."""
    pad = '    ' * depth
    for statement in body:
        match statement:
            case ast.If():
                yield f'{pad}if {ast.unparse(statement.test)}:'
                yield from text(statement.body, depth + 1)
                other = statement.orelse
                while len(other) == 1 and isinstance(other[0], ast.If):
                    yield f'{pad}elif {ast.unparse(other[0].test)}:'
                    yield from text(other[0].body, depth + 1)
                    other = other[0].orelse
                if other:
                    yield f'{pad}else:'
                    yield from text(other, depth + 1)
            case ast.While():
                yield f'{pad}while {ast.unparse(statement.test)}:'
                yield from text(statement.body, depth + 1)
            case ast.For():
                target, span = ast.unparse(statement.target), ast.unparse(statement.iter)
                yield f'{pad}for {target} in {span}:'
                yield from text(statement.body, depth + 1)
            case _:
                file, number = getattr(statement, 'source', ('', 0))
                statement.lineno = number
                yield f'{pad}{ast.unparse(statement)}  # {file.rpartition("/")[2]}:{number}'


def _quickened(body: list[ast.stmt], design: Design) -> list[ast.stmt]:
    """
    Read the vectors of both states in one go each.

    An attribute, or an entry of a list, takes several times as long as one of many names that a
    tuple is taken apart into.
    """
    rows = list(_row_names(blank_state(design)))
    used = {
        ast.unparse(node)
        for statement in body
        for node in ast.walk(statement)
        if isinstance(node, (ast.Attribute, ast.Subscript))
    }
    places = [f'{thing}.{row}' for thing in ('state', 'out') for row in rows]
    names = {place: place.translate(_IN_NAMES) for place in places if place in used}
    shortened = _Shortened(names)
    body = [shortened.visit(statement) for statement in body]
    head: list[ast.stmt] = []
    for thing in ('state', 'out'):
        targets: list[ast.expr] = [store(names.get(f'{thing}.{row}', '_')) for row in rows]
        whole = ast.Attribute(load(thing), 'rows', ast.Load())
        head.append(ast.Assign([ast.Tuple(targets, ast.Store())], whole))
        head[-1].source = 'state.py', 0  # type: ignore[attr-defined]
    return [*head, *body]


_IN_NAMES = str.maketrans({'.': '_', '[': '_', ']': None})


def _row_names(blank: State) -> Iterator[str]:
    for field in attrs.fields(State):
        value = getattr(blank, field.name) if field.init else ()
        if value and isinstance(value[0], list):
            yield from (f'{field.name}[{i}]' for i in range(len(value)))
        elif field.init:
            yield field.name


class _Shortened(ast.NodeTransformer):
    """Puts shorter names for those that printing made up."""

    def __init__(self, names: dict[str, str]) -> None:
        self._names = names

    def generic_visit(self, node: ast.AST) -> Any:
        if not isinstance(node, (ast.Subscript, ast.Attribute)):
            return super().generic_visit(node)
        name = self._names.get(ast.unparse(node))
        return super().generic_visit(node) if name is None else load(name)
