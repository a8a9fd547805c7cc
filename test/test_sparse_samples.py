"""Samples that come more seldom than ticks: the rate limit counts time, not samples."""

from __future__ import annotations

from itertools import pairwise
from math import nan

from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least, Chain, NAMES
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Status
import pytest

H = 0.005
LIMIT = 100.0


def run(
    controller: Controller, chain: Chain, every: int, ticks: int, r: float, push: float = 0.0
) -> list[float]:
    """Return the commands of a loop with a sample in one of ``every`` ticks."""
    commands = []
    for k in range(ticks):
        measured = k % every == 0
        y, dt = (chain.y, every * H) if measured else (nan, 0.0)
        commands.append(controller.tick(y, dt, elapsed=H, reference=[r]))
        chain.advance(controller.design.b0 * commands[-1] + push, H)
    return commands


@pytest.mark.parametrize('every', (1, 2, 4, 10, 40))
@pytest.mark.parametrize('structure', NAMES)
def test_p05_the_rate_limit_is_reached_however_seldom_samples_come(
    structure: str, every: int
) -> None:
    """It was reached in ticks with a sample alone, at 20 Hz a tenth of the time."""
    controller = Controller(
        ControllerSettings(
            structure=structure, command_rate_limit=LIMIT, command_max=1e6, measurement_timeout=0.0
        )
    )
    chain = Chain(2)
    run(controller, chain, every, 4 * every, 0.0)
    commands = run(controller, chain, every, 200, 1e6)
    steps = [b - a for a, b in pairwise(commands)]
    assert steps == pytest.approx([LIMIT * H] * 199)


def test_p05_in_ticks_between_samples_the_command_stops_where_the_law_wants_it() -> None:
    controller = Controller(ControllerSettings(command_rate_limit=20.0, good_samples=1))
    controller.tick(0.0, H, reference=[0.0])
    u = controller.tick(0.0, H, reference=[0.05])  # asks for 0.8
    commands = [controller.tick(nan, 0.0, elapsed=H) for _ in range(20)]
    assert commands[0] - u == pytest.approx(20.0 * H)
    assert commands[-10:] == [commands[-1]] * 10
    assert commands[-1] == pytest.approx(0.8)


def test_without_a_rate_limit_ticks_between_samples_hold_the_command_to_the_bit() -> None:
    controller, chain = Controller(ControllerSettings()), Chain(2)
    commands = run(controller, chain, 4, 400, 1.0, push=0.3)
    for k in range(0, 400, 4):
        assert commands[k : k + 4] == [commands[k]] * 4
    assert controller.counts[Status.NO_MEASUREMENT] == 300


@pytest.mark.parametrize(('order', 'error'), ((1, 1e-9), (2, 0.1)))
@pytest.mark.parametrize('structure', NAMES)
def test_p06_the_observers_get_the_mean_of_a_command_that_moved(
    structure: str, order: int, error: float
) -> None:
    """Exact for n = 1. With the last command for the whole gap the estimate would be off by 2."""
    settings = ControllerSettings(
        structure=structure, plant_order=order, command_rate_limit=LIMIT, command_max=1e6
    )
    controller, chain = Controller(settings), Chain(order)
    run(controller, chain, 8, 800, 0.0, push=0.7)
    assert controller.total_disturbance == pytest.approx(0.7, abs=1e-3)
    before = controller.total_disturbance
    run(controller, chain, 8, 80, 1e6, push=0.7)
    assert controller.total_disturbance == pytest.approx(before, abs=error)


@at_least(60)
@given(st.lists(st.tuples(st.integers(1, 6), st.floats(-5.0, 5.0)), min_size=2, max_size=20))
def test_p06_a_gap_of_many_ticks_is_one_step_under_the_mean_command(
    gaps: list[tuple[int, float]],
) -> None:
    settings = ControllerSettings(plant_order=1, max_dt=10.0, measurement_timeout=0.0)
    ticks, means = (Controller(settings, checked=True) for _ in range(2))
    for controller in (ticks, means):
        controller.tick(0.0, H, reference=[0.0])
    for count, level in gaps:
        commands = [level + i * i for i in range(count)]
        y = 0.01 * level
        for i, u in enumerate(commands):
            last = i == count - 1
            ticks.tick(y if last else nan, count * H if last else 0.0, elapsed=H, applied=u)
        mean = sum(commands) / count
        means.tick(y, count * H, elapsed=count * H, applied=mean)
        assert ticks.state.levels[0] == pytest.approx(means.state.levels[0], rel=1e-9, abs=1e-9)
