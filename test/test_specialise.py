"""The law as straight-line code for one shape: the bits of the law as it is written."""

from __future__ import annotations

import random

from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least, bits, state_bits, varied_settings
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.tick import tick
import pytest
from test_all_features import everything, World

TICKS = 120
CASES = varied_settings()


def same_run(settings: ControllerSettings, seed: int) -> None:
    """Run the law as it is written and its specialised form side by side."""
    plain, fast = Controller(settings), Controller(settings)
    fast.specialise()
    assert fast._law is not tick
    world, rng = World(settings, seed), random.Random(seed)
    for k in range(TICKS):
        if rng.random() < 0.02:
            plain.enabled = fast.enabled = not plain.enabled
        if rng.random() < 0.01:
            plain.reset()
            fast.reset()
        told = world.next(plain.command)
        u, v = plain.tick(**told), fast.tick(**told)
        assert bits([u]) == bits([v]), k
        assert repr(plain.policy) == repr(fast.policy), k
        assert plain.status == fast.status, k
        assert state_bits(plain.state) == state_bits(fast.state), k


@pytest.mark.parametrize('name', CASES)
def test_every_branch_of_the_law_has_its_bits(name: str) -> None:
    same_run(ControllerSettings(**CASES[name]), 1)


@at_least(20)
@given(everything(), st.integers(0, 2**30))
def test_all_features_have_their_bits(settings: ControllerSettings, seed: int) -> None:
    same_run(settings, seed)
