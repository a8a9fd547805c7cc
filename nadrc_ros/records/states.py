"""What a controller does, and since when: the words of its events, and the spans they make."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, TYPE_CHECKING

from nadrc_ros.adrc.status import Cause, Mode

if TYPE_CHECKING:
    from nadrc_ros.records.history import Event

IN_CONTROL, HOLDING, RAMPING, SAFE, OFF = 'in control', 'holding', 'ramping', 'safe', 'off'
_ACTIONS = {
    Mode.HOLDING: 'holding',
    Mode.RAMPING: 'going to the safe command',
    Mode.SAFE: 'at the safe command',
}
_SILENT = 'silent'
_CAUSES = {
    Cause.NONE: 'restarting',
    Cause.START: 'no valid measurement yet',
    Cause.DISABLED: 'disabled',
    Cause.NOT_FOLLOWED: 'the inner loop is not in control',
    Cause.REFERENCE_TIMEOUT: 'no valid reference',
    Cause.STALLED: 'no nearer to the reference at a limit of the command, until enabled again',
    Cause.MEASUREMENT_TIMEOUT: 'no valid measurement',
}
_STATES = {
    IN_CONTROL: IN_CONTROL,
    **dict(zip(_ACTIONS.values(), (HOLDING, RAMPING, SAFE))),
    _SILENT: OFF,
}


class Lasting(NamedTuple):
    """A state that lasted from ``begin`` to ``end`` [s], and its cause in words."""

    begin: float
    end: float
    state: str
    cause: str


def describe(mode: Mode, cause: Cause, silent: bool = False) -> str:
    """
    Return in words what the command is, and why.

    Who is disabled may be ``silent`` without having sent the safe command.
    """
    if mode == Mode.OK:
        return IN_CONTROL
    action = _SILENT if silent and cause == Cause.DISABLED else _ACTIONS[mode]
    return f'{action}: {_CAUSES[cause]}'


def state_of(message: str) -> tuple[str, str]:
    """Return the state and the cause of a description, '' for what is none."""
    action, _, cause = message.partition(': ')
    state = _STATES.get(action, '')
    return (OFF if state == SAFE and cause == _CAUSES[Cause.DISABLED] else state), cause


def states(events: Iterable[Event], begin: float, end: float) -> list[Lasting]:
    """Return what the controller did from ``begin`` to ``end`` [s], as far as it told."""
    told = sorted(
        (-1.0 if event.time is None else event.time, *state_of(event.message))
        for event in events
        if event.kind == 'mode'
    )
    found: list[Lasting] = []
    for time, state, cause in told:
        if found:
            found[-1] = found[-1]._replace(end=min(end, time))
        found.append(Lasting(max(begin, time), end, state, cause))
    return [each for each in found if each.state and each.begin < each.end]
