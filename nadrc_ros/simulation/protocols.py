"""
What plants and signals are, and the checks that a class of one's own is one.

A plant or a signal may be any class with these members: plain, dataclass or attrs. To be compiled
as well, ``derivative`` and ``derivatives`` use nothing but their arguments, ``math``, and those
fields of ``self`` that are numbers or lists of numbers and have no leading underscore; otherwise
they run in plain Python.
"""

from __future__ import annotations

from collections.abc import Callable
from math import floor, isfinite, nan
from typing import Any, Protocol

from nadrc_ros.adrc.errors import SettingError

MAX_ORDER = 5
_MOST_STATES = 100
_MOST_ENTRIES = 6
_PROBES = 4


class Vector(Protocol):
    """
    Floats that are read by index.

    A list (fast in plain Python) and a one-dimensional array (fast when compiled) are both.
    """

    def __getitem__(self, index: int, /) -> float:
        """Return the entry at ``index``."""
        ...

    def __len__(self) -> int:
        """Return the number of entries."""
        ...


class MutableVector(Vector, Protocol):
    """A buffer that results are written into by index."""

    def __setitem__(self, index: int, value: float, /) -> None:
        """Write the entry at ``index``."""
        ...


class Plant(Protocol):
    """
    A single-input single-output plant y^(n) = f(t, x, u) + w.

    The first n states are y, y', ..., y^(n-1) with n the order, further states are internal. Hence
    dx[i] = x[i+1] for i < n-1, y^(n) = dx[n-1], and the output is x[0].
    """

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


class Signal(Protocol):
    """A scalar function of time, used as reference or as disturbance."""

    def derivatives(self, t: float, out: MutableVector) -> None:
        """
        Write s(t), s'(t), ... into ``out``: 1 to 6 entries, the k-th in unit/s^k.

        All but the first are 0 before: one that is not known is left as it is.

        At a jump or a corner the right-hand value is written, without the impulse of a jump.
        """
        ...


# The methods as functions of a class, which is what numba compiles.
Derivative = Callable[[Any, float, Vector, float, float, MutableVector], None]
Derivatives = Callable[[Any, float, MutableVector], None]


def sample_time(k: int, rate: float, own_rate: float) -> float:
    """Return k / rate, or the last multiple of 1 / own_rate until then if that is not 0."""
    if own_rate > 0.0:
        # Of two rates with a common divisor, a sample that should fall on a period does.
        return floor(k / rate * own_rate * (1.0 + 1e-12)) / own_rate
    return k / rate


def total_disturbance(
    derivative: Derivative,
    plant: Any,
    b0: float,
    t: float,
    x: Vector,
    u: float,
    w: float,
    dx: MutableVector,
) -> float:
    """
    Return L = y^(n) - b0 u [unit of y^(n)], everything in y^(n) that b0 u does not explain.

    Source: the paper (Abdul-Adheem & Ibraheem, nested linear extended state observers), section 2,
    L = f + w, with a known input gain b0 written out. So that this compiles, ``derivative`` is
    ``type(plant).derivative``; ``dx`` is overwritten with the derivative.
    """
    derivative(plant, t, x, u, w, dx)
    return dx[plant.order - 1] - b0 * u


def probe_states(states: int) -> list[list[float]]:
    """Return the fixed states at which plants are tried: zero, and some of mixed sign."""
    return [
        [probe * (0.3 + 0.17 * i) * (-1.0) ** (i + probe) for i in range(states)]
        for probe in range(_PROBES)
    ]


def check_plant(plant: Any) -> Plant:
    """
    Return ``plant`` if it keeps the convention, after probing it at a few fixed states.

    Raises
    ------
    SettingError
        Names the member that is missing or wrong, the value found and what is allowed.

    """
    order = _member(plant, 'order', 1, MAX_ORDER)
    states = _member(plant, 'states', order, _MOST_STATES)
    b0 = _member(plant, 'b0')
    if not _finite(b0) or b0 == 0:
        raise SettingError('plant.b0', b0, 'a finite number, not 0')
    for name in ('derivative', 'output'):
        if not callable(_member(plant, name)):
            raise SettingError(f'plant.{name}', getattr(plant, name), 'a method')
    for probe, x in enumerate(probe_states(states)):
        _check_at(plant, order, x, probe)
    checked: Plant = plant
    return checked


def check_signal(signal: Any) -> Signal:
    """
    Return ``signal`` if its method works, after probing it at a few times for every length.

    Raises
    ------
    SettingError
        Says what its method does wrong.

    """
    for t in (0.0, 0.1, 1.7, 60.0):
        for entries in range(1, _MOST_ENTRIES + 1):
            out = [nan, *[0.0] * (entries - 1)]
            try:
                type(signal).derivatives(signal, t, out)
            except Exception as error:
                raise SettingError(
                    'derivatives', error, 'a method (t, out) for out of any length from 1 to 6'
                ) from error
            if len(out) != entries or not all(map(_finite, out)):
                raise SettingError(
                    'derivatives', out, f'writing finite numbers into out, at least out[0] ({t=})'
                )
    checked: Signal = signal
    return checked


def _check_at(plant: Any, order: int, x: list[float], probe: int) -> None:
    t, u, w = 0.7 * probe, 0.4 * probe - 0.5, 0.2 * probe - 0.3
    before, dx = list(x), [nan] * len(x)
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


def _member(plant: Any, name: str, *bounds: int) -> Any:
    """Return an attribute; an integer from ``bounds[0]`` to ``bounds[1]``, if they are given."""
    try:
        value = getattr(plant, name)
    except AttributeError:
        raise SettingError(f'plant.{name}', 'missing', 'an attribute of the plant') from None
    whole = isinstance(value, int) and not isinstance(value, bool)
    if bounds and not (whole and bounds[0] <= value <= bounds[1]):
        raise SettingError(f'plant.{name}', value, f'an integer from {bounds[0]} to {bounds[1]}')
    return value


def _finite(value: Any) -> bool:
    """Tell whether ``value`` is a finite real number (a NumPy scalar too, a flag not)."""
    try:
        return not isinstance(value, bool) and isfinite(value)
    except TypeError:
        return False
