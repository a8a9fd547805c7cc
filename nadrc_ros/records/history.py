"""
What was around a recorded run: who ran it, and the parameters of its nodes as they changed.

Beside the samples of a run, ``about.json`` says when it was started, by what versions and in which
namespace; ``parameters.jsonl`` grows by a line whenever a node tells parameters:
``{"time": 7.5, "node": "/controller", "values": {"b0": 2.0}}``. The time is that of the samples
[s], null before the first one. ``events.jsonl`` has a line for all else that happened:
``{"time": 5.0, "node": "/controller", "kind": "mode", "message": "holding: ..."}``. A folder may
lack any of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
import json
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST, LOWEST
from nadrc_ros.atomic import content_of, write_json
from nadrc_ros.records.recording import RecordingError
from nadrc_ros.simulation.plants import PLANTS

ABOUT = 'about.json'
PARAMETERS = 'parameters.jsonl'
EVENTS = 'events.jsonl'
# Kinds of events that hold until the next one of their kind from the same node.
LASTING = ('mode', 'fault')
# What tells the controller and the plant of this package from other nodes.
_CONTROLLER_HAS = {'structure', 'inner_bandwidth'}
_PLANT_HAS = {'plant', 'noise_variance'}
_COMMAND_LIMITS = ('command_min', 'command_max')
_PERIOD = 'measurement_period'

T = TypeVar('T')
Values = dict[str, Any]
# What holds, each with the time [s] from which on.
Steps = list[tuple[float, T]]


@attrs.frozen
class Change:
    """A parameter of a node that got another value at ``time`` [s]."""

    time: float
    node: str
    name: str
    before: Any
    after: Any


@attrs.frozen
class Event:
    """What happened at ``time`` [s], before the first sample if that is None."""

    time: float | None
    node: str
    kind: str
    message: str


@attrs.frozen
class History:
    """What ``about.json`` says, the first parameters known of each node, changes and events."""

    about: Values = attrs.field(factory=dict)
    parameters: dict[str, Values] = attrs.field(factory=dict)
    changes: list[Change] = attrs.field(factory=list)
    events: list[Event] = attrs.field(factory=list)
    _now: dict[str, Values] = attrs.field(factory=dict)

    def take(self, time: float | None, node: str, values: Mapping[str, Any]) -> None:
        """Add what a node told of its parameters at ``time`` [s], None before the first row."""
        known = self._now.setdefault(node, {})
        for name, value in values.items():
            if name not in known or time is None:
                self.parameters.setdefault(node, {})[name] = value
            elif repr(value) != repr(known[name]):  # nan is not equal to itself
                self.changes.append(Change(time, node, name, known[name], value))
        known |= values

    def controller_settings(self) -> Steps[ControllerSettings]:
        """Return the settings of the controller, each with the time [s] from which it held."""
        return self._steps(_CONTROLLER_HAS, partial(_built, ControllerSettings))

    def plant_gain(self) -> Steps[float]:
        """
        Return b0 of the simulated plant, from each time [s] on.

        Nothing for a user's plant: who reads a record does not run the code that it names.
        """
        return self._steps(_PLANT_HAS, _plant_b0)

    def plant_rate(self) -> float:
        """Return how many measurements per second the simulated plant sends [Hz], 0 if untold."""
        rate = self._plant().get('rate')
        return rate if isinstance(rate, float) and isfinite(rate) and rate > 0.0 else 0.0

    def plant_delay(self) -> tuple[float, float]:
        """Return the dead time of the simulated plant [s], and the command that acted first."""
        plant = self._plant()
        return float(plant.get('input_delay', 0.0)), float(plant.get('safe_command', 0.0))

    def _plant(self) -> Values:
        """Return the first parameters of the simulated plant, none where there is none."""
        return next((v for v in self.parameters.values() if v.keys() >= _PLANT_HAS), {})

    def _steps(self, marks: set[str], make: Callable[[Mapping[str, Any]], T | None]) -> Steps[T]:
        """Return what is made of the parameters of the node that has the marks, from each time."""
        node = next((n for n, values in self.parameters.items() if marks <= values.keys()), None)
        if node is None:
            return []
        values = dict(self.parameters[node])
        found = [(0.0, make(values))]
        for change in self.changes:
            if change.node == node:
                values[change.name] = change.after
                found.append((change.time, make(values)))
        return [(time, made) for time, made in found if made is not None]

    def command_limits(self) -> tuple[float, float] | None:
        """Return the limits of the command that held all the time, None where nobody knows."""
        controllers = self._controllers()
        told = {
            tuple(self.parameters[node].get(name) for name in _COMMAND_LIMITS)
            for node in controllers
        }
        changed = any(c.name in _COMMAND_LIMITS and c.node in controllers for c in self.changes)
        low, high = told.pop() if len(told) == 1 and not changed else (None, None)
        if not (isinstance(low, float) and isinstance(high, float)):
            return None
        return None if (low, high) == (LOWEST, HIGHEST) else (low, high)

    def measurement_period(self) -> float | None:
        """Return the period of the angle that is controlled, 0 if it is none; None if untold."""
        told = {self.parameters[node].get(_PERIOD) for node in self._controllers()}
        if not told:
            return None
        period = told.pop()
        return period if isinstance(period, float) and isfinite(period) and not told else 0.0

    def _controllers(self) -> list[str]:
        return [n for n, values in self.parameters.items() if values.keys() >= _CONTROLLER_HAS]


def about_figures(values: Mapping[str, Any]) -> Values:
    """Return what of the parameters of a node the figures of merit need: a few."""
    names = [*(_CONTROLLER_HAS if values.keys() >= _CONTROLLER_HAS else ()), *_COMMAND_LIMITS]
    names.append(_PERIOD)
    return {name: values[name] for name in names if name in values}


def write_about(folder: Path, content: Mapping[str, Any]) -> None:
    """Write who runs what, at once."""
    write_json(folder / ABOUT, 'about', content)


def append_parameters(
    folder: Path, time: float | None, node: str, values: Mapping[str, Any]
) -> None:
    """Append what a node tells of itself; the line is the system's when this returns."""
    _append(folder / PARAMETERS, {'time': time, 'node': node, 'values': values})


def append_event(folder: Path, event: Event) -> None:
    """Append what happened; the line is the system's when this returns."""
    _append(folder / EVENTS, attrs.asdict(event))


def _append(path: Path, record: Values) -> None:
    with path.open('a', encoding='utf-8') as file:
        file.write(json.dumps(record) + '\n')


def read_history(folder: Path) -> History:
    """
    Return what a folder tells besides its samples, which may be nothing.

    Raises
    ------
    RecordingError
        For a file that is not as it was written; a last line that was cut short is left out.

    """
    history = History(about=_about(_text(folder / ABOUT)))
    history.events.extend(_lines(folder / EVENTS, 'time, node, kind, message', _event))
    for told in _lines(folder / PARAMETERS, 'time, node and values', _told):
        history.take(*told)
    return history


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding='utf-8', errors='replace')
    except (FileNotFoundError, NotADirectoryError):
        return ''


def _about(text: str) -> Values:
    try:
        content = json.loads(text or '{}')
    except ValueError as error:
        raise RecordingError(f'{ABOUT}: {error}') from None
    if not isinstance(content, dict):
        raise RecordingError(f'{ABOUT}: not a table of values by name')
    return content_of(ABOUT, 'about', content)


def _lines(path: Path, what: str, make: Callable[[Any], T]) -> Iterator[T]:
    """Yield what is made of each whole line of a file that may be missing."""
    for place, line in enumerate(_text(path).split('\n')[:-1], 1):
        try:
            yield make(json.loads(line))
        except (ValueError, TypeError, KeyError):
            raise RecordingError(f'{path.name}, line {place}: not {what}') from None


def _event(record: Any) -> Event:
    time = None if record['time'] is None else float(record['time'])
    return Event(time, *(str(record[key]) for key in ('node', 'kind', 'message')))


def _told(record: Any) -> tuple[float | None, str, Values]:
    time, node, values = record['time'], record['node'], record['values']
    time = None if time is None else float(time)
    finite = time is None or isfinite(time)
    if not (finite and isinstance(node, str) and isinstance(values, dict)):
        raise ValueError
    return time, node, values


def _plant_b0(values: Mapping[str, Any]) -> float | None:
    plant = PLANTS.get(str(values['plant']))
    made = None if plant is None else _built(plant, values)
    return None if made is None else float(made.b0)


def _built(cls: Callable[..., T], values: Mapping[str, Any]) -> T | None:
    """Return the object of the values it has, None where another version means another thing."""
    own = {
        name: tuple(value) if isinstance(value := values[name], list) else value
        for name in declared(cls)  # type: ignore[arg-type]
        if name in values
    }
    try:
        return cls(**own)
    except (UserError, TypeError, ValueError):
        return None
