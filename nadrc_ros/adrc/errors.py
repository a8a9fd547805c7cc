"""The one exception that bad settings raise."""

from __future__ import annotations


class SettingError(ValueError):
    """
    A setting is outside what is allowed.

    Carries ``name`` (dotted path of the setting), ``value`` (as given) and ``allowed`` (in words),
    so that a command line, a YAML reader and a ROS parameter callback can all report it in one
    sentence.
    """

    def __init__(self, name: str, value: object, allowed: str) -> None:
        super().__init__(name, value, allowed)
        self.name = name
        self.value = value
        self.allowed = allowed

    def __str__(self) -> str:
        return f'{self.name} = {self.value!r}: must be {self.allowed}'

    def inside(self, path: str) -> SettingError:
        """Return the same error with ``name`` placed below ``path``."""
        return SettingError(f'{path}.{self.name}' if path else self.name, self.value, self.allowed)
