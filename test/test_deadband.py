"""Rest inside a deadband: the command stands still, hunting ends, and to leave it is no bump."""

from __future__ import annotations

from math import copysign
import random
from typing import Any

import attrs
from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least, Chain, NAMES, NAN, noise, run_chain, varied_settings
from nadrc_ros.adrc.angle import short
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Mode
import pytest

H = 0.01
BAND = 0.02
SETTINGS = ControllerSettings(error_deadband=BAND)


class Stiction:
    """y'' = u - friction: it sticks up to a force of 2 and slides against one of 1."""

    def __init__(self) -> None:
        self.y = self.speed = 0.0

    def advance(self, u: float, h: float = H) -> None:
        for _ in range(20):
            if self.speed == 0.0 and abs(u) <= 2.0:
                return
            way = copysign(1.0, self.speed or u)
            speed = self.speed + (u - way) * h / 20
            self.speed = 0.0 if speed * way < 0.0 else speed
            self.y += self.speed * h / 20


@pytest.mark.parametrize('count', (0.002, 0.006))
def test_hunting_for_what_lies_between_two_counts_ends(count: float) -> None:
    def run(band: float) -> tuple[list[float], list[float]]:
        controller = Controller(attrs.evolve(SETTINGS, error_deadband=band), checked=True)
        plant, outputs = Stiction(), []
        commands = []
        for _ in range(4000):
            y = round(plant.y / count) * count
            commands.append(controller.tick(y, H, reference=[1.0 + 0.5 * count]))
            plant.advance(commands[-1])
            outputs.append(plant.y)
        return commands[2000:], outputs[2000:]

    commands, outputs = run(0.0)
    assert (
        min(commands) < -1.0 and max(commands) > 1.0 and max(outputs) - min(outputs) > 0.5 * count
    )
    commands, outputs = run(3.0 * count)
    assert len(set(commands)) == len(set(outputs)) == 1
    assert abs(outputs[0] - 1.0 - 0.5 * count) < 1.5 * count


def at_rest(settings: ControllerSettings) -> tuple[Controller, Chain]:
    """Return a loop that rests at 1 under a load."""
    chain = Chain(settings.plant_order)
    chain.x[0] = 1.0
    controller = Controller(attrs.evolve(settings, error_deadband=0.0), checked=True)
    for k, _ in enumerate(run_chain(controller, 3000, r=1.0, disturbance=0.5, chain=chain)):
        if k == 1000:
            controller.retune(settings)
        if controller.resting:
            return controller, chain
    raise AssertionError('it never rests')


# Those with which a chain of integrators is stable.
UNSTABLE = ('slow', 'known poles', 'vibration-generalized')
CASES = {k: v for k, v in varied_settings().items() if k not in UNSTABLE}


@pytest.mark.parametrize('case', CASES)
def test_to_leave_it_is_no_bump_and_a_load_is_rejected_from_there(case: str) -> None:
    settings = ControllerSettings(**CASES[case] | {'error_deadband': BAND})
    controller, chain = at_rest(settings)
    held = controller.command
    while controller.resting:  # whatever the plant does, as long as it is inside
        assert controller.command.hex() == held.hex()
        controller.tick(chain.y, H, reference=[1.0])
        chain.advance(controller.design.b0 * held + 1.5, H)
    period = settings.measurement_period
    assert abs(short(1.0 - controller.output_estimate, period)) > BAND
    assert controller.command == pytest.approx(held, abs=1e-9)
    controller.retune(attrs.evolve(settings, error_deadband=0.0))
    for _ in range(3000):
        controller.tick(chain.y, H, reference=[1.0])
        chain.advance(controller.design.b0 * controller.command + 1.5, H)
    if case not in ('narrow',) and settings.structure != 'printed':
        assert abs(short(chain.y - 1.0, period)) < 0.01 * BAND


@pytest.mark.parametrize(
    'change',
    (
        {'error_deadband': 0.0},
        {'b0': 2.0},
        {'structure': 'conventional', 'inner_bandwidth': 60.0},
        {'error_based': True},
        {'tracking_acceleration': 1.0},
        {'command_min': -0.4},
        {'command_min': -0.3},
        {'command_rate_limit': 10.0},
        {'controller_bandwidth': 8.0},
    ),
)
def test_p12_a_live_change_at_rest_is_no_bump(change: dict[str, Any]) -> None:
    """A held command that the new limits exclude enters them at once, and the loop wakes."""
    settings = attrs.evolve(SETTINGS, controller_bandwidth=4.0)
    controller, chain = at_rest(settings)
    held = controller.command
    assert held == pytest.approx(-0.5, abs=0.1)
    changed = attrs.evolve(settings, **change)
    controller.retune(changed)
    expected = max(held, changed.command_min)
    assert controller.tick(chain.y, H, reference=[1.0]) == pytest.approx(expected, abs=1e-9)
    chain.advance(expected + 0.5, H)
    u = controller.tick(chain.y, H, reference=[1.0])
    assert abs(u - expected) < 0.2
    if 'command_min' in change or 'error_deadband' in change:
        assert not controller.resting
    else:
        assert controller.resting and u.hex() == held.hex()


def test_it_ends_when_the_reference_moves() -> None:
    for reference in ([1.0 + 1e-6], [1.0, 0.01], [1.0, 0.0, -0.1]):
        controller, chain = at_rest(SETTINGS)
        held = controller.command
        assert (
            controller.tick(chain.y, H, reference=[1.0, 0.0, 0.0]) == held and controller.resting
        )
        u = controller.tick(chain.y, H, reference=reference)
        assert not controller.resting and u == pytest.approx(held, abs=1e-9)


def test_a_fast_pass_is_no_rest() -> None:
    controller = Controller(SETTINGS, checked=True)
    for k in range(100):  # at 1 /s through the band
        controller.tick(-0.5 + k * H, H, reference=[0.0])
        assert not controller.resting


def test_noise_below_half_of_it_does_not_wake_the_loop() -> None:
    """In two minutes; the count of entries is bounded by that of what really moved it."""
    controller, plant = Controller(SETTINGS, checked=True), Stiction()
    entries, before = 0, False
    for error in noise(3, 12_000, BAND / 10):
        plant.advance(controller.tick(plant.y + error, H, reference=[0.3]))
        entries += controller.resting and not before
        before = controller.resting
    assert before and entries <= 3


@pytest.mark.parametrize('what', ('disabled', 'silence', 'reset', 'gap'))
def test_it_ends_where_the_law_is_not_in_control(what: str) -> None:
    controller, chain = at_rest(SETTINGS)
    held = controller.command
    if what == 'disabled':
        controller.enabled = False
    elif what == 'reset':
        controller.reset()
    for _ in range(10):
        y, dt = (NAN, 0.0) if what == 'silence' else (chain.y, 10.0 if what == 'gap' else H)
        if what == 'silence':
            controller.tick(y, dt, elapsed=0.1)
        else:
            controller.tick(y, dt, reference=[1.0])
            if what in ('reset', 'gap'):
                assert controller.command == pytest.approx(held, abs=1e-9)
                break
    assert not controller.resting
    if what in ('disabled', 'silence'):
        controller.enabled = True
        applied, modes = held, [controller.mode]
        while modes[-1] != Mode.OK:
            applied = controller.command
            controller.tick(chain.y, H, reference=[1.0])
            modes.append(controller.mode)
        assert len(modes) > 1
        assert controller.command == pytest.approx(applied, abs=1e-9)


@pytest.mark.parametrize('rate_limit', (0.0, 20.0))
def test_a_tick_without_a_sample_holds_it_too(rate_limit: float) -> None:
    """Whatever acts meanwhile; where the rate is limited that may take its time."""
    controller, chain = at_rest(attrs.evolve(SETTINGS, command_rate_limit=rate_limit))
    held = controller.command
    applied = held if rate_limit else held + 0.3
    for k in range(20):
        y, dt = (chain.y, 2 * H) if k % 2 else (NAN, 0.0)
        assert controller.tick(y, dt, elapsed=H, reference=[1.0], applied=applied) == held


def test_without_it_the_state_knows_nothing_of_rest() -> None:
    for name in NAMES:
        controller = Controller(ControllerSettings(structure=name), checked=True)
        for _ in run_chain(controller, 300):
            assert not controller.resting


@at_least(60)
@given(
    st.sampled_from(sorted(varied_settings())),
    st.floats(0.5, 3.0),
    st.integers(0, 1000),
    st.lists(st.tuples(st.integers(1, 60), st.floats(-1.0, 1.0)), min_size=1, max_size=5),
)
def test_at_rest_no_bit_of_the_command_changes_and_neither_end_is_a_bump(
    case: str, band: float, seed: int, pushes: list[tuple[int, float]]
) -> None:
    """Whatever the plant does, with samples that are missing."""
    values = varied_settings()[case] | {'error_deadband': band}
    if 'measurement_period' in values:  # of which the deadband is less than half
        values['measurement_period'] = max(values['measurement_period'], 4.0 * band)
    controller = Controller(ControllerSettings(**values), checked=True)
    y, rng, before, rested = 0.0, random.Random(seed), 0.0, False
    for count, speed in pushes:
        for _ in range(count):
            y += speed * H + 0.01 * rng.gauss(0.0, 1.0)
            there = rng.random() > 0.1
            u = controller.tick(y if there else NAN, H if there else 0.0, elapsed=H, reference=[0])
            if controller.mode == Mode.OK and (rested or controller.resting):
                if rested and controller.resting:
                    assert u.hex() == before.hex()
                assert u == pytest.approx(before, abs=1e-9)
            rested, before = controller.resting, u
