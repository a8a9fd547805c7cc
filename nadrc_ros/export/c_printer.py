"""Statements of the partial evaluator as C99: the same operations in the same order."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from ctypes import c_float
from math import isinf, isnan
from typing import NamedTuple

from nadrc_ros.adrc.specialise.kinds import Kinds, widest

# Those that C has for each kind of number, with the ending f for float.
_OF_MATH = {'exp', 'expm1', 'sqrt', 'sin', 'log', 'floor', 'copysign', 'fabs', 'pow'}
_OPERATORS: dict[type, str] = {
    ast.Add: '+',
    ast.Sub: '-',
    ast.Mult: '*',
    ast.Div: '/',
    ast.Lt: '<',
    ast.LtE: '<=',
    ast.Gt: '>',
    ast.GtE: '>=',
    ast.Eq: '==',
    ast.NotEq: '!=',
    ast.And: '&&',
    ast.Or: '||',
}
# Names that mean something else in C.
_RESERVED = frozenset(
    (
        *('auto', 'break', 'case', 'char', 'const', 'continue', 'default', 'do', 'double', 'else'),
        *('enum', 'extern', 'float', 'for', 'goto', 'if', 'inline', 'int', 'long', 'register'),
        *('restrict', 'return', 'short', 'signed', 'sizeof', 'static', 'struct', 'switch'),
        *('typedef', 'union', 'unsigned', 'void', 'volatile', 'while', 'y0', 'y1', 'yn', 'j0'),
        *('j1', 'jn', 'gamma'),
    )
)
_PAD = '    '


class Printed(NamedTuple):
    """
    A function that was printed.

    ``gives`` are the kinds of what it returns, ``used`` the parameters of the source that it has,
    by their place, and ``changed`` those of its own into which it writes.
    """

    gives: Sequence[str]
    used: Sequence[int]
    changed: Sequence[int]


class Printer:
    """
    Prints the bodies of functions.

    Parameters
    ----------
    real
        ``double`` or ``float``.
    integers
        The last names of places in memory that have integers; all others have reals.
    types
        The types of what the law has as named tuples, by the names of these.

    Attributes
    ----------
    known
        The functions that may be called, by name: those printed before.

    """

    def __init__(self, real: str, integers: Sequence[str], types: Mapping[str, str]) -> None:
        self.real = real
        self.known: dict[str, Printed] = {}
        self._integers, self._types = frozenset(integers), types
        self._stores: Counter[str] = Counter()
        self._known_uses: dict[int, frozenset[str]] = {}

    def body(self, statements: Sequence[ast.stmt], parameters: Mapping[str, str]) -> str:
        """Return the statements of a function, whose ``parameters`` have kinds by name."""
        self._known_uses = {}
        self._stores = Counter(name.id for name in _names(statements, ast.Store))
        kinds = Kinds(statements, parameters, lambda name: self.known[name].gives, self._entry)
        self._kinds, self._kind = kinds.names, kinds.of
        return '\n'.join(self._block(statements, 1, set(parameters)))

    def type_of(self, kind: str) -> str:
        """Return the type of a kind."""
        return self.real if kind == 'float' else kind

    def literal(self, value: float) -> str:
        """Return a number in full."""
        if self.real == 'float':
            value = c_float(value).value
        cast = '(double)' if self.real == 'double' else ''
        if isnan(value):
            return f'{cast}NAN'
        if isinf(value):
            return f'{cast}INFINITY' if value > 0.0 else f'-{cast}INFINITY'
        digits, _, exponent = value.hex().partition('p')
        if '.' in digits:
            digits = digits.rstrip('0').removesuffix('.')
        return f'{digits or "0"}p{exponent}' + ('F' if self.real == 'float' else '')

    # ---- statements

    def _block(self, statements: Sequence[ast.stmt], depth: int, known: set[str]) -> list[str]:
        """Print a block; a name is declared in the innermost one that has all its uses."""
        known = set(known)
        pad = _PAD * depth
        lines: list[str] = []
        later: Counter[str] = Counter(name for each in statements for name in self._uses(each))
        for statement in statements:
            uses = self._uses(statement)
            later.subtract(uses)
            begun: set[str] = set()
            for name in sorted((uses & self._kinds.keys()) - known):
                if later[name] == 0 and self._inside(statement, name):
                    continue
                known.add(name)
                match statement:
                    case ast.Assign(targets=[ast.Name(id=first), *_]) if first == name:
                        begun.add(name)
                    case _:
                        lines.append(f'{pad}{self.type_of(self._kinds[name])} {c_name(name)};')
            match statement:
                case ast.Assign():
                    lines += [pad + line for line in self._assign(statement, begun)]
                case ast.If():
                    lines += [f'{pad}if ({self.text(statement.test)})', f'{pad}{{']
                    lines += [*self._block(statement.body, depth + 1, known), f'{pad}}}']
                    if statement.orelse:
                        lines += self._else(statement.orelse, depth, known)
                case ast.While():
                    lines += [f'{pad}while ({self.text(statement.test)})', f'{pad}{{']
                    lines += [*self._block(statement.body, depth + 1, known), f'{pad}}}']
                case ast.Return(value=value):
                    lines += [pad + line for line in self._return(value)]
                case ast.Expr(value=value):
                    lines.append(f'{pad}{self.text(value)};')
                case _:
                    raise TypeError(f'no C for {ast.unparse(statement)}')
        return lines

    def _uses(self, statement: ast.stmt) -> frozenset[str]:
        """Return all names in a statement."""
        if id(statement) not in self._known_uses:
            if isinstance(statement, ast.If):
                found = {name.id for name in _names([ast.Expr(statement.test)])}
                found.update(*map(self._uses, (*statement.body, *statement.orelse)))
            else:
                found = {name.id for name in _names([statement])}
            self._known_uses[id(statement)] = frozenset(found)
        return self._known_uses[id(statement)]

    def _inside(self, statement: ast.stmt, name: str) -> bool:
        """Tell whether all uses of a name are in one block inside of a statement."""
        if not isinstance(statement, ast.If):
            return False
        if any(each.id == name for each in _names([ast.Expr(statement.test)])):
            return False
        branches = statement.body, statement.orelse
        return sum(any(name in self._uses(each) for each in branch) for branch in branches) == 1

    def _else(self, statements: Sequence[ast.stmt], depth: int, known: set[str]) -> list[str]:
        pad = _PAD * depth
        first, *rest = self._block(statements, depth, known)
        if len(statements) == 1 and first.startswith(f'{pad}if '):
            return [f'{pad}else {first.lstrip()}', *rest]
        return [f'{pad}else', f'{pad}{{', *self._block(statements, depth + 1, known), f'{pad}}}']

    def _assign(self, statement: ast.Assign, begun: set[str]) -> Iterator[str]:
        first, *rest = statement.targets
        file, number = getattr(statement, 'source', ('', 0))
        note = f' /* {file.rpartition("/")[2]}:{number} */' if file else ''
        if isinstance(first, ast.Tuple):
            head, *others = (c_name(each.id) for each in first.elts)  # type: ignore[attr-defined]
            call = self.text(statement.value)[:-1]
            yield f'{head} = {", ".join([call, *(f"&{name}" for name in others)])});{note}'
            return
        target = self.text(first)
        head = ''
        if isinstance(first, ast.Name) and first.id in begun:
            constant = 'const ' if self._stores[first.id] == 1 else ''
            head = f'{constant}{self.type_of(self._kinds[first.id])} '
        yield f'{head}{target} = {self._as(statement.value, self._kind(first))};{note}'
        for each in rest:
            yield f'{self.text(each)} = {target};'

    def _return(self, value: ast.expr | None) -> Iterator[str]:
        """Return the first value, and hand the others over by the pointers ``gives_1`` etc."""
        if value is None:
            yield 'return;'
            return
        parts = value.elts if isinstance(value, ast.Tuple) else [value]
        for i, part in enumerate(parts[1:], 1):
            yield f'*gives_{i} = {self.text(part)};'
        yield f'return {self.text(parts[0])};'

    # ---- expressions

    def _entry(self, node: ast.expr) -> str:
        """Return the kind of what is read from a place in memory."""
        match node:
            case ast.Attribute(attr=name):
                return 'int' if name in self._integers else 'float'
            case ast.Subscript(value=ast.Attribute() as value):
                return self._entry(value)
            case ast.Subscript(value=value):
                return 'int' if c_name(_base(value)) in self._integers else 'float'
        return 'float'

    def _as(self, node: ast.expr, kind: str) -> str:
        """Return an expression where one of this kind is wanted."""
        own = self._kind(node)
        match node:
            case ast.Constant(value=float() | int() as value) if kind == 'float':
                return self.literal(float(value))
        return (
            f'({self.real}){self._part(node)}'
            if kind == 'float' and own in ('int', 'bool')
            else self.text(node)
        )

    def _part(self, node: ast.expr, kind: str = '') -> str:
        """Return an expression as a part of another one."""
        whole = self._as(node, kind) if kind else self.text(node)
        simple = isinstance(node, (ast.Name, ast.Attribute, ast.Subscript, ast.Call, ast.Constant))
        return whole if simple and whole[0] not in '-(' else f'({whole})'

    def text(self, node: ast.expr) -> str:
        """Return an expression."""
        match node:
            case ast.Constant(value=float() as value):
                return self.literal(value)
            case ast.Constant(value=bool() as value):
                return str(value).lower()
            case ast.Constant(value=int() as value):
                return str(value)
            case ast.Name(id=name):
                return self.literal(float(name)) if name in ('nan', 'inf') else c_name(name)
            case ast.Attribute(value=value, attr=name):
                link = '.' if isinstance(value, ast.Attribute) else '->'
                return f'{self.text(value)}{link}{name}'
            case ast.Subscript(value=value, slice=index):
                return f'{self.text(value)}[{self.text(index)}]'
            case ast.BinOp(op=ast.Pow(), left=left, right=right):
                return self._call('pow', left, right)
            case ast.BinOp(op=op, left=left, right=right):
                kind = self._kind(node)
                return f'{self._part(left, kind)} {_OPERATORS[type(op)]} {self._part(right, kind)}'
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return f'!{self._part(operand)}'
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return f'-{self._part(operand)}'
            case ast.BoolOp(op=op, values=values):
                return f' {_OPERATORS[type(op)]} '.join(map(self._part, values))
            case ast.Compare(left=left, ops=ops, comparators=comparators):
                return self._compare([left, *comparators], ops)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                kind = self._kind(node)
                return (
                    f'{self._part(test)} ? {self._part(body, kind)} : {self._part(orelse, kind)}'
                )
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self._call(name, *arguments)
            case ast.Tuple(elts=[ast.Subscript(value=matrix), *_]):  # by its rows
                return self.text(matrix)
        raise TypeError(f'no C for {ast.unparse(node)}')

    def _compare(self, values: Sequence[ast.expr], ops: Sequence[ast.cmpop]) -> str:
        pairs = []
        for op, left, right in zip(ops, values, values[1:]):
            kind = widest(self._kind(left), self._kind(right))
            pairs.append(
                f'{self._part(left, kind)} {_OPERATORS[type(op)]} {self._part(right, kind)}'
            )
        return pairs[0] if len(pairs) == 1 else ' && '.join(f'({pair})' for pair in pairs)

    def _call(self, name: str, *arguments: ast.expr) -> str:
        if name in self._types:
            return f'({self._types[name]}){{{", ".join(map(self.text, arguments))}}}'
        if name in self.known:
            return f'{c_name(name)}({", ".join(map(self.text, arguments))})'
        if name == 'float':
            return self._as(arguments[0], 'float')
        if name == 'int':
            return f'(int){self._part(arguments[0])}'
        kind = widest(*map(self._kind, arguments))
        if name in ('min', 'max'):
            whole, *others = (self._part(each, kind) for each in arguments)
            sign = '<' if name == 'min' else '>'
            for other in others:  # of equal ones Python takes the first
                whole = f'(({other} {sign} {whole}) ? {other} : {whole})'
            return whole
        if name == 'abs':
            name = 'fabs'
        if name in ('isfinite', 'isnan'):
            return f'({name}({self.text(arguments[0])}) != 0)'
        kind = 'float' if name in _OF_MATH else ''
        parts = ', '.join(self._as(each, kind) if kind else self.text(each) for each in arguments)
        ending = 'f' if name in _OF_MATH and self.real == 'float' else ''
        return f'{name}{ending}({parts})'


def c_name(name: str) -> str:
    """Return a name that C can have."""
    return f'{name}_' if name in _RESERVED else name.strip('_')


def _base(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else ''


def _every(statements: Sequence[ast.stmt]) -> Iterator[ast.AST]:
    for statement in statements:
        yield from ast.walk(statement)


def _names(statements: Sequence[ast.stmt], context: type = ast.expr_context) -> Iterator[ast.Name]:
    for node in _every(statements):
        if isinstance(node, ast.Name) and isinstance(node.ctx, context):
            yield node
