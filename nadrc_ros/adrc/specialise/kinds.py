"""The kinds of numbers in statements of the evaluator: what a language with types must be told."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping, Sequence

# Functions that a statement may call: what they give.
_FUNCTIONS = {
    **dict.fromkeys(('exp', 'expm1', 'sqrt', 'sin', 'log', 'floor', 'copysign'), 'float'),
    **dict.fromkeys(('isfinite', 'isnan', 'bool'), 'bool'),
    'int': 'int',
    'float': 'float',
}


class Kinds:
    """
    The kinds of the names of one function: float, int or bool.

    Parameters
    ----------
    statements
        The body of the function.
    given
        The kinds of what it is given, by name.
    gives
        The kinds of what functions give that it may call, by their names.
    entry
        Returns the kind of what is read from a place in memory.

    Attributes
    ----------
    names
        The kinds by name.

    """

    def __init__(
        self,
        statements: Sequence[ast.stmt],
        given: Mapping[str, str],
        gives: Callable[[str], Sequence[str]],
        entry: Callable[[ast.expr], str],
    ) -> None:
        self.names = dict(given)
        self._gives, self._entry = gives, entry
        while self._learn(statements):
            pass

    def _learn(self, statements: Sequence[ast.stmt]) -> bool:
        """Find the kinds of names from what they are given; tell whether one was new."""
        found: dict[str, str] = {}
        for target, kind in self._given(statements):
            if kind and isinstance(target, ast.Name) and self.names.get(target.id) != 'float':
                found[target.id] = widest(kind, found.get(target.id, kind))
        new = {name: kind for name, kind in found.items() if self.names.get(name) != kind}
        self.names.update(new)
        return bool(new)

    def _given(self, statements: Sequence[ast.stmt]) -> Iterator[tuple[ast.expr, str]]:
        for statement in (node for each in statements for node in ast.walk(each)):
            match statement:
                case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                    yield from zip(names, map(self.of, values))
                case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Call(func=called)):
                    yield from zip(names, self._gives(called.id))  # type: ignore[attr-defined]
                case ast.Assign(targets=targets, value=value):
                    kind = self.of(value)
                    yield from ((target, kind) for target in targets)
                case ast.For(target=target):
                    yield target, 'int'

    def of(self, node: ast.expr) -> str:
        """Return the kind of an expression, empty while that is not known."""
        match node:
            case ast.Constant(value=value):
                return type(value).__name__
            case ast.Name(id=name):
                return 'float' if name in ('nan', 'inf') else self.names.get(name, '')
            case ast.Attribute() | ast.Subscript():
                return self._entry(node)
            case ast.BinOp(op=ast.Div() | ast.Pow()):
                return 'float'
            case ast.BinOp(left=left, right=right):
                return widest(self.of(left), self.of(right)).replace('bool', 'int')
            case ast.IfExp(body=left, orelse=right):
                return widest(self.of(left), self.of(right))
            case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
                return self.of(operand)
            case ast.Call(func=ast.Name(id=name), args=arguments):
                if name in ('abs', 'min', 'max'):
                    return widest(*map(self.of, arguments))
                return _FUNCTIONS[name] if name in _FUNCTIONS else self._gives(name)[0]
        return 'bool'


def widest(*kinds: str) -> str:
    """Return the kind that holds all; empty while one that may matter is not known."""
    return next(kind for kind in ('float', '', 'int', 'bool') if kind in kinds)
