"""What to write over pictures: what was run, and marks for what was changed on the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import attrs
from nadrc_ros.records.history import Change
from nadrc_ros.scenario import Scenario

# Changes of several runs within this time are one moment [s]: they ran side by side.
_SIDE_BY_SIDE = 0.1


class Mark(NamedTuple):
    """Something that happened at a time [s]."""

    time: float
    label: str


@attrs.frozen
class NumberedChanges:
    """Changes at about one time [s], with the names of the runs in which they were made."""

    number: int
    time: float
    changes: list[tuple[Change, list[str]]] = attrs.field(factory=list)

    def add(self, change: Change, run: str) -> None:
        """Add a change, or a run to one that is already there."""
        for known, runs in self.changes:
            if _same(known, change) and run not in runs:
                runs.append(run)
                return
        self.changes.append((change, [run]))

    def mark(self) -> Mark:
        """Return what a picture writes at that time."""
        values = (f'{change.name} {text_of(change.after)}' for change, _ in self.changes)
        return Mark(self.time, ', '.join(dict.fromkeys(values)))


def numbered(changes: Mapping[str, Sequence[Change]]) -> list[NumberedChanges]:
    """Return the changes of parameters of some runs, by name, in order of time."""
    every = [(change, run) for run, made in changes.items() for change in made]
    found: list[NumberedChanges] = []
    for change, run in sorted(every, key=lambda pair: pair[0].time):
        if not found or change.time > found[-1].time + _SIDE_BY_SIDE:
            found.append(NumberedChanges(len(found) + 1, change.time))
        found[-1].add(change, run)
    return found


def title_of(name: str, scenario: Scenario) -> str:
    """Return one line that says what was run."""
    plant = scenario.plant.name or Path(scenario.plant.file).name
    variance = scenario.noise.variance
    noise = f'noise variance {variance:g}' if variance else 'no noise'
    return f'{name}: plant {plant}, {scenario.duration:g} s at {scenario.rate:g} Hz, {noise}'


def text_of(value: object) -> str:
    """Return the value of a parameter as text."""
    if isinstance(value, list):
        return '[' + ', '.join(map(text_of, value)) + ']'
    if isinstance(value, bool):
        return str(value).lower()
    short = f'{value:g}' if isinstance(value, float) else ''
    return short if short and float(short) == value else str(value)


def node_of(name: str) -> str:
    """Return the name of a node without its namespace."""
    return name.rpartition('/')[2]


def _same(one: Change, other: Change) -> bool:
    return node_of(one.node) == node_of(other.node) and (one.name, one.before, one.after) == (
        other.name,
        other.before,
        other.after,
    )
