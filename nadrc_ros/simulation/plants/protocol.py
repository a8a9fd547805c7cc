"""
What a plant is, and the check that a class is one.

Convention: the first n states are y, y', ..., y^(n-1) with n the order, further states are
internal. Hence dx[i] = x[i+1] for i < n-1, y^(n) = dx[n-1], and the output is x[0].

A plant of one's own may be any class with these members: plain, dataclass or attrs. To be compiled
as well, ``derivative`` uses nothing but its arguments, ``math``, and those fields of ``self`` that
are numbers or lists of numbers and have no leading underscore; otherwise it runs in plain Python.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any, Protocol

from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.simulation.vector import MutableVector, Vector

MAX_ORDER = 5
MAX_STATES = 100


class Plant(Protocol):
    """A single-input single-output plant y^(n) = f(t, x, u) + w."""

    @property
    def order(self) -> int:
        """Nominal relative degree n from u to y, 1 to 5: the order the controller assumes."""
        ...

    @property
    def b0(self) -> float:
        """Nominal input gain b0 [unit of y^(n) per unit of u], not 0."""
        ...

    @property
    def states(self) -> int:
        """Return the number of states, at least the order."""
        ...

    def derivative(self, t: float, x: Vector, u: float, w: float, dx: MutableVector) -> None:
        """
        Write dx/dt at time ``t`` [s] into ``dx``, which is never ``x`` itself.

        ``u`` is the command and ``w`` an exogenous disturbance in units of y^(n).
        """
        ...

    def output(self, x: Vector) -> float:
        """Return the noise-free output y = x[0]."""
        ...


def total_disturbance(
    plant: Plant, b0: float, t: float, x: Vector, u: float, w: float, dx: MutableVector
) -> float:
    """
    Return L = y^(n) - b0 u [unit of y^(n)], everything in y^(n) that b0 u does not explain.

    Source: the paper (Abdul-Adheem & Ibraheem, nested linear extended state observers), section 2,
    L = f + w, with a known input gain b0 written out. ``dx`` is overwritten with the derivative.
    """
    return unexplained(type(plant).derivative, plant, b0, t, x, u, w, dx)


def unexplained(
    derivative: Callable[[Any, float, Vector, float, float, MutableVector], None],
    plant: Any,
    b0: float,
    t: float,
    x: Vector,
    u: float,
    w: float,
    dx: MutableVector,
) -> float:
    """Return :func:`total_disturbance` with the method beside its object, so that it compiles."""
    derivative(plant, t, x, u, w, dx)
    return dx[plant.order - 1] - b0 * u


def check_plant(plant: Any) -> Plant:
    """
    Return ``plant`` if it keeps the convention, after probing it at a few fixed states.

    Raises
    ------
    SettingError
        Names the member that is missing or wrong, the value found and what is allowed.

    """
    order = _whole(plant, 'order', 1, MAX_ORDER)
    states = _whole(plant, 'states', order, MAX_STATES)
    b0 = _member(plant, 'b0')
    if not _finite(b0) or b0 == 0:
        raise SettingError('plant.b0', b0, 'a finite number, not 0')
    for name in ('derivative', 'output'):
        if not callable(_member(plant, name)):
            raise SettingError(f'plant.{name}', getattr(plant, name), 'a method')
    for probe in range(4):
        _check_at(plant, order, probe_state(states, probe), probe)
    checked: Plant = plant
    return checked


def probe_state(states: int, probe: int) -> list[float]:
    """Return fixed state number ``probe``: zero for 0, then of mixed sign, entries distinct."""
    return [probe * (0.3 + 0.17 * i) * (-1.0) ** (i + probe) for i in range(states)]


def _check_at(plant: Any, order: int, x: list[float], probe: int) -> None:
    t, u, w = 0.7 * probe, 0.4 * probe - 0.5, 0.2 * probe - 0.3
    before, dx = list(x), [float('nan')] * len(x)
    try:
        type(plant).derivative(plant, t, x, u, w, dx)
    except Exception as error:
        raise SettingError(
            'plant.derivative', error, 'a method (t, x, u, w, dx) that works at any finite state'
        ) from error
    if x != before:
        raise SettingError('plant.derivative', x, f'leaving its input x = {before} as it is')
    if len(dx) != len(x) or not all(map(_finite, dx)):
        raise SettingError('plant.derivative', dx, f'writing {len(x)} finite numbers into dx')
    for i in range(order - 1):
        if dx[i] != x[i + 1]:
            raise SettingError(
                f'plant.derivative: dx[{i}]',
                dx[i],
                f"x[{i + 1}] = {x[i + 1]:g} (y, y', ... first)",
            )
    try:
        y = type(plant).output(plant, x)
    except Exception as error:
        raise SettingError('plant.output', error, 'a method (x) that returns x[0]') from error
    if not _finite(y) or y != x[0]:
        raise SettingError('plant.output', y, f'x[0] = {x[0]:g}')


def _whole(plant: Any, name: str, low: int, high: int) -> int:
    value = _member(plant, name)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise SettingError(f'plant.{name}', value, f'an integer from {low} to {high}')
    return value


def _member(plant: Any, name: str) -> Any:
    try:
        return getattr(plant, name)
    except AttributeError:
        raise SettingError(f'plant.{name}', 'missing', 'an attribute of the plant') from None


def _finite(value: Any) -> bool:
    """Tell whether ``value`` is a finite real number (a NumPy scalar too, a flag not)."""
    if isinstance(value, bool):
        return False
    try:
        return isfinite(value)
    except TypeError:
        return False
