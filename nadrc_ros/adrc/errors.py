"""What is raised when a user has to mend something."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

_MOST_BESIDE_A_NEAR_ONE = 12


class UserError(ValueError):
    """Something a user can mend; the message is one sentence and says what."""


class SettingError(UserError):
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
        given = (
            list(self.value) if isinstance(self.value, tuple) else self.value
        )  # as one writes it
        return f'{self.name} = {given!r}: must be {self.allowed}'

    def inside(self, path: str) -> SettingError:
        """Return the same error with ``name`` placed below ``path``."""
        return self.called(f'{path}.{self.name}' if path else self.name)

    def called(self, name: str) -> SettingError:
        """Return the same error under another name."""
        return type(self)(name, self.value, self.allowed)


class UnknownName(SettingError):
    """There is no setting of that name; ``allowed`` says which there are."""

    def __str__(self) -> str:
        return f'{self.name}: there is no such key; {self.allowed}'


def one_of(name: object, known: Iterable[str]) -> str:
    """Return in words that a name must be a known one, with the one that is near to it."""
    known = tuple(known)
    near = near_to(name, known) if isinstance(name, str) else ''
    return 'one of ' + ', '.join(known) + (f' (did you mean {near}?)' if near else '')


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the question for the known name near to ``name``, and all names unless too many."""
    known = tuple(known)
    near = near_to(name, known)
    if near and len(known) > _MOST_BESIDE_A_NEAR_ONE:
        return f'did you mean {near}?'
    question = f'did you mean {near}? ' if near else ''
    return f'{question}there are {", ".join(known) or "none"}'


def near_to(name: str, known: Iterable[str], cutoff: float = 0.5) -> str:
    """Return the known name that may be meant, empty where none is as like as ``cutoff``."""
    names = {each.lower(): each for each in known}
    near = get_close_matches(name.lower(), names, n=1, cutoff=cutoff)
    return names[near[0]] if near else ''
