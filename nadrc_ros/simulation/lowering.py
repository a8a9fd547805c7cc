"""
The source of evaluated functions as code of LLVM: the same operations in the same order.

numba would write it too, after seconds of finding out what is known here: that each number is a
float, an integer or a truth, and each vector the address of floats.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from llvmlite import ir
from nadrc_ros.adrc.specialise.kinds import Kinds, widest

_FLOAT, _INT, _BOOL = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
# By the annotations of the source.
_TYPES = {'Vector': ir.PointerType(_FLOAT), 'float': _FLOAT, 'int': _INT, 'bool': _BOOL}
_KINDS = {kind: name for name, kind in _TYPES.items()}
# Of these each bit is defined; the others are those of the C library, as in Python.
_EXACT = {'abs': 'fabs', 'sqrt': 'sqrt', 'floor': 'floor', 'copysign': 'copysign'}
_LIBRARY = 'exp', 'expm1', 'sin', 'log'
_SIGNS = {ast.Lt: '<', ast.LtE: '<=', ast.Gt: '>', ast.GtE: '>=', ast.Eq: '==', ast.NotEq: '!='}
_OPERATIONS = {ast.Add: 'add', ast.Sub: 'sub', ast.Mult: 'mul', ast.Div: 'div'}


def lower(module: ir.Module, source: str, tables: Mapping[str, Any], ending: str) -> None:
    """
    Add the functions of a ``source``, with an ``ending`` to their names, to a module.

    What they are given and give is annotated; ``tables`` are the tuples of numbers that they look
    up. A function stands before those that call it.
    """
    made: dict[str, tuple[ir.Function, Sequence[str]]] = {}
    for node in ast.parse(source).body:
        assert isinstance(node, ast.FunctionDef) and isinstance(node.returns, ast.Tuple)
        given = {each.arg: ast.unparse(each.annotation or each) for each in node.args.args}
        gives = [ast.unparse(each) for each in node.returns.elts]
        result = ir.LiteralStructType([_TYPES[kind] for kind in gives]) if gives else ir.VoidType()
        kind = ir.FunctionType(result, [_TYPES[kind] for kind in given.values()])
        function = ir.Function(module, kind, node.name + ending)
        function.linkage = 'internal'
        made[node.name] = function, gives
        _Body(node.body, given, made[node.name], made, tables)


class _Body:
    """Writes the statements of one function."""

    def __init__(
        self,
        statements: Sequence[ast.stmt],
        given: Mapping[str, str],
        own: tuple[ir.Function, Sequence[str]],
        made: Mapping[str, tuple[ir.Function, Sequence[str]]],
        tables: Mapping[str, Any],
    ) -> None:
        self._function, self._gives = own
        self._made, self._tables = made, tables
        kinds = Kinds(statements, given, lambda name: made[name][1], self._entry_kind)
        self._kind = kinds.of
        names = ir.IRBuilder(self._new_block())
        self._places = {name: names.alloca(_TYPES[kind]) for name, kind in kinds.names.items()}
        for name, value in zip(given, self._function.args):
            names.store(value, self._places[name])
        self._names = names
        self._builder = ir.IRBuilder(self._new_block())
        begin = self._builder.block
        self._block(statements)
        names.branch(begin)
        if not self._ended:
            self._builder.unreachable() if self._gives else self._builder.ret_void()

    @property
    def _ended(self) -> bool:
        return bool(self._builder.block.is_terminated)

    def _new_block(self) -> Any:
        return self._function.append_basic_block()

    # ---- statements

    def _block(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            if self._ended:  # what follows a return
                return
            self._statement(statement)

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=values)):
                for target, value in zip(targets, [self._value(each) for each in values]):
                    self._store(target, value)
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=value):
                whole = self._call(value)
                for i, target in enumerate(targets):
                    self._store(target, self._builder.extract_value(whole, i))
            case ast.Assign(targets=targets, value=value):
                found = self._value(value)
                for target in targets:
                    self._store(target, found)
            case ast.If(test=test, body=body, orelse=other):
                self._branch(test, lambda: self._block(body), lambda: self._block(other))
            case ast.While(test=test, body=body):
                self._repeat(lambda: self._truth(test), lambda: self._block(body))
            case ast.For(target=target, iter=ast.Call(args=arguments), body=body):
                self._count(target, arguments, body)
            case ast.Return(value=None):
                self._builder.ret_void()
            case ast.Return(value=ast.expr() as value):
                parts = value.elts if isinstance(value, ast.Tuple) else [value]
                whole = ir.Constant(self._function.ftype.return_type, ir.Undefined)
                for i, (kind, part) in enumerate(zip(self._gives, parts)):
                    whole = self._builder.insert_value(whole, self._as(kind, self._value(part)), i)
                self._builder.ret(whole)
            case ast.Expr(value=ast.Call() as value):
                self._call(value)
            case ast.Pass():
                pass
            case _:
                raise TypeError(f'not known: {ast.unparse(node)}')

    def _store(self, target: ast.expr, value: Any) -> None:
        place = self._place(target)
        self._builder.store(self._as(_KINDS[place.type.pointee], value), place)

    def _branch(self, test: ast.expr, *sides: Callable[[], Any]) -> list[tuple[Any, Any]]:
        """Do one of two things; return what each gives, and the block in which it ends."""
        blocks = [self._new_block() for _ in sides]
        self._builder.cbranch(self._truth(test), *blocks)
        after, ends = self._new_block(), []
        for side, block in zip(sides, blocks):
            self._builder.position_at_end(block)
            ends.append((side(), self._builder.block))
            if not self._ended:
                self._builder.branch(after)
        self._builder.position_at_end(after)
        return ends

    def _repeat(self, test: Callable[[], Any], body: Callable[[], None]) -> None:
        head, inside, after = self._new_block(), self._new_block(), self._new_block()
        self._builder.branch(head)
        self._builder.position_at_end(head)
        self._builder.cbranch(test(), inside, after)
        self._builder.position_at_end(inside)
        body()
        if not self._ended:
            self._builder.branch(head)
        self._builder.position_at_end(after)

    def _count(self, target: ast.expr, span: Sequence[ast.expr], body: list[ast.stmt]) -> None:
        """Write a loop over a range; its step is a constant."""
        values = [self._value(each) for each in span]
        begin, end, step = (
            (ir.Constant(_INT, 0), *values, ir.Constant(_INT, 1))
            if len(values) == 1
            else (*values, ir.Constant(_INT, 1))[:3]
        )
        counter = self._names.alloca(_INT)
        self._builder.store(begin, counter)

        def test() -> Any:
            sign = '<' if step.constant > 0 else '>'
            return self._builder.icmp_signed(sign, self._builder.load(counter), end)

        def turn() -> None:
            now = self._builder.load(counter)
            self._store(target, now)
            self._block(body)
            if not self._ended:
                self._builder.store(self._builder.add(now, step), counter)

        self._repeat(test, turn)

    # ---- places

    def _entry_kind(self, node: ast.expr) -> str:
        assert isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name)
        name = node.value.id
        return type(self._tables[name][0]).__name__ if name in self._tables else 'float'

    def _place(self, node: ast.expr) -> Any:
        """Return the address of a name, of an entry or of a part of a vector, or of a table."""
        match node:
            case ast.Name(id=name):
                return self._places[name]
            case ast.Subscript(value=ast.Name(id=name) as vector, slice=index):
                if isinstance(index, ast.Slice):
                    assert index.lower is not None
                    index = index.lower
                places = [self._value(index)]
                if name in self._tables:
                    begin, places = self._table(name), [ir.Constant(_INT, 0), *places]
                else:
                    begin = self._value(vector)
                return self._builder.gep(begin, places, inbounds=True)
        raise TypeError(f'not known: {ast.unparse(node)}')

    def _table(self, name: str) -> Any:
        module, full = self._function.module, f'{self._function.name}.{name}'
        if full not in module.globals:
            numbers = self._tables[name]
            kind = ir.ArrayType(_TYPES[type(numbers[0]).__name__], len(numbers))
            table = ir.GlobalVariable(module, kind, full)
            table.linkage, table.global_constant = 'internal', True
            table.initializer = ir.Constant(kind, numbers)
        return module.globals[full]

    # ---- expressions

    def _truth(self, node: ast.expr) -> Any:
        return self._as('bool', self._value(node))

    def _value(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=value):
                return ir.Constant(_TYPES[type(value).__name__], value)
            case ast.Name(id='nan' | 'inf' as name):
                return ir.Constant(_FLOAT, float(name))
            case ast.Subscript(slice=ast.Slice()):
                return self._place(node)
            case ast.Name() | ast.Subscript():
                return self._builder.load(self._place(node))
            case ast.BinOp(op=op, left=left, right=right):
                return self._operation(op, *self._alike(self._kind(node), left, right))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self._builder.not_(self._truth(operand))
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=float() | int() as number)):
                return ir.Constant(_TYPES[type(number).__name__], -number)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                value = self._value(operand)
                return self._builder.fneg(value) if _is_float(value) else self._builder.neg(value)
            case ast.BoolOp(op=op, values=[first, *others]):
                if not others:
                    return self._truth(first)
                rest, known = ast.BoolOp(op, others), ast.Constant(isinstance(op, ast.Or))
                sides = (rest, known) if isinstance(op, ast.And) else (known, rest)
                return self._either('bool', first, *sides)
            case ast.IfExp(test=test, body=body, orelse=other):
                return self._either(self._kind(node), test, body, other)
            case ast.Compare(left=left, ops=ops, comparators=[right, *others]):
                pair = self._alike(widest('int', self._kind(left), self._kind(right)), left, right)
                found = self._compared(_SIGNS[type(ops[0])], *pair)
                if not others:  # evaluated whatever the first says, as it has no effects
                    return found
                rest = self._value(ast.Compare(right, ops[1:], others))
                return self._builder.and_(found, rest)
            case ast.Call():
                found = self._call(node)
                plain = not isinstance(found.type, ir.LiteralStructType)
                return found if plain else self._builder.extract_value(found, 0)
        raise TypeError(f'not known: {ast.unparse(node)}')

    def _as(self, kind: str, value: Any) -> Any:
        """Return a value where one of this kind is wanted."""
        wanted, builder = _TYPES[kind], self._builder
        if value.type == wanted:
            return value
        if kind == 'bool':
            return self._compared('!=', value, ir.Constant(value.type, 0))
        if kind == 'int':
            return builder.zext(value, wanted)
        return builder.sitofp(self._as('int', value), wanted)

    def _alike(self, kind: str, *nodes: ast.expr) -> list[Any]:
        return [self._as(kind, self._value(node)) for node in nodes]

    def _either(self, kind: str, test: ast.expr, *sides: ast.expr) -> Any:
        """Return one of two values; the other is not evaluated."""
        one, other = ((lambda node=node: self._alike(kind, node)[0]) for node in sides)
        ends = self._branch(test, one, other)
        found = self._builder.phi(_TYPES[kind])
        for value, block in ends:
            found.add_incoming(value, block)
        return found

    def _compared(self, sign: str, one: Any, other: Any) -> Any:
        if not _is_float(one):
            return self._builder.icmp_signed(sign, one, other)
        # What is no number differs from all, and is neither less nor more.
        compare = self._builder.fcmp_unordered if sign == '!=' else self._builder.fcmp_ordered
        return compare(sign, one, other)

    def _operation(self, op: ast.operator, one: Any, other: Any) -> Any:
        builder, real = self._builder, _is_float(one)
        if type(op) in _OPERATIONS:
            return getattr(builder, 'f' * real + _OPERATIONS[type(op)])(one, other)
        if isinstance(op, ast.Pow):
            return self._outside('pow', one, other)
        if isinstance(op, ast.Mod):
            return self._rest(one, other)
        if isinstance(op, ast.FloorDiv) and not real:
            return builder.sdiv(builder.sub(one, self._rest(one, other)), other)
        raise TypeError(f'not known: {op}')

    def _rest(self, one: Any, other: Any) -> Any:
        """Return what a division leaves, with the sign of the divisor as in Python."""
        builder, zero = self._builder, ir.Constant(one.type, 0)
        if _is_float(one):
            rest, none = builder.frem(one, other), self._exact('copysign', zero, other)
            turned = builder.fadd(rest, other)
        else:
            rest, none = builder.srem(one, other), zero
            turned = builder.add(rest, other)
        differ = builder.xor(*(self._compared('<', each, zero) for each in (rest, other)))
        own = builder.select(differ, turned, rest)
        return builder.select(self._compared('!=', rest, zero), own, none)

    # ---- calls

    def _call(self, node: ast.expr) -> Any:
        assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        name, given, builder = node.func.id, node.args, self._builder
        if name in self._made:
            function, _ = self._made[name]
            values = [self._value(each) for each in given]
            kinds = [_KINDS[each.type] for each in function.args]
            return builder.call(function, list(map(self._as, kinds, values)))
        if name in ('min', 'max'):
            best, *others = self._alike(self._kind(node), *given)
            for other in others:  # of equal ones the first
                less = self._compared('<' if name == 'min' else '>', other, best)
                best = builder.select(less, other, best)
            return best
        if name == 'int' and self._kind(given[0]) == 'float':
            return builder.fptosi(self._value(given[0]), _INT)
        if name in ('int', 'float'):
            return self._alike(name, given[0])[0]
        values = self._alike('float', *given)
        if name == 'isfinite':
            difference = builder.fsub(values[0], values[0])  # nan of what is not
            return self._compared('==', difference, ir.Constant(_FLOAT, 0.0))
        if name == 'isnan':
            return self._compared('!=', values[0], values[0])
        if name in _EXACT:
            found = self._exact(_EXACT[name], *values)
            # Python's is an integer, of which there is one zero.
            return builder.fadd(found, ir.Constant(_FLOAT, 0.0)) if name == 'floor' else found
        if name in _LIBRARY:
            return self._outside(name, *values)
        raise TypeError(f'not known: {ast.unparse(node)}')

    def _exact(self, name: str, *values: Any) -> Any:
        kind = ir.FunctionType(_FLOAT, [_FLOAT] * len(values))
        function = self._function.module.declare_intrinsic(f'llvm.{name}', [_FLOAT], kind)
        return self._builder.call(function, values)

    def _outside(self, name: str, *values: Any) -> Any:
        """Call the C library as it is: a power that is known becomes no root."""
        module = self._function.module
        if name not in module.globals:
            kind = ir.FunctionType(_FLOAT, [_FLOAT] * len(values))
            function = ir.Function(module, kind, name)
            for attribute in ('nobuiltin', 'readnone', 'nounwind'):
                function.attributes.add(attribute)
        return self._builder.call(module.globals[name], values)


def _is_float(value: Any) -> bool:
    return bool(value.type == _FLOAT)
