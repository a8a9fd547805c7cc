"""Statements made fewer: what nothing reads is left out, but for calls, which may write."""

from __future__ import annotations

import ast
from collections import Counter

from nadrc_ros.adrc.specialise.expressions import PRIMITIVES

Statements = list[ast.stmt]
_PURE = frozenset(function.__name__ for function in PRIMITIVES)


def tidied(body: Statements) -> Statements:
    """Leave out assignments to names that nothing reads."""
    while True:
        size = _size(body)
        loads = _loads(body)
        body = _needed(body, loads)
        if _size(body) == size:
            return body


def _loads(body: Statements) -> Counter[str]:
    return Counter(
        node.id
        for statement in body
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
    )


def _needed(body: Statements, loads: Counter[str]) -> Statements:
    kept: Statements = []
    for statement in body:
        match statement:
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


def _may_write(value: ast.expr) -> bool:
    """Tell whether there is a call in it of what may write to memory."""
    called = (node.func for node in ast.walk(value) if isinstance(node, ast.Call))
    return any(not isinstance(each, ast.Name) or each.id not in _PURE for each in called)


def _size(body: Statements) -> int:
    return sum(1 for statement in body for _ in ast.walk(statement))
