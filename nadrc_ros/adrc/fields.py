"""
Declared settings: one declaration of a field serves every reader of it.

The functions ``number``, ``integer``, ``numbers``, ``choice``, ``flag`` and ``text`` make attrs
fields that are validated at construction and carry a :class:`Declared` with unit, range and
description. ROS parameter descriptors, the YAML check and the parameter table of the docs are all
read from it. Each takes ``live=False`` for what is fixed at start; ``number`` also ``nonzero``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any, TypeVar

import attrs
from nadrc_ros.adrc.errors import did_you_mean, one_of, SettingError, UnknownName

T = TypeVar('T')
_KEY = 'declared'
# Nearer to 0 than this a number that must not be 0 is taken as 0: one over it is a number still.
_NEAREST_TO_0 = 1e-15


@attrs.frozen(kw_only=True)
class Declared:
    """What is known about one setting: type, default, closed range, unit, meaning."""

    kind: str
    default: Any
    description: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    nonzero: bool = False
    live: bool = True

    def allowed(self) -> str:
        """Return the allowed values in words."""
        unit = f' {self.unit}' if self.unit else ''
        span = f' from {self.low:g} to {self.high:g}{unit}' if self.low is not None else ''
        if self.kind == 'number':
            return f'a finite number{span}' + (', not 0' if self.nonzero else '')
        if self.kind == 'integer':
            return f'an integer{span}'
        if self.kind == 'numbers':
            return f'a non-empty list of finite numbers{span}'
        if self.kind == 'choice':
            return 'one of ' + ', '.join(self.choices)
        return {'flag': 'true or false', 'text': 'a string'}[self.kind]

    def accepts(self, value: object) -> bool:
        """Tell whether ``value`` has the declared type and lies in the declared range."""
        if self.kind == 'flag':
            return isinstance(value, bool)
        if self.kind == 'text':
            return isinstance(value, str)
        if self.kind == 'choice':
            return isinstance(value, str) and value in self.choices
        if self.kind == 'integer':
            return isinstance(value, int) and self._inside(value)
        if self.kind == 'numbers':
            return isinstance(value, tuple) and bool(value) and all(map(self._inside, value))
        return self._inside(value)

    def _inside(self, value: object) -> bool:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return False
        if isinstance(value, float) and not isfinite(value):
            return False
        if self.nonzero and abs(value) < _NEAREST_TO_0:
            return False
        return self.low is None or self.high is None or self.low <= value <= self.high


def number(
    default: float, low: float, high: float, unit: str, description: str, **more: bool
) -> Any:
    """Declare a finite real number in the closed range [low, high]."""
    return _field('number', default, description, low=low, high=high, unit=unit, **more)


def integer(default: int, low: int, high: int, description: str, **more: bool) -> Any:
    """Declare an integer in the closed range [low, high]."""
    return _field('integer', default, description, low=low, high=high, **more)


def numbers(
    default: tuple[float, ...], low: float, high: float, unit: str, description: str, **more: bool
) -> Any:
    """Declare a non-empty list of finite numbers, each in the closed range [low, high]."""
    return _field('numbers', default, description, low=low, high=high, unit=unit, **more)


def choice(default: str, choices: tuple[str, ...], description: str, **more: bool) -> Any:
    """Declare one of a few words."""
    return _field('choice', default, description, choices=choices, **more)


def flag(default: bool, description: str, **more: bool) -> Any:
    """Declare true or false."""
    return _field('flag', default, description, **more)


def text(default: str, description: str, **more: bool) -> Any:
    """Declare a string."""
    return _field('text', default, description, **more)


def declared(cls: type[Any]) -> dict[str, Declared]:
    """Return the declarations of an attrs class, by field name, in order."""
    return {f.name: f.metadata[_KEY] for f in attrs.fields(cls) if _KEY in f.metadata}


def build(cls: type[T], values: Mapping[str, Any], path: str = '') -> T:
    """
    Construct ``cls`` from a mapping, naming an unknown key or a bad value by its dotted path.

    Raises
    ------
    SettingError
        For an unknown key, or a value that the class refuses.

    """
    names = [f.name for f in attrs.fields(cls) if f.init]  # type: ignore[arg-type]
    refuse_unknown_keys(values, names, path)
    try:
        return cls(**values)
    except SettingError as error:
        raise error.inside(path) from None


class Registry(dict[str, T]):
    """
    What there is of one kind, by name; the lookup of any other name says which there are.

    Raises
    ------
    SettingError
        From ``registry[name]``, under the name of the kind, with the known name that is near.

    """

    def __init__(self, kind: str, known: Mapping[str, T]) -> None:
        super().__init__(known)
        self._kind = kind

    def __missing__(self, name: str) -> T:
        raise SettingError(self._kind, name, one_of(name, self))


def refuse_unknown_keys(values: Mapping[Any, Any], allowed: Iterable[str], path: str = '') -> None:
    """
    Refuse a key that is not allowed, by its dotted path.

    Raises
    ------
    SettingError
        For the first such key, with the keys that are allowed.

    """
    known = tuple(allowed)
    for key, value in values.items():
        if key not in known:
            raise UnknownName(str(key), value, did_you_mean(str(key), known)).inside(path)


def _field(kind: str, default: Any, description: str, **more: Any) -> Any:
    declaration = Declared(kind=kind, default=default, description=description, **more)

    def check(_: object, attribute: Any, value: object) -> None:
        if not declaration.accepts(value):
            words = declaration.choices
            raise SettingError(
                attribute.name, value, one_of(value, words) if words else declaration.allowed()
            )

    return attrs.field(
        default=default,
        converter=_CONVERTERS.get(kind),
        validator=check,
        metadata={_KEY: declaration},
    )


def _to_float(value: Any) -> Any:
    try:
        return float(value) if type(value) is int else value
    except OverflowError:
        return value


def _to_tuple(value: Any) -> Any:
    """Take a YAML list or a ROS array as a tuple; nonsense is left to the check."""
    if isinstance(value, (str, bytes, Mapping)) or not hasattr(value, '__iter__'):
        return value
    return tuple(_to_float(item) for item in value)


_CONVERTERS = {'number': _to_float, 'numbers': _to_tuple}
