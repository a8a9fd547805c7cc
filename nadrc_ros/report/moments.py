"""When parameters were changed: moments that the plots mark by number and a table explains."""

from __future__ import annotations

from collections.abc import Mapping

import attrs
from nadrc_ros.records.history import Change, History
from nadrc_ros.report.caption import Mark

# Changes of several runs within this time are one moment [s]: they ran side by side.
TOGETHER = 0.1


@attrs.frozen
class Moment:
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
        return Mark(self.time, ', '.join(values))


def moments_of(histories: Mapping[str, History]) -> list[Moment]:
    """Return the moments of all runs, in order of time."""
    every = [(change, run) for run, history in histories.items() for change in history.changes]
    moments: list[Moment] = []
    for change, run in sorted(every, key=lambda pair: pair[0].time):
        if not moments or change.time > moments[-1].time + TOGETHER:
            moments.append(Moment(len(moments) + 1, change.time))
        moments[-1].add(change, run)
    return moments


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
