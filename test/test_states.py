"""What the controller did and for how long: the words of events, and spans."""

from __future__ import annotations

from itertools import product

from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.records.history import Event
from nadrc_ros.records.states import describe, Lasting, state_of, states
from nadrc_ros.report import roles
import pytest


@pytest.mark.parametrize(('mode', 'cause'), list(product(Mode, Cause)))
def test_every_description_is_a_state_that_has_a_colour(mode: Mode, cause: Cause) -> None:
    for silent in (False, True):
        state, why = state_of(describe(mode, cause, silent))
        assert state in roles.STATES
        assert (state == 'in control') == (mode == Mode.OK)
        assert bool(why) == (mode != Mode.OK)
        if mode == Mode.SAFE or silent:
            assert (state == 'off') == (cause == Cause.DISABLED and mode != Mode.OK)
    assert state_of('of the future') == ('', '')


def test_states_last_until_the_next_one_and_the_first_was_told_before() -> None:
    def told(time: float | None, message: str, kind: str = 'mode') -> Event:
        return Event(time, '/controller', kind, message)

    events = [
        told(None, 'in control'),
        told(2.0, 'holding: no valid measurement'),
        told(2.2, 'disabled', 'enable'),
        told(2.5, 'at the safe command: disabled'),
        told(12.0, 'in control'),
    ]
    assert states(events, 0.0, 10.0) == [
        Lasting(0.0, 2.0, 'in control', ''),
        Lasting(2.0, 2.5, 'holding', 'no valid measurement'),
        Lasting(2.5, 10.0, 'off', 'disabled'),
    ]
    assert states(events, 2.1, 2.4) == [Lasting(2.1, 2.4, 'holding', 'no valid measurement')]
    assert states([], 0.0, 10.0) == []
