"""What is written as code of LLVM does what Python does with the same source, to the bit."""

from __future__ import annotations

from ctypes import c_double, POINTER
from inspect import signature
import math
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from law_helpers import bits
from nadrc_ros.adrc.specialise.python import defined, SCOPE
from nadrc_ros.simulation.compiled_law import _lowered
from nadrc_ros.simulation.lowering import lower
import numba
from numba import types
import numpy as np
import pytest

# All that the evaluator leaves of a function, and what Python does in its own way.
SOURCE = """
def apart(x: float, n: int, row: Vector) -> (float, int, bool):
    if x > 0.0:
        return (row[0] - x, n, True)
    row[1] = 7.0
    return (x, -n, False)

def one(x: float) -> (float,):
    return x * 0.5

def whole(given: Vector, out: Vector) -> ():
    x = given[0]
    y = given[1]
    n = int(given[2])
    m = int(given[3])
    out[0] = x % y if y != 0.0 else 0.0
    out[1] = n % m if m != 0 else 0
    out[2] = n // m if m != 0 else 0
    out[3] = min(x, y, 1.0)
    out[4] = max(x, y, 1.0)
    out[5] = abs(x) ** 0.5
    out[6] = abs(x) ** -0.5 if x != 0.0 else -0.0
    out[7] = x < y <= 3.0
    out[8] = x != y
    out[9] = not x == y
    out[10] = isfinite(x) and (not isnan(y)) or x > 1.0
    out[11] = exp(-abs(x)) + expm1(-abs(y)) + log(1.0 + abs(x)) if isfinite(x + y) else nan
    out[12] = copysign(x, y)
    out[13] = floor(x) if isfinite(x) else -inf
    out[14] = sqrt(abs(x)) + (sin(x) if isfinite(x) else 0.0)
    a, b = (y, x)
    a, b = (b - a, a / 3)
    out[15] = a
    out[16] = b
    total = 0
    for i in range(5):
        for j in range(4, i - 1, -1):
            total = total + TABLE[j] * i
            i = 2 * i
    out[17] = total
    kind = 3
    while kind > 0 and x * kind < y:
        kind = kind - 1
        total = 0.5 * total
    out[18] = kind + total
    r, k, good = apart(x, n, out[19:21])
    out[21] = r
    out[22] = k
    out[23] = good
    out[24] = last = one(y) + (n if good else 0.25)
    if last > 1e3:
        out[25] = REALS[1]
        return
    out[25] = -last
"""
TABLES: dict[str, Any] = {'TABLE': (3, 1, -4, 1, 5), 'REALS': (0.1, 0.7)}
SIZE = 26


@pytest.fixture(scope='module')
def compiled() -> Any:
    law = _lowered(SOURCE, TABLES, 'whole', 'test', signature(lambda given, out: None))
    function = defined('f', 'def f(given, out): law(given, out)', {'law': law}, __file__)
    return numba.cfunc(types.void(*[types.CPointer(types.float64)] * 2))(function).ctypes


class Row(list[float]):
    """A list whose parts are itself, as those of an array are."""

    def __getitem__(self, key: Any) -> Any:
        return Part(self, key.start) if isinstance(key, slice) else super().__getitem__(key)


class Part:
    """What begins in the middle of a row."""

    def __init__(self, row: Row, begin: int) -> None:
        self.row, self.begin = row, begin

    def __getitem__(self, i: int) -> Any:
        return self.row[self.begin + i]

    def __setitem__(self, i: int, value: float) -> None:
        self.row[self.begin + i] = value


@given(
    st.floats(allow_subnormal=False) | st.sampled_from([0.0, -0.0, 1.0, -3.0]),
    st.floats(allow_subnormal=False) | st.sampled_from([0.0, -0.0, 2.0, -1.5]),
    st.integers(-9, 9),
    st.integers(-4, 4),
)
def test_each_operation_is_that_of_python(
    compiled: Any, x: float, y: float, n: int, m: int
) -> None:
    expected = Row([0.0] * SIZE)
    scope = SCOPE | TABLES | {'Vector': None, 'isfinite': math.isfinite}
    try:
        defined('whole', SOURCE, scope, __file__)([x, y, n, m], expected)
    except OverflowError:  # of a power, a rest or a floor: here infinity comes of it
        return
    numbers, found = np.array([x, y, n, m], dtype=float), np.zeros(SIZE)
    compiled(*(each.ctypes.data_as(POINTER(c_double)) for each in (numbers, found)))
    assert bits(found.tolist()) == bits([float(each) for each in expected])


@pytest.mark.parametrize('line', ['del x', 'y = x @ x', 'y = cosh(x)', 'y = [x]'])
def test_what_is_not_known_is_named(line: str) -> None:
    from llvmlite import ir

    with pytest.raises((TypeError, KeyError), match=r'not known|cosh'):
        lower(ir.Module(), f'def f(x: float) -> ():\n    {line}\n', {}, '')
