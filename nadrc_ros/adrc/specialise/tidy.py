"""
Statements made fewer.

What nothing reads is left out, but for calls, which may write; and what was named only to be
handed on, as what a branch gives to the name that both branches give, has that name at once.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator

from nadrc_ros.adrc.specialise.expressions import PRIMITIVES

Statements = list[ast.stmt]
_PURE = frozenset(function.__name__ for function in PRIMITIVES)


def tidied(body: Statements) -> Statements:
    """Return these statements without those that are not needed; they are changed in place."""
    early: set[str] = set()
    while True:
        size = _size(body)
        _hand_on(body, early)
        body = _needed(body, _names(body, ast.Load))
        if _size(body) == size:
            return body


def _hand_on(body: Statements, early: set[str]) -> None:
    """
    Give what a copy alone reads the name that it is copied to; the copy is left to be removed.

    That name is read after the copy only, so it may be written before. But two branches may copy
    what was written before both: of these the first alone becomes the name, which is noted in
    ``early``. Not in loops, where what is copied may be from the round before.
    """
    loads, stores = _names(body, ast.Load), _names(body, ast.Store)
    handed: dict[str, str] = {}
    for target, name, block in _copies(body):
        if loads[name] != 1 or not stores[name] or target in handed or name in handed.values():
            continue  # read elsewhere too, a parameter, or one for the next round
        if _names(block, ast.Store)[name] < stores[name]:
            if target in early:
                continue
            early.add(target)
        handed[name] = target
    for node in (node for statement in body for node in ast.walk(statement)):
        if isinstance(node, ast.Name):
            node.id = handed.get(node.id, node.id)


def _copies(body: Statements) -> Iterator[tuple[str, str, Statements]]:
    """Return the copies from name to name outside of loops: target, source, and their block."""
    for statement in body:
        match statement:
            case ast.Assign(targets=[ast.Name(id=target)], value=ast.Name(id=name)):
                yield target, name, body
            case ast.If():
                yield from _copies(statement.body)
                yield from _copies(statement.orelse)


def _names(body: Statements, context: type[ast.expr_context]) -> Counter[str]:
    return Counter(
        node.id
        for statement in body
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, context)
    )


def _needed(body: Statements, loads: Counter[str]) -> Statements:
    kept: Statements = []
    for statement in body:
        match statement:
            case ast.Assign(targets=[ast.Name(id=target)], value=ast.Name(id=name)) if (
                target == name
            ):
                continue
            case ast.Assign():
                statement.targets = [
                    target
                    for target in statement.targets
                    if not isinstance(target, ast.Name) or loads[target.id] > 0
                ]
                if not statement.targets:
                    if not _may_write(statement.value):
                        continue
                    call = ast.Expr(statement.value)
                    call.source = statement.source  # type: ignore[attr-defined]
                    statement = call
            case ast.If():
                statement.body = _needed(statement.body, loads)
                statement.orelse = _needed(statement.orelse, loads)
                if not statement.body:
                    if not statement.orelse:
                        continue
                    statement.test = ast.UnaryOp(ast.Not(), statement.test)
                    statement.body, statement.orelse = statement.orelse, []
            case ast.While() | ast.For():
                statement.body = _needed(statement.body, loads)
                if isinstance(statement, ast.For) and not statement.body:
                    continue
            case ast.Pass():
                continue
        kept.append(statement)
        if isinstance(statement, ast.Return):
            break
    return kept


def joined(body: Statements) -> Statements:
    """
    Return these statements with what is read once where it is read, and formulas so whole.

    A value stays behind what it needs, and before what changes that: a name, or memory.
    """
    return _joined(body, _names(body, ast.Load), _names(body, ast.Store))


def _joined(body: Statements, loads: Counter[str], stores: Counter[str]) -> Statements:
    kept: Statements = []
    held: dict[str, ast.Assign] = {}

    def let_go(*changed: str, memory: bool = False) -> None:
        for name, held_back in list(held.items()):
            nodes = list(ast.walk(held_back.value))
            if any(isinstance(node, ast.Name) and node.id in changed for node in nodes) or (
                memory and any(isinstance(node, ast.Subscript) for node in nodes)
            ):
                kept.append(held.pop(name))

    for statement in body:
        match statement:
            case ast.Assign() | ast.Expr() | ast.Return():
                statement = _Put(held).visit(statement)
                writes = _may_write(statement) or _stores_entry(statement)
                match statement:
                    case ast.Assign(targets=[ast.Name(id=name)]) if (
                        loads[name] == stores[name] == 1 and not writes
                    ):
                        held[name] = statement
                        continue
                let_go(*_names([statement], ast.Store), memory=writes)
            case _:
                if isinstance(statement, ast.If):
                    statement.test = _Put(held).visit(statement.test)
                    statement.body = _joined(statement.body, loads, stores)
                    statement.orelse = _joined(statement.orelse, loads, stores)
                kept += held.values()
                held.clear()
        kept.append(statement)
    return [*kept, *held.values()]


class _Put(ast.NodeTransformer):
    """Puts held values where they are read."""

    def __init__(self, held: dict[str, ast.Assign]) -> None:
        self._held = held

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Return what stands for a name."""
        if isinstance(node.ctx, ast.Load) and node.id in self._held:
            return self._held.pop(node.id).value
        return node


def _stores_entry(statement: ast.AST) -> bool:
    return any(
        isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store)
        for node in ast.walk(statement)
    )


def _may_write(value: ast.expr) -> bool:
    """Tell whether there is a call in it of what may write to memory."""
    called = (node.func for node in ast.walk(value) if isinstance(node, ast.Call))
    return any(not isinstance(each, ast.Name) or each.id not in _PURE for each in called)


def _size(body: Statements) -> int:
    return sum(1 for statement in body for _ in ast.walk(statement))
