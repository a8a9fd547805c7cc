"""Expressions: worked out where all of it is known, else written."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Callable, Sequence
from functools import cache
import inspect
import math
import operator
from typing import Any

from nadrc_ros.adrc.specialise.values import (
    Code,
    is_load,
    kind_of,
    load,
    Memory,
    Record,
    record_of,
    Row,
    rows_of,
    same,
    store,
    UNLOADED,
    wider,
)
from nadrc_ros.adrc.specialise.workspace import Statements, Workspace

# Functions of numbers, and what they give.
PRIMITIVES: dict[Any, str] = {
    **dict.fromkeys((math.exp, math.expm1, math.sqrt, math.sin, math.log, math.floor), 'float'),
    **dict.fromkeys((math.copysign, abs, float, min, max), 'float'),
    **dict.fromkeys((math.isfinite, math.isnan, bool), 'bool'),
    int: 'int',
}
_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}


class Given(ast.expr):
    """A value in the place of an expression."""

    def __init__(self, value: Any) -> None:
        super().__init__()
        self.value = value


class Expressions(Workspace):
    """Evaluate expressions in the scope of the call that is evaluated."""

    def value(self, node: ast.expr) -> Any:
        """Evaluate an expression."""
        match node:
            case Given() | ast.Constant():
                return node.value
            case ast.Name():
                return self._look_up(node.id)
            case ast.Tuple():
                return tuple(self._values(node.elts))
            case ast.Attribute():
                thing = self.value(node.value)
                if isinstance(thing, Record):
                    return thing.fields[node.attr]
                return getattr(thing, node.attr)
            case ast.Subscript():
                return self._entry(node)
            case ast.BinOp():
                return self._operate(node.op, *self._values([node.left, node.right]))
            case ast.UnaryOp():
                return self._negate(node.op, self.value(node.operand))
            case ast.BoolOp():
                return self._connect(node)
            case ast.Compare():
                return self._compare(node)
            case ast.IfExp():
                test = self.value(node.test)
                if not isinstance(test, Code):
                    return self.value(node.body if test else node.orelse)
                return self._choose(test, node.body, node.orelse)
            case ast.Call():
                return self._call(node)
        raise self.refused(f'an expression of this kind: {ast.unparse(node)}')

    def _values(self, nodes: Sequence[ast.expr]) -> list[Any]:
        """Evaluate one after another: what one reads from memory, it reads before the next."""
        values: list[Any] = []
        for node in nodes:
            begin = len(self.body)
            value = self.value(node)
            written = self.body[begin:]
            if not all(map(is_load, written)):
                del self.body[begin:]
                values = [self.read_now(each) for each in values]
                self.body += written
            values.append(value)
        return values

    def items(self, value: Any) -> list[Any]:
        """Return the entries of what is looped over or taken apart."""
        if isinstance(value, Row):
            return [self.read(value, i) for i in range(len(value.cells))]
        if isinstance(value, Memory):
            return [self._at(value, i) for i in range(value.size)]
        if isinstance(value, Record) and value.cls is not None:
            return list(value.fields.values())
        if isinstance(value, (tuple, list, range)):
            return list(value)
        raise self.refused('the entries of what is not known')

    def call(self, function: Any, positional: list[Any], named: dict[str, Any]) -> Any:
        """Evaluate a call of a function of the law."""
        raise NotImplementedError

    def _look_up(self, name: str) -> Any:
        for names in (self.scope.values, self.scope.function.__globals__, vars(builtins)):
            if name in names:
                return names[name]
        raise self.refused(f'{name} has no value in every branch')

    def _entry(self, node: ast.Subscript) -> Any:
        vector, index = self.value(node.value), self.value(node.slice)
        if isinstance(vector, Memory):
            return self._at(vector, index)
        if not isinstance(index, Code):
            return self.read(vector, index) if isinstance(vector, Row) else vector[index]
        if isinstance(vector, tuple):
            name = ast.unparse(node.value).replace('.', '_')
            self.called[name] = vector
            return Code(ast.Subscript(load(name), index.node, ast.Load()), kind_of(vector[0]))
        raise self.refused(f'the subscript of {ast.unparse(node)} is not known')

    def _at(self, vector: Memory, index: Any) -> Any:
        if vector.width is not None:
            index = self.kept('row', index)
        place = ast.Subscript(vector.place, self.expression(index), ast.Load())
        if vector.width is not None:
            return Memory(place, vector.width, None, vector.kind)
        return Code(place, vector.kind)

    def _choose(self, test: Code, body: ast.expr, orelse: ast.expr) -> Any:
        """Evaluate one expression or the other; in a branch, where one has statements."""
        before, written = self.known(), self.body
        then: Statements = []
        self.body = then
        first, after = self.value(body), self.known()
        self.forget(before)
        other: Statements = []
        self.body = other
        second = self.value(orelse)
        self.body = written
        if then or other:
            self.merge(after, then, other)
            value = self.join('chosen', first, second, then, other)
            self.emit(ast.If(test.node, then or [ast.Pass()], other))
            return value
        if same(first, second):
            return first
        parts = self.expression(first), self.expression(second)
        return Code(ast.IfExp(test.node, *parts), wider(first, second))

    def _connect(self, node: ast.BoolOp) -> Any:
        decisive = isinstance(node.op, ast.Or)
        parts: list[ast.expr] = []
        for each in node.values:
            before, known = len(self.body), self.known()
            value = self.value(each)
            if kind_of(value) != 'bool':  # which C would make one of
                raise self.refused(f'"and" or "or" of a number: {ast.unparse(each)}')
            statements = self.body[before:]
            if parts and not all(map(is_load, statements)):
                del self.body[before:]
                parts = [self._go_on(parts, node.op, known, statements, value)]
            elif isinstance(value, Code):
                parts.append(value.node)
            elif bool(value) == decisive:  # whatever the parts before it are
                return decisive
        if not parts:
            return not decisive
        return Code(_connected(node.op, parts), 'bool')

    def _go_on(
        self,
        parts: list[ast.expr],
        op: ast.boolop,
        known: Any,
        statements: Statements,
        value: Any,
    ) -> ast.expr:
        """Write what the next part of an ``and`` or ``or`` needs where it comes to that."""
        after, other = self.known(), Statements()
        self.forget(known)
        self.merge(after, statements, other)
        name = self.fresh('both' if isinstance(op, ast.And) else 'either')
        self.emit(ast.Assign([store(name)], _connected(op, parts)))
        assignment = ast.Assign([store(name)], self.expression(value))
        test = load(name) if isinstance(op, ast.And) else ast.UnaryOp(ast.Not(), load(name))
        self.emit(ast.If(test, [*statements, self.sourced(assignment)], other))
        return load(name)

    def _operate(self, op: ast.operator, left: Any, right: Any) -> Any:
        if not isinstance(left, Code) and not isinstance(right, Code):
            return _OPERATORS[type(op)](left, right)
        kind = 'float' if isinstance(op, ast.Div) else wider(left, right)
        kind = 'int' if kind == 'bool' else kind
        # Exact, also for -0.0, inf and nan; with 0.0 nothing is.
        if right == 1 and kind == kind_of(left) and isinstance(op, (ast.Mult, ast.Div)):
            return left
        if left == 1 and kind == kind_of(right) and isinstance(op, ast.Mult):
            return right
        base = self.expression(left)
        if (
            isinstance(op, ast.Pow) and not isinstance(left, Code) and left < 0
        ):  # -2 ** x is -(2 ** x)
            base = ast.UnaryOp(ast.USub(), self.expression(-left))
        return Code(ast.BinOp(base, op, self.expression(right)), kind)

    def _negate(self, op: ast.unaryop, value: Any) -> Any:
        if not isinstance(value, Code):
            return not value if isinstance(op, ast.Not) else _OPERATORS[type(op)](value)
        return Code(ast.UnaryOp(op, value.node), 'bool' if isinstance(op, ast.Not) else value.kind)

    def _compare(self, node: ast.Compare) -> Any:
        values = self._values([node.left, *node.comparators])
        pairs = list(zip(node.ops, values, values[1:]))
        decided = [_decide(*pair) for pair in pairs]
        if False in decided:
            return False
        if all(decided):
            return True
        if not any(decided):
            parts = [self.expression(value) for value in values]
            return Code(ast.Compare(parts[0], node.ops, parts[1:]), 'bool')
        unsure: list[ast.expr] = [
            ast.Compare(self.expression(left), [op], [self.expression(right)])
            for outcome, (op, left, right) in zip(decided, pairs)
            if outcome is None
        ]
        return Code(_connected(ast.And(), unsure), 'bool')

    def _call(self, node: ast.Call) -> Any:
        function = self.value(node.func)
        values = self._values([*node.args, *(each.value for each in node.keywords)])
        positional, rest = values[: len(node.args)], values[len(node.args) :]
        named = {str(each.arg): value for each, value in zip(node.keywords, rest)}
        if function in PRIMITIVES:
            return self._primitive(function, positional)
        if function is len:
            return _length(positional[0])
        if function in (range, zip, reversed, enumerate):
            parts = [each if isinstance(each, int) else self.items(each) for each in positional]
            return list(function(*parts))
        if inspect.isclass(function) and issubclass(function, tuple):
            bound = bind(function, positional, named)
            return Record(
                {name: self.kept(name, record_of(part)) for name, part in bound.items()},
                None,
                function,
            )
        if inspect.isfunction(function):
            return self.call(function, positional, named)
        raise self.refused(f'a call of {ast.unparse(node.func)}')

    def _primitive(self, function: Any, arguments: list[Any]) -> Any:
        if not any(isinstance(each, Code) for each in arguments):
            return function(*arguments)
        kind = PRIMITIVES[function]
        if function is float and kind_of(arguments[0]) == 'float':
            return arguments[0]
        if function in (abs, min, max):
            kind = wider(arguments[0], arguments[-1])
        parts = [self.expression(each) for each in arguments]
        return Code(ast.Call(load(function.__name__), parts, []), kind)

    def call_by_name(self, name: str, gives: Sequence[str], arguments: list[Any]) -> Any:
        """Write a call, after which nothing is known of the vectors that it was given."""
        call = ast.Call(load(name), [self.expression(each) for each in arguments], [])
        results = tuple(Code(load(self.fresh(f'{name}_gives')), kind) for kind in gives)
        names = [each.node for each in results]
        targets: list[ast.expr] = [store(name.id) for name in names]  # type: ignore[attr-defined]
        if not results:
            self.emit(ast.Expr(call))
        elif len(results) == 1:
            self.emit(ast.Assign(targets, call))
        else:
            self.emit(ast.Assign([ast.Tuple(targets, ast.Store())], call))
        for argument in arguments:
            for row in rows_of(argument):
                row.cells = [UNLOADED] * len(row.cells)
        return results[0] if len(results) == 1 else results or None


def gives_of(function: Any) -> tuple[str, ...]:
    """Return the kinds of the numbers that a function gives, by its annotation."""
    annotation = str(signature(function).return_annotation)
    if annotation == 'None':
        return ()
    return tuple(annotation.removeprefix('tuple[').removesuffix(']').split(', '))


signature = cache(inspect.signature)


def bind(function: Any, positional: list[Any], named: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of a call by the names of the parameters."""
    bound = signature(function).bind(*positional, **named)
    bound.apply_defaults()
    return bound.arguments


def _connected(op: ast.boolop, parts: list[ast.expr]) -> ast.expr:
    return parts[0] if len(parts) == 1 else ast.BoolOp(op, parts)


def _length(vector: Any) -> int:
    if isinstance(vector, Row):
        return len(vector.cells)
    return vector.size if isinstance(vector, Memory) else len(vector)


def _decide(op: ast.cmpop, left: Any, right: Any) -> bool | None:
    """Return the outcome of a comparison, None if it is not known."""
    if not isinstance(left, Code) and not isinstance(right, Code):
        return bool(_OPERATORS[type(op)](left, right))
    above: tuple[type, ...] = ast.Gt, ast.GtE, ast.NotEq
    if isinstance(right, Code):
        left, right, above = right, left, (ast.Lt, ast.LtE, ast.NotEq)
    if left.positive and not isinstance(right, Code) and right == 0.0:
        return isinstance(op, above)
    return None
