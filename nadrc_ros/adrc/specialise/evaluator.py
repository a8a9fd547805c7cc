"""
Partial evaluation of the law: its functions, run on a design of which only the shape is known.

What depends on the shape alone - orders, levels, which features are on - is worked out here: loops
over it are unrolled, branches on it folded, functions put where they are called. What is left is
straight-line code with the operations of the source, in its order, on numbers that have names:
nothing is computed in another way, so that its results are those of the source to the bit.

The functions may use ``if``, ``while``, ``for``, assignment (to several names, and with an
operator), ``return``, arithmetic, comparisons, ``and``, ``or``, ``not``, attributes, subscripts,
and calls of each other, of named tuples and of ``expressions.PRIMITIVES``. The rest is refused by
its line. A loop whose end depends on numbers stays one.

Source: N. Jones, C. Gomard, P. Sestoft, Partial Evaluation and Automatic Program Generation, 1993.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Collection, Iterable, Sequence
from copy import copy
from functools import cache
import inspect
from typing import Any

import attrs
from nadrc_ros.adrc.specialise.expressions import bind, Expressions, Given, gives_of
from nadrc_ros.adrc.specialise.values import (
    Code,
    load,
    Memory,
    names_in,
    same,
    store,
    UNLOADED,
    wider,
)
from nadrc_ros.adrc.specialise.workspace import Known, RETURNED, Scope, Statements

# Evaluates a call apart: returns the name to call, or None to have it evaluated here.
Apart = Callable[[Any, dict[str, Any]], str | None]
# Statements that end the code where it would call what it does not do.
Leave = Callable[[], Statements]


class Evaluator(Expressions):
    """
    Evaluate one function into statements, with all that it calls but what is kept ``apart``.

    Where it would call what is ``left`` to others, it ends with the statements ``leave``. Loops
    are unrolled unless ``rolled``.
    """

    def __init__(
        self,
        parameters: Iterable[str],
        apart: Apart | None = None,
        left: Collection[Any] = (),
        leave: Leave = list,
        rolled: bool = False,
    ) -> None:
        super().__init__(parameters)
        self._apart = apart
        self._left = left
        self._leave = leave
        self._rolled = rolled

    def run(self, function: Any, arguments: Sequence[Any]) -> Statements:
        """Evaluate a function, and return its statements."""
        self.scope = Scope(function, bind(function, list(arguments), {}), outermost=True)
        self._run(parsed(function).body)
        return self.body

    def call(self, function: Any, positional: list[Any], named: dict[str, Any]) -> Any:
        """Evaluate a call where it is; return its value."""
        bound = bind(function, positional, named)
        if function in self._left:
            for statement in self._leave():
                self.emit(statement)
            zeros = tuple({'float': 0.0, 'int': 0, 'bool': False}[k] for k in gives_of(function))
            return zeros[0] if len(zeros) == 1 else zeros
        if self._apart is not None:
            name = self._apart(function, bound)
            if name is not None:
                return self.call_by_name(name, gives_of(function), list(bound.values()))
        bound = {name: self.kept(name, value) for name, value in bound.items()}
        outer, line = self.scope, self.line
        self.scope = Scope(function, bound)
        self._run(parsed(function).body)
        result = self.scope.values.get(RETURNED)
        self.scope, self.line = outer, line
        return result

    # ---- statements

    def _run(self, statements: Sequence[ast.stmt]) -> bool:
        """Run statements; return whether they end in a return."""
        work = list(statements)
        while work:
            statement = work.pop(0)
            self.line = self.scope.function.__code__.co_filename, statement.lineno
            match statement:
                case ast.Expr(value=ast.Constant()):
                    pass
                case ast.Expr():
                    self.value(statement.value)
                case ast.Assign():
                    value = self.value(statement.value)
                    for target in statement.targets:
                        self._assign(target, value)
                case ast.AugAssign():
                    target = copy(statement.target)
                    target.ctx = ast.Load()
                    both = ast.BinOp(target, statement.op, statement.value)
                    self._assign(statement.target, self.value(both))
                case ast.Return():
                    self._return(statement)
                    return True
                case ast.If():
                    test = self.value(statement.test)
                    if not isinstance(test, Code):
                        work = [*(statement.body if test else statement.orelse), *work]
                    elif self.scope.outermost or not _may_return(statement):
                        work = [*self._fork(test, statement), *work]
                    else:
                        return self._fork_with(work, test, statement)
                case ast.While():
                    test = True if self._rolled else self._test(statement)
                    if self._rolled or isinstance(test, Code):
                        self._loop(statement)
                    elif test:
                        work = [*statement.body, statement, *work]
                case ast.For():
                    if self._rolled and _over_range(statement):
                        self._loop(statement)
                    else:
                        work = [*self._unrolled(statement), *work]
                case _:
                    raise self.refused(f'a statement of this kind: {ast.unparse(statement)}')
        return False

    def _test(self, statement: ast.While) -> Any:
        """Evaluate the condition of a loop, which is done again if the loop stays one."""
        before, known = len(self.body), self.known()
        test = self.value(statement.test)
        if isinstance(test, Code):
            del self.body[before:]
            self.forget(known)
        return test

    def _unrolled(self, statement: ast.For) -> Statements:
        steps: Statements = []
        for item in self.items(self.value(statement.iter)):
            assignment = ast.Assign([statement.target], Given(item))
            steps += [ast.copy_location(assignment, statement), *statement.body]
        return steps

    def _assign(self, target: ast.expr, value: Any) -> None:
        match target:
            case ast.Name():
                self.scope.values[target.id] = self.kept(target.id, value)
            case ast.Tuple():
                parts = self.items(value)
                if not all(isinstance(each, ast.Name) for each in target.elts):
                    parts = [self.read_now(part) for part in parts]
                for each, part in zip(target.elts, parts, strict=True):
                    self._assign(each, part)
            case ast.Subscript():
                self.write(self.value(target.value), self.value(target.slice), value)
            case _:
                raise self.refused(f'an assignment to {ast.unparse(target)}')

    def _return(self, statement: ast.Return) -> None:
        value = None if statement.value is None else self.value(statement.value)
        if self.scope.outermost:
            self.emit(ast.Return(None if value is None else self.expression(value)))
        else:
            name = f'{self.scope.function.__name__}_gives'
            self.scope.values[RETURNED] = self.kept(name, value)

    def _branch(self, statements: Statements, before: Known) -> tuple[Statements, bool]:
        """Run a branch from what is known before it; return what it writes, and if it returns."""
        self.forget(before)
        written, line = self.body, self.line
        branch: Statements = []
        self.body = branch
        ended = self._run(statements)
        self.body, self.line = written, line
        return branch, ended

    def _fork(self, test: Code, statement: ast.If) -> Statements:
        """Write two branches; return the statements of the source that follow inside of them."""
        before = self.known()
        then, ended = self._branch(statement.body, before)
        if ended:
            self.forget(before)
            self.emit(ast.If(test.node, then, []))
            return statement.orelse
        after = self.known()
        other, ended = self._branch(statement.orelse, before)
        if ended:
            self.emit(ast.If(ast.UnaryOp(ast.Not(), test.node), other, []))
            self.body += then
            self.forget(after)
            return []
        self.merge(after, then, other)
        self._write_branches(test, then, other)
        return []

    def _fork_with(self, rest: Statements, test: Code, statement: ast.If) -> bool:
        """Write two branches of a call that may return in one, each with all that follows."""
        before = self.known()
        then, ended = self._branch([*statement.body, *rest], before)
        after = self.known()
        other, ended_too = self._branch([*statement.orelse, *rest], before)
        if ended and ended_too:  # nothing else of this call is read any more
            for values in (after.values, self.scope.values):
                for name in values.keys() - {RETURNED}:
                    del values[name]
        self.merge(after, then, other)
        self._write_branches(test, then, other)
        return ended and ended_too

    def _write_branches(self, test: Code, then: Statements, other: Statements) -> None:
        if then:
            self.emit(ast.If(test.node, then, other))
        elif other:
            self.emit(ast.If(ast.UnaryOp(ast.Not(), test.node), other, []))

    # ---- loops that stay loops

    def _loop(self, statement: ast.While | ast.For) -> None:
        """Write a loop: what changes in it has a name, or is in memory, before it begins."""
        if not self.scope.outermost and _may_return(statement):
            raise self.refused('a return in a loop whose end is not known')
        written, again = self.body, dict[str, str]()
        while True:
            before = self.known()
            inner: Statements = []
            self.body = inner
            header = self._header(statement)
            if self._run(statement.body):
                raise self.refused('a return in a loop whose end is not known')
            after = self.known()
            self.forget(before)
            self.body = written
            if not self._lift(before, after, again):
                break
        self._settle(after, again, inner)
        if isinstance(header, Code):
            self.emit(ast.While(header.node, inner, []))
        else:
            target, span = header
            self.emit(ast.For(target, span, inner, []))

    def _header(self, statement: ast.While | ast.For) -> Any:
        if isinstance(statement, ast.While):
            test = self.value(statement.test)
            if self.body:
                raise self.refused('statements in the condition of this loop')
            return test if isinstance(test, Code) else Code(ast.Constant(test), 'bool')
        assert isinstance(statement.iter, ast.Call) and isinstance(statement.target, ast.Name)
        parts = [self.expression(self.value(each)) for each in statement.iter.args]
        if self.body:
            raise self.refused('statements in the range of this loop')
        name = self.fresh(statement.target.id)
        self.scope.values[statement.target.id] = Code(load(name), 'int')
        return store(name), ast.Call(load('range'), parts, [])

    def _lift(self, before: Known, after: Known, again: dict[str, str]) -> bool:
        """Give a name to what the body of a loop changes; tell whether there was any."""
        lifted = False
        values = self.scope.values
        for name, value in before.values.items():
            now = after.values[name]
            if name in again or same(value, now):
                continue
            lifted = True
            if isinstance(value, Memory) and isinstance(value.place, ast.Subscript):
                index = self.named(f'{name}_at', Code(value.place.slice, 'int'))
                place = ast.Subscript(value.place.value, index.node, ast.Load())
                values[name] = attrs.evolve(value, place=place)
            else:
                values[name] = index = self.named(name, value, wider(value, now))
            again[name] = index.node.id  # type: ignore[attr-defined]
        for row, cells, later in zip(self.rows, before.cells, after.cells):
            for i, (cell, now) in enumerate(zip(cells, later)):
                if not same(cell, now) and cell is not UNLOADED:
                    if row.place is None:
                        raise self.refused('a vector without a place changes in this loop')
                    row.cells[i] = UNLOADED
                    lifted = True
        return lifted

    def _settle(self, after: Known, again: dict[str, str], inner: Statements) -> None:
        """Let the body of a loop end with what it goes on with."""
        pairs = []
        for name, target in again.items():
            now = after.values[name]
            if isinstance(now, Memory):
                assert isinstance(now.place, ast.Subscript)
                now = Code(now.place.slice, 'int')
            pairs.append((target, now))
        targets: list[ast.expr] = [store(target) for target, _ in pairs]
        moves = any(names_in(now) & set(again.values()) for _, now in pairs)
        if moves and len(pairs) > 1:
            values = ast.Tuple([self.expression(now) for _, now in pairs], ast.Load())
            inner.append(self.sourced(ast.Assign([ast.Tuple(targets, ast.Store())], values)))
            return
        for place, (_, now) in zip(targets, pairs):
            inner.append(self.sourced(ast.Assign([place], self.expression(now))))


def _may_return(statement: ast.stmt) -> bool:
    return any(isinstance(node, ast.Return) for node in ast.walk(statement))


def _over_range(statement: ast.For) -> bool:
    match statement.iter:
        case ast.Call(func=ast.Name(id='range')):
            return True
    return False


@cache
def parsed(function: Any) -> ast.FunctionDef:
    """Return the syntax tree of a function of a module."""
    return _functions(inspect.getmodule(function))[function.__name__]


@cache
def _functions(module: Any) -> dict[str, ast.FunctionDef]:
    tree = ast.parse(inspect.getsource(module))
    return {each.name: each for each in tree.body if isinstance(each, ast.FunctionDef)}
