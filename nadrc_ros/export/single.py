"""
The law with float32, in Python: what C with ``float`` gives, to the bit.

The evaluated functions of an export, run on numbers of NumPy of single precision.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from copy import deepcopy
from math import isfinite, isnan, nan
from typing import Any

from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.specialise.values import Function, load, store
from nadrc_ros.adrc.state import State
from nadrc_ros.export.c_source import Source
from nadrc_ros.export.twin import Twin
import numpy as np


class SingleTwin(Twin):
    """A twin that computes with float32 throughout."""

    def __init__(self, settings: ControllerSettings, period: float, source: Source) -> None:
        self._tick = _compiled(source, make_design(settings).states)
        super().__init__(settings, float(np.float32(period)))

    def init(self, y: float, u: float) -> None:
        """Begin anew, with numbers of single precision."""
        with np.errstate(all='ignore'):
            super().init(float(np.float32(y)), float(np.float32(u)))
        controller = self.controller
        for state in (controller.state, controller._next):
            _convert(state)
        controller.command = np.float32(controller.command)
        controller.policy = type(controller.policy)(*map(_single, controller.policy))
        controller._law = self._tick
        self._waited = np.float32(0.0)

    def step(
        self,
        y: float,
        reference: Sequence[float] | None = None,
        applied: float = nan,
        dt: float = nan,
    ) -> float:
        """Take a sample."""
        with np.errstate(all='ignore'):  # numbers that are none are part of a life
            given = [np.float32(each) for each in reference] if reference else None
            super().step(np.float32(y), given, np.float32(applied))
        return self._rounded()

    def no_sample(self, dt: float = nan) -> float:
        """Let a tick pass without one."""
        with np.errstate(all='ignore'):
            super().no_sample()
        return self._rounded()

    def _rounded(self) -> float:
        self.controller.command = np.float32(self.controller.command)
        return self.controller.command

    def _elapsed(self, dt: float) -> Any:
        return np.float32(self._period)


def _convert(state: State) -> None:
    for row in state.rows:
        row[:] = map(np.float32, row)


def _single(value: Any) -> Any:
    if isinstance(value, tuple):
        return type(value)(*map(_single, value))
    return np.float32(value) if isinstance(value, float) else value


class _Constants(ast.NodeTransformer):
    """Gives every number of the code a name, for that number in single precision."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        if not isinstance(node.value, float):
            return node
        name = f'number_{node.value.hex()}'.translate(_IN_NAMES)
        self.values[name] = np.float32(node.value)
        return load(name)


_IN_NAMES = str.maketrans({'.': '_', '-': 'm', '+': 'p'})


def _compiled(source: Source, states: int) -> Any:
    """Return ``tick`` for numbers of single precision."""
    constants = _Constants()
    functions: list[ast.stmt] = []
    for function in source.evaluated:
        functions.append(constants.visit(_definition(deepcopy(function), states)))
    module = ast.fix_missing_locations(ast.Module(functions, []))
    scope: dict[str, Any] = {
        'sqrt': np.sqrt,
        'copysign': np.copysign,
        'isfinite': isfinite,
        'isnan': isnan,
        'nan': np.float32(nan),
        'inf': np.float32(np.inf),
        **source.called,
        **constants.values,
        **{name: np.asarray(table, dtype=np.float32) for name, table in source.arrays.items()},
    }
    exec(compile(module, '<float32>', 'exec'), scope)
    return scope['tick']


def _definition(function: Function, states: int) -> ast.FunctionDef:
    names = list(function.parameters)
    head: list[ast.stmt] = []
    if 'sample' in names:
        used = {
            node.id
            for part in function.body
            for node in ast.walk(part)
            if isinstance(node, ast.Name)
        }
        for name in sorted(each for each in used if each.startswith('sample_')):
            field = ast.Attribute(load('sample'), name.removeprefix('sample_'), ast.Load())
            head.append(ast.Assign([store(name)], field))
    zeros = ast.List([ast.Constant(0)] * states, ast.Load())
    head.append(ast.Assign([store('softened')], zeros))
    arguments = ast.arguments([], [ast.arg(name) for name in names], None, [], [], None, [])
    return ast.FunctionDef(function.name, arguments, [*head, *function.body], [], None)
