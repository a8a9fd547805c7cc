"""Which plant and which signals: names and values, from which a launcher makes parameters."""

from __future__ import annotations

from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build
from nadrc_ros.scenario.user_plant import load_plant
from nadrc_ros.simulation.plants import Plant, PLANTS
from nadrc_ros.simulation.signals import Signal, signal_type


@attrs.frozen(kw_only=True)
class PlantSpec:
    """
    A registered plant by ``name``, or the class ``class_name`` in the Python ``file``.

    ``values`` holds the coefficients that were given, by name. ``file`` is an absolute path, and
    ``class_name`` may be empty if the file defines one plant only.

    Raises
    ------
    SettingError
        For an unknown name, or a coefficient that a registered plant refuses.

    """

    name: str = ''
    file: str = ''
    class_name: str = ''
    values: dict[str, Any] = attrs.field(factory=dict)

    def __attrs_post_init__(self) -> None:
        if not self.file:
            _normalize(self, self.make())

    def make(self) -> Plant:
        """Return a new plant, never shared: a user's plant may have a memory."""
        if self.file:
            return load_plant(self.file, self.class_name, self.values)
        if self.name not in PLANTS:
            raise SettingError('name', self.name, 'one of ' + ', '.join(PLANTS))
        return build(PLANTS[self.name], self.values)


@attrs.frozen(kw_only=True)
class SignalSpec:
    """
    A signal by ``name``, with those of its fields that were given as ``values``.

    Raises
    ------
    SettingError
        For an unknown name, or a value that the signal does not have or refuses.

    """

    name: str = 'none'
    values: dict[str, float] = attrs.field(factory=dict)

    def __attrs_post_init__(self) -> None:
        _normalize(self, self.make())

    def make(self) -> Signal:
        """Return the signal."""
        return build(signal_type(self.name), self.values)


def _normalize(spec: PlantSpec | SignalSpec, made: object) -> None:
    """Give each value the type of the field it sets: 2 for a number becomes 2.0."""
    object.__setattr__(spec, 'values', {key: getattr(made, key) for key in spec.values})
