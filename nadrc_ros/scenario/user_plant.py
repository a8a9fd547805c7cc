"""A plant in a Python file of the user's."""

from __future__ import annotations

from collections.abc import Mapping
import os
from pathlib import Path
from typing import Any

from nadrc_ros.scenario.user_code import blame, construct, Kind, user_class
from nadrc_ros.simulation.plants import PLANTS
from nadrc_ros.simulation.protocols import check_plant, Plant

PLANT = Kind('plant', 'derivative', 'plants')


def load_plant(
    path: str | Path, class_name: str = '', values: Mapping[str, Any] | None = None
) -> Plant:
    """
    Return the plant that the Python file at ``path`` defines.

    Parameters
    ----------
    path
        The file.
    class_name
        Which class; may be empty if just one class in the file has a method ``derivative``.
    values
        Coefficients by name: fields of an attrs class, else keyword arguments of the class.

    Raises
    ------
    ScenarioError
        When the file cannot be read, its code fails, or the class is not clear.
    SettingError
        For a coefficient that the class does not take or refuses, or a class that is no plant.

    """
    file = os.path.abspath(path)
    with blame(file, always=True):
        return make_plant(user_class(PLANT, file, class_name), values or {})


def make_plant(cls: type[Any], values: Mapping[str, Any]) -> Plant:
    """
    Return a plant of a class of the user's.

    Raises
    ------
    SettingError
        For a coefficient that the class does not take or refuses, or a class that is no plant.

    """
    return check_plant(construct(PLANT, cls, values))


def plant_class(name: str, class_name: str = '') -> type[Any]:
    """
    Return the class of a registered plant, or the one that the Python file ``name`` defines.

    Raises
    ------
    ScenarioError, SettingError
        As in :func:`load_plant`; also for a name that is neither.

    """
    if not name.endswith('.py'):
        return PLANTS[name]
    return user_class(PLANT, os.path.abspath(name), class_name)
