"""
The law of one design as the functions of a C file, with their tables.

The tables hold what Python's own ``expm1`` and ``exp`` gave, so that no C library is asked.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from copy import deepcopy
from math import exp
from typing import Any, NamedTuple

from nadrc_ros.adrc import observer, state, tick, transfer
from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.specialise.expressions import signature
from nadrc_ros.adrc.specialise.tidy import tidied
from nadrc_ros.adrc.specialise.values import Function
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.export.c_printer import c_name, Printed, Printer
from nadrc_ros.export.evaluated import Exported

# What the C calls by itself.
_ENTRIES = (
    *(tick.tick, transfer.adopt_reference, state.output_estimate, state.disturbance_estimate),
)
_INTEGERS = ('mode', 'cause', 'good', 'ENTRY')


class Source(NamedTuple):
    """
    The parts of a C file.

    ``members`` are those of the state of the law, which are so many ``numbers``; ``arrays`` are
    what the tables have, ``literal`` prints a number. Of what was printed, ``evaluated`` are the
    functions, which use what was ``called`` by name.
    """

    members: str
    numbers: int
    tables: str
    arrays: dict[str, list[Any]]
    functions: str
    tick_call: str
    adopt_call: str
    literal: Callable[[float], str]
    evaluated: list[Function]
    called: dict[str, Any]


def c_source(design: Design, period: float | None, real: str, name: str) -> Source:
    """
    Return the law at a fixed ``period`` [s], or with measured time steps (None).

    ``real`` is double or float, ``name`` what the names of types begin with.
    """
    return _Writer(design, period, real, name).source()


class _Writer:
    """The C text of one design, function by function."""

    def __init__(self, design: Design, period: float | None, real: str, name: str) -> None:
        self.design, self.period = design, period
        self.types = {'State': f'{name}_law'}
        self.types |= {'PolicyState': f'{name}_policy', 'Stall': f'{name}_stall'}
        self.printer = Printer(real, _INTEGERS, self.types)
        self.program = Exported(design, period)
        self.parameters: dict[str, list[str]] = {}

    def source(self) -> Source:
        """Write all functions, and what they need."""
        for function in _ENTRIES:
            self.program.add(function)
        functions = [self._print(*each) for each in self.program.functions.items()]
        blank = blank_state(self.design)
        members, numbers = [], 0
        for name in self.program.memory:
            value = getattr(blank, name)
            count, sizes = len(value), f'[{len(value)}]'
            if isinstance(value[0], list):
                count, sizes = count * len(value[0]), f'{sizes}[{len(value[0])}]'
            numbers += count
            members.append(f'    {self.printer.real} {name}{sizes};')
        arrays = self.arrays()
        return Source(
            '\n'.join(members),
            numbers,
            self.tables(arrays),
            arrays,
            '\n\n'.join(functions),
            self._call(
                'tick',
                state='&self->laws[self->current]',
                policy='&self->policy',
                sample_measurement='y',
                sample_span='span',
                sample_elapsed='elapsed',
                sample_applied='acting',
                sample_sent='sent',
                sample_downstream='downstream',
                sample_foreign='foreign',
                reference='self->reference',
                referenced='referenced',
                enabled='self->enabled',
                out='law',
                gives_1='&self->status',
                gives_2='&after',
            ),
            self._call(
                'adopt_reference',
                reference='self->reference',
                state='law',
                sent='sent',
                dt='elapsed',
                downstream='downstream',
            ),
            self.printer.literal,
            list(self.program.functions.values()),
            self.program.called,
        )

    def _call(self, name: str, **given: str) -> str:
        """Return the call of a function, with what its parameters are given by name."""
        return f'{name}({", ".join(given[each] for each in self.parameters[name])})'

    def _print(self, source: Any, function: Function) -> str:
        """Print a function; those that it calls are printed already."""
        real, printer = self.printer.real, self.printer
        prune = _Prune(printer.known)
        body = tidied([prune.visit(deepcopy(statement)) for statement in function.body])
        read = {name for statement in body for name in _reads(statement)}
        changed = _changed(body, printer.known)
        listed: list[str] = []
        used: list[int] = []
        known: dict[str, str] = {}
        parameters = list(signature(source).parameters.values())
        for i, parameter in enumerate(parameters):
            name = parameter.name
            if parameter.annotation == 'Sample':
                for field, kind in Sample.__annotations__.items():
                    own = f'sample_{field}'
                    if own in read:
                        known[own] = kind.__forward_arg__
                        listed.append(f'{printer.type_of(known[own])} {own}')
                continue
            if name not in read or parameter.annotation == 'Design':
                continue
            used.append(i)
            constant = '' if name in changed else 'const '
            match parameter.annotation:
                case 'State' | 'PolicyState':
                    listed.append(f'{constant}{self.types[parameter.annotation]} *{name}')
                case 'Vector':
                    listed.append(f'{constant}{real} *{name}')
                case 'Matrix':
                    listed.append(f'{real} (*{name})[{self.design.states}]')
                case kind:
                    known[name] = str(kind)
                    listed.append(f'{printer.type_of(known[name])} {c_name(name)}')
        for i, kind in enumerate(function.gives[1:], 1):
            listed.append(f'{self.types.get(kind) or printer.type_of(kind)} *gives_{i}')
        places = [place for place, i in enumerate(used) if parameters[i].name in changed]
        printer.known[function.name] = Printed(function.gives, used, places)
        self.parameters[function.name] = [each.split()[-1].strip('*') for each in listed]
        own = f'    {real} softened[{self.design.states}];\n' if 'softened' in read else ''
        head = printer.type_of(function.gives[0]) if function.gives else 'void'
        return (
            f'/* {source.__module__}.{source.__name__} */\n'
            f'static {head} {function.name}({", ".join(listed) or "void"})\n'
            f'{{\n{own}{printer.body(body, known)}\n}}'
        )

    # ---- tables

    @property
    def longest(self) -> int:
        """Return how many periods a step may span."""
        assert self.period is not None
        count = int(self.design.max_dt / self.period)
        return count if count * self.period <= self.design.max_dt else count - 1

    def arrays(self) -> dict[str, list[Any]]:
        """
        Return what is looked up by the number of periods since the last sample.

        That are the gains of each level, and dt / 1, 2, ..., with what decays over dt.
        """
        design, gains, times = self.design, [], []
        for k in range(1, self.longest + 1) if self.period is not None else ():
            dt = k * (self.period or 0.0)
            scratch = blank_state(design).scratch
            observer.place(design, dt, 1.0, scratch)
            gains.append(scratch[: design.levels])
            decays = [exp(rate * dt) for rate in self.program.decays]
            times.append([*scratch[design.levels][1:], *decays])
        return {'GAINS': gains, 'TIMES': times} if gains else {}

    def tables(self, arrays: dict[str, list[Any]]) -> str:
        """Return the tables that the functions read."""
        tables: dict[str, tuple[str, Any]] = {
            c_name(name): ('int', values)
            for name, values in self.program.called.items()
            if isinstance(values, tuple)
        }
        tables |= {name: (self.printer.real, values) for name, values in arrays.items()}
        return '\n\n'.join(
            f'static const {kind} {name}{"".join(f"[{size}]" for size in _shape(values))} = '
            f'{self._braced(values, kind)};'
            for name, (kind, values) in tables.items()
        )

    def _braced(self, values: Any, kind: str, depth: int = 0) -> str:
        if not isinstance(values, (list, tuple)):
            return self.printer.literal(values) if kind != 'int' else str(values)
        parts = [self._braced(each, kind, depth + 1) for each in values]
        if depth == 0 and kind != 'int':
            return '{\n    ' + ',\n    '.join(parts) + '\n}'
        return '{' + ', '.join(parts) + '}'


class _Prune(ast.NodeTransformer):
    """Leaves out the arguments that a function does not have in C."""

    def __init__(self, known: dict[str, Printed]) -> None:
        self.known = known

    def visit_Call(self, node: ast.Call) -> ast.Call:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in self.known:
            used = [node.args[i] for i in self.known[node.func.id].used]
            return ast.Call(node.func, used, [])
        return node


def _shape(values: Any) -> list[int]:
    return [len(values), *_shape(values[0])] if isinstance(values, (list, tuple)) else []


def _reads(statement: ast.stmt) -> set[str]:
    return {node.id for node in ast.walk(statement) if isinstance(node, ast.Name)}


def _changed(body: Sequence[ast.stmt], known: dict[str, Printed]) -> set[str]:
    """Return the names into which statements write, by subscripts or by calls."""
    found: set[str] = set()
    for statement in body:
        for node in ast.walk(statement):
            match node:
                case ast.Subscript(ctx=ast.Store()):
                    found.add(_root(node))
                case ast.Call(func=ast.Name(id=name), args=arguments) if name in known:
                    found |= {_root(arguments[i]) for i in known[name].changed}
    return found


def _root(node: ast.AST) -> str:
    match node:
        case ast.Name(id=name):
            return name
        case ast.Tuple(elts=[first, *_]):
            return _root(first)
        case ast.Attribute(value=value) | ast.Subscript(value=value):
            return _root(value)
    raise TypeError(ast.unparse(node))
