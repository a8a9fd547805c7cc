"""Which plant and which signals: names and values, from which a launcher makes parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.errors import one_of, SettingError
from nadrc_ros.adrc.fields import build
from nadrc_ros.scenario.user_plant import load_plant
from nadrc_ros.scenario.user_signal import load_column, load_signal
from nadrc_ros.simulation.plants import PLANTS
from nadrc_ros.simulation.protocols import Plant, Signal
from nadrc_ros.simulation.signals import SIGNALS


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
            raise SettingError('name', self.name, one_of(self.name, PLANTS))
        return build(PLANTS[self.name], self.values)


@attrs.frozen(kw_only=True)
class SignalSpec:
    """
    A registered signal by ``name``, a class in the Python ``file``, or a column of a ``csv`` file.

    ``values`` holds the fields that were given, by name: of the signal, or of
    :class:`~nadrc_ros.scenario.user_signal.CsvColumn`. The files are absolute paths, and
    ``class_name`` may be empty if the file defines one signal only.

    Raises
    ------
    SettingError, ScenarioError
        For an unknown name, a value that the signal does not have or refuses, or a file that
        fails.

    """

    name: str = ''
    file: str = ''
    class_name: str = ''
    csv: str = ''
    values: dict[str, Any] = attrs.field(factory=dict)

    def __attrs_post_init__(self) -> None:
        if not (self.name or self.file or self.csv):
            object.__setattr__(self, 'name', 'none')
        made = self.make()
        if self.name:
            _normalize(self, made)

    @property
    def title(self) -> str:
        """Return what it is, in a word."""
        return self.name or Path(self.file or self.csv).name

    def make(self) -> Signal:
        """Return a new signal."""
        if self.file:
            return load_signal(self.file, self.class_name, self.values)
        if self.csv:
            return load_column(self.csv, self.values)
        return build(SIGNALS[self.name], self.values)


def _normalize(spec: PlantSpec | SignalSpec, made: object) -> None:
    """Give each value the type of the field it sets: 2 for a number becomes 2.0."""
    object.__setattr__(spec, 'values', {key: getattr(made, key) for key in spec.values})
