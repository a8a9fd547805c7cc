"""
The law compiled by numba, by itself for each shape of a design, and how a loop calls it.

A loop gets the address of a function as an argument: so it is compiled once for all shapes, and a
shape once for all loops.
"""

from __future__ import annotations

from hashlib import sha256
from inspect import getsource, Parameter, Signature, signature
from typing import Any
from warnings import filterwarnings

from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.specialise import kinds
from nadrc_ros.adrc.specialise.program import shape_of
from nadrc_ros.adrc.specialise.python import defined
from nadrc_ros.simulation import lowering, period
from nadrc_ros.simulation.flat import sources
import numba
from numba import NumbaExperimentalFeatureWarning, types
from numba.extending import intrinsic

# Functions that are arguments are such a feature.
filterwarnings('ignore', category=NumbaExperimentalFeatureWarning)
_VECTOR, _NUMBER = types.CPointer(types.float64), types.float64
_SIGNATURES = {
    'regular_period': types.void(*[_VECTOR] * 6),
    'period': types.void(*[_VECTOR] * 6),
    'realise': types.void(*[_VECTOR] * 3, _NUMBER),
    'estimate_derivatives': types.void(*[_VECTOR] * 3, _NUMBER, _NUMBER),
}


def compiled_law(design: Design) -> dict[str, Any]:
    """
    Return the functions of :mod:`~nadrc_ros.simulation.period` for designs of this shape.

    Each is compiled, or read from disk, when it is first asked for.
    """
    shape = shape_of(design)
    if shape not in _LAWS:
        _LAWS[shape] = _Law(design)
    return _LAWS[shape]


class _Law(dict[str, Any]):
    """The compiled functions of one shape by name."""

    def __init__(self, design: Design) -> None:
        super().__init__()
        self._design = design

    def __missing__(self, name: str) -> Any:
        made_of = getattr(period, name)
        code, scope = sources(self._design, [made_of])
        parts = *code.values(), repr(shape_of(self._design)), *map(getsource, (kinds, lowering))
        digest = sha256(repr(parts).encode()).hexdigest()[:16]
        arguments = signature(made_of).replace(return_annotation=None)
        # As if from this file: what is kept on disk lies beside a file that there is. The name
        # is that of the symbol, also of a function that another one on disk brings along: of
        # two of one name the linker takes the first, which may be that of another shape.
        names = ', '.join(arguments.parameters)
        law = _lowered('\n'.join(code.values()), scope, name, digest, arguments)
        function = defined(name, f'def {name}({names}): law({names})', {'law': law}, __file__)
        function.__qualname__ = f'{name}_{digest}'
        function.__module__ = __name__
        self[name] = made = numba.cfunc(_SIGNATURES[name], nopython=True, cache=True)(function)
        return made


def _lowered(
    source: str, scope: dict[str, Any], name: str, digest: str, arguments: Signature
) -> Any:
    """Return what numba takes for a function, whose code is that of a source."""

    def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        lowering.lower(builder.module, source, scope, f'_{digest}')
        builder.call(builder.module.globals[f'{name}_{digest}'], values)
        return context.get_dummy_value()

    def law(context: Any, *given: Any) -> Any:
        return types.void(*given), codegen

    context = Parameter('context', Parameter.POSITIONAL_OR_KEYWORD)
    law.__signature__ = arguments.replace(  # type: ignore[attr-defined]
        parameters=[context, *arguments.parameters.values()]
    )
    return intrinsic(law)


_LAWS: dict[Any, _Law] = {}


@intrinsic
def unowned(context: Any, value: Any) -> Any:
    """
    Return ``value`` with arrays that are not counted: the caller keeps them alive.

    The loop swaps states each period. Counted, each of these takes and gives back a reference.
    """

    def strip(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, value)
            array.meminfo = array.meminfo.type(None)
            return array._getvalue()
        if isinstance(kind, types.BaseTuple):
            for i, part in enumerate(kind):
                stripped = strip(context, builder, part, builder.extract_value(value, i))
                value = builder.insert_value(value, stripped, i)
        return value

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return strip(context, builder, signature.args[0], args[0])

    return value(value), codegen


@intrinsic
def address(context: Any, array: Any) -> Any:
    """Return the address of what an array holds: one word, where the array itself is seven."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), codegen
