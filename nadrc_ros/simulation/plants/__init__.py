"""The plants by name. One more is one file and one line here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nadrc_ros.adrc.errors import one_of, SettingError
from nadrc_ros.adrc.fields import build
from nadrc_ros.simulation.plants.chain import Chain
from nadrc_ros.simulation.plants.motor import MotorPosition, MotorSpeed
from nadrc_ros.simulation.plants.paper import PaperPlant
from nadrc_ros.simulation.plants.pendulum import Pendulum
from nadrc_ros.simulation.plants.protocol import check_plant, Plant, total_disturbance
from nadrc_ros.simulation.plants.thermal import Thermal

__all__ = ['PLANTS', 'Plant', 'check_plant', 'make_plant', 'plant_type', 'total_disturbance']

PLANTS: dict[str, type[Plant]] = {
    'paper': PaperPlant,
    'chain': Chain,
    'motor': MotorSpeed,
    'motor_position': MotorPosition,
    'pendulum': Pendulum,
    'thermal': Thermal,
}


def plant_type(name: str) -> type[Plant]:
    """
    Return the plant class of that name.

    Raises
    ------
    SettingError
        For an unknown name.

    """
    if name not in PLANTS:
        raise SettingError('plant', name, one_of(name, PLANTS))
    return PLANTS[name]


def make_plant(name: str, values: Mapping[str, Any]) -> Plant:
    """
    Return the plant of that name with its coefficients from ``values``.

    Raises
    ------
    SettingError
        For an unknown name, an unknown key, or a value that the plant refuses.

    """
    return build(plant_type(name), values)
