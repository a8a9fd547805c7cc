"""The coefficients of plants and of classes of the user's as declared settings."""

from __future__ import annotations

import inspect
from typing import Any

import attrs
from nadrc_ros.adrc.fields import Declared, declared
from nadrc_ros.scenario.errors import ScenarioError
from nadrc_ros.scenario.user_plant import plant_class

KINDS = {bool: 'flag', str: 'text', int: 'number', float: 'number'}


def plant_fields(plant: str | type[Any], class_name: str = '') -> dict[str, Declared]:
    """
    Return what is known of each coefficient of a plant, by name.

    ``plant`` is a registered plant, a Python file, or a class.

    Raises
    ------
    ScenarioError
        When the file fails, or an argument has no default that a parameter can hold.
    SettingError
        For an unknown plant.

    """
    return class_fields(plant if isinstance(plant, type) else plant_class(plant, class_name))


def class_fields(cls: type[Any]) -> dict[str, Declared]:
    """
    Return what is known of each argument of a class, by name.

    The arguments of a plain class are described by their defaults, which they must have.

    Raises
    ------
    ScenarioError
        When an argument has no default that a parameter can hold.

    """
    if attrs.has(cls) and declared(cls):
        return declared(cls)
    return {
        argument.name: _described(cls, argument)
        for argument in inspect.signature(cls).parameters.values()
        if argument.kind not in (argument.VAR_POSITIONAL, argument.VAR_KEYWORD)
    }


def _described(cls: type[Any], argument: inspect.Parameter) -> Declared:
    kind = KINDS.get(type(argument.default))
    if kind is None:
        raise ScenarioError(
            f'{cls.__name__}: {argument.name} needs a default that is a number, a string or a flag'
        )
    default = float(argument.default) if kind == 'number' else argument.default
    return Declared(
        kind=kind,
        default=default,
        description=f'argument of {cls.__name__}',
        live=False,
    )
