"""Which plant and which signals: names and values, from which a launcher makes parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import attrs
from nadrc_ros.adrc.errors import one_of, SettingError
from nadrc_ros.adrc.fields import build
from nadrc_ros.scenario.csv_signal import load_column
from nadrc_ros.scenario.user_code import Kind
from nadrc_ros.simulation.plants import PLANTS
from nadrc_ros.simulation.protocols import check_plant, check_signal, Plant, Signal
from nadrc_ros.simulation.signals import SIGNALS

PLANT = Kind[Plant](
    known=PLANTS, method='derivative', check=check_plant, plural='plants', path='plant'
)
SIGNAL = Kind[Signal](known=SIGNALS, method='derivatives', check=check_signal, plural='signals')


@attrs.frozen(kw_only=True)
class _Spec:
    # Key in a scenario -> field, the first of which may also stand alone; and the other ones in
    # words.
    keys: ClassVar[dict[str, str]]
    others: ClassVar[str]
    kind: ClassVar[Kind[Any]]

    name: str = ''
    file: str = ''
    class_name: str = ''
    values: dict[str, Any] = attrs.field(factory=dict)

    def as_given(self) -> dict[str, Any]:
        """Return what a scenario holds for it."""
        where = {key: getattr(self, field) for key, field in self.keys.items()}
        return {**{key: value for key, value in where.items() if value}, **self.values}

    def _normalize(self, made: object) -> None:
        """Give each value the type of the field it sets: 2 for a number becomes 2.0."""
        object.__setattr__(self, 'values', {key: getattr(made, key) for key in self.values})


@attrs.frozen(kw_only=True)
class PlantSpec(_Spec):
    """
    A registered plant by ``name``, or the class ``class_name`` in the Python ``file``.

    ``values`` holds the coefficients that were given, by name. ``file`` is an absolute path, and
    ``class_name`` may be empty if the file defines one plant only.

    Raises
    ------
    SettingError
        For an unknown name, or a coefficient that a registered plant refuses.

    """

    keys: ClassVar[dict[str, str]] = {'name': 'name', 'file': 'file', 'class': 'class_name'}
    others = 'or a file'
    kind = PLANT

    def __attrs_post_init__(self) -> None:
        if not self.file:
            self._normalize(self.make())

    def make(self) -> Plant:
        """Return a new plant, never shared: a user's plant may have a memory."""
        if self.file:
            return PLANT.load(self.file, self.class_name, self.values)
        if self.name not in PLANTS:
            raise SettingError('name', self.name, one_of(self.name, PLANTS))
        return build(PLANTS[self.name], self.values)


@attrs.frozen(kw_only=True)
class SignalSpec(_Spec):
    """
    A registered signal by ``name``, a class in the Python ``file``, or a column of a ``csv`` file.

    ``values`` holds the fields that were given, by name: of the signal, or of
    :class:`~nadrc_ros.scenario.csv_signal.CsvColumn`. The files are absolute paths, and
    ``class_name`` may be empty if the file defines one signal only.

    Raises
    ------
    SettingError, ScenarioError
        For an unknown name, a value that the signal does not have or refuses, or a file that
        fails.

    """

    keys: ClassVar[dict[str, str]] = {
        'signal': 'name',
        'file': 'file',
        'csv': 'csv',
        'class': 'class_name',
    }
    others = 'a file of Python or a csv'
    kind = SIGNAL

    csv: str = ''

    def __attrs_post_init__(self) -> None:
        if not (self.name or self.file or self.csv):
            object.__setattr__(self, 'name', 'none')
        made = self.make()
        if self.name:
            self._normalize(made)

    @property
    def title(self) -> str:
        """Return what it is, in a word."""
        return self.name or Path(self.file or self.csv).name

    def make(self) -> Signal:
        """Return a new signal."""
        if self.file:
            return SIGNAL.load(self.file, self.class_name, self.values)
        if self.csv:
            return load_column(self.csv, self.values)
        return build(SIGNALS[self.name], self.values)
