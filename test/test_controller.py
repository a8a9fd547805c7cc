"""The controller over whole runs: windup, replay, restarts and what it shows of itself."""

from __future__ import annotations

from itertools import pairwise
from math import copysign, cos, pi, sin
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from law_helpers import (
    at_least,
    bits,
    Chain,
    fixed_of,
    INF,
    NAMES,
    NAN,
    noise,
    run_chain,
    state_bits,
    varied_settings,
)
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Cause, Mode, Status
import numpy as np
import pytest

H = 0.01
CASES = varied_settings()
ANY = st.one_of(st.floats(), st.sampled_from((NAN, INF, -INF, 1e308, 5e-324, 9.9e99, 0.0, H)))


def controller_of(case: str, **values: Any) -> Controller:
    return Controller(ControllerSettings(**CASES[case] | values))


@at_least(500)
@given(
    st.sampled_from(sorted(CASES)),
    st.lists(
        st.tuples(ANY, ANY, ANY, ANY, st.lists(ANY, max_size=4), st.booleans()),
        min_size=1,
        max_size=10,
    ),
)
def test_p02_p04_no_tick_makes_a_command_bad_and_none_is_remembered(
    case: str, ticks: list[tuple[float, float, float, float, list[float], bool]]
) -> None:
    controller = controller_of(case)
    low, high = controller.settings.command_min, controller.settings.command_max
    for y, dt, elapsed, applied, reference, enabled in ticks:
        controller.enabled = enabled
        u = controller.tick(y, dt, elapsed=elapsed, applied=applied, reference=reference)
        assert low <= u <= high
    controller.enabled = True
    for _ in range(5):
        assert low <= controller.tick(0.1, H, reference=[0.2]) <= high
    assert controller.mode == Mode.OK and controller.status < Status.NO_MEASUREMENT


def script(controller: Controller, seed: int, ticks: int) -> tuple[list[str], list[list[str]]]:
    """Run a loop with jitter, bad samples, lost references, changes and resets."""
    commands, chain = [], Chain(controller.design.order)
    numbers = iter(noise(seed, 4 * ticks))
    for k in range(ticks):
        jitter, spoil, v, r = (next(numbers) for _ in range(4))
        h = H * (1 + 0.1 * max(-3.0, min(3.0, jitter)))
        y = NAN if spoil > 2.0 else chain.y + 0.01 * v
        if k == ticks // 2:
            b0 = copysign(1.5, controller.settings.b0)
            controller.retune(ControllerSettings(**fixed_of(controller.settings), b0=b0))
        if k == ticks // 3:
            controller.reset()
        controller.enabled = not ticks // 4 < k < ticks // 4 + 20
        reference = None if spoil < -1.0 else [r, 0.1]
        commands.append(controller.tick(y, h, reference=reference))
        chain.advance(commands[-1], h)
    return bits(commands), state_bits(controller.state)


@pytest.mark.parametrize('case', CASES)
def test_p18_the_same_inputs_give_the_same_bits(case: str) -> None:
    first, second = (script(controller_of(case), 7, 400) for _ in range(2))
    assert first == second
    assert first != script(controller_of(case), 8, 400)


@pytest.mark.parametrize('case', CASES)
def test_p05_the_rate_limit_holds_through_everything(case: str) -> None:
    """Start, bad samples, lost references, disabling, a reset and a change of structure."""
    controller = controller_of(case, command_rate_limit=30.0, reference_timeout=0.05)
    changed = ControllerSettings(
        **fixed_of(controller.settings),
        structure='printed',
        command_rate_limit=30.0,
        b0=copysign(3.0, controller.settings.b0),
        safe_command=1.0,
    )
    chain, before = Chain(controller.design.order), controller.command
    for k, v in enumerate(noise(1, 800)):
        spoiled = 200 <= k < 240 or k % 17 == 0
        if k == 400:
            controller.enabled = False
        if k == 450:
            controller.enabled = True
        if k == 500:
            controller.retune(changed)
        if k == 600:
            controller.reset()
        reference = None if 300 <= k < 340 else [20.0 * (k % 40 < 20)]
        u = controller.tick(NAN if spoiled else chain.y + 0.1 * v, H, reference=reference)
        assert abs(u - before) <= 30.0 * H * (1 + 1e-9), k
        before = u
        chain.advance(controller.design.b0 * u, H)


@pytest.mark.parametrize('structure', NAMES)
@pytest.mark.parametrize('n', (1, 2))
def test_p06_ten_seconds_of_saturation_leave_no_windup(structure: str, n: int) -> None:
    """
    The reference is out of reach for 10 s; coming back overshoots no more than a fresh start.

    For n = 2 the plant is held by a stop meanwhile, so that there is a place to come back from.
    """
    limited = ControllerSettings(
        plant_order=n, structure=structure, command_min=-3.0, command_max=3.0
    )
    for wound in (True, False):
        controller, chain = Controller(limited), Chain(n)
        for _ in range(1000 if wound else 0):
            u = controller.tick(chain.y, H, reference=[100.0])
            chain.advance(u, H)
            if chain.y > 2.0:
                chain.x = [2.0, *[0.0] * (n - 1)]
        chain.x = [2.0, *[0.0] * (n - 1)]
        largest = max(abs(d) for d in controller.disturbances)
        assert largest < 3.1
        run = list(run_chain(controller, 1000, r=1.0, chain=chain))
        assert min(y for y, _ in run) > 1.0 - 1e-9
        assert chain.y == pytest.approx(1.0, abs=1e-3)


def test_p06_a_command_limited_elsewhere_is_seen() -> None:
    """The actuator gives only half; told so, the estimate of the disturbance stays right."""
    controller, chain = Controller(ControllerSettings(safe_command=0.0)), Chain(2)
    applied = 0.0
    for _ in range(1500):
        u = controller.tick(chain.y, H, reference=[1.0], applied=applied)
        applied = 0.5 * u
        chain.advance(applied - 2.0, H)
    assert controller.total_disturbance == pytest.approx(-2.0, abs=1e-6)


@pytest.mark.parametrize('case', CASES)
def test_reset_restarts_without_a_bump(case: str) -> None:
    controller = controller_of(case)
    run = list(run_chain(controller, 200, r=0.5, disturbance=0.2))
    controller.reset()
    before = state_bits(controller.state)
    held = controller.tick(NAN, H)
    on_its_way = controller.settings.command_rate_limit * H
    assert abs(held - run[-1][1]) <= 1.001 * on_its_way and state_bits(controller.state) == before
    assert controller.tick(0.5, H) == pytest.approx(held, abs=1e-9)
    assert controller.mode == Mode.OK
    assert state_bits(controller.state) != before
    # What is forgotten is the motion: d and y' follow from rest.
    fresh = Chain(controller.design.order)
    fresh.x[0] = 0.5
    settled = list(run_chain(controller, 2000, r=0.5, disturbance=0.2, chain=fresh))
    if controller.settings.feedback == 'linear' and not controller.settings.command_rate_limit:
        near = max(1e-3, controller.settings.error_deadband)
        assert settled[-1][0] == pytest.approx(0.5, abs=near)


@pytest.mark.parametrize('error_based', (False, True))
def test_p01_a_bad_reference_is_counted_and_the_last_good_one_holds(error_based: bool) -> None:
    clean, spoiled = (Controller(ControllerSettings(error_based=error_based)) for _ in range(2))
    for controller in (clean, spoiled):
        list(run_chain(controller, 20, r=0.5))
    for bad in ([NAN], [INF, 0.0], [1e300, 0.0]):
        assert spoiled.tick(0.1, H, reference=bad) == clean.tick(0.1, H)
        assert state_bits(spoiled.state) == state_bits(clean.state)
    assert spoiled.counts[Status.BAD_REFERENCE] == 3
    assert clean.counts[Status.BAD_REFERENCE] == 0


def test_p01_a_bad_derivative_is_the_last_good_one_and_does_not_block_the_reference() -> None:
    clean, spoiled = (Controller(ControllerSettings()) for _ in range(2))
    for good, bad in (
        ([0.5, 0.3, 2.0], [0.5, 0.3, 2.0]),
        ([0.6, 0.3, 2.0], [0.6, NAN, 1e300]),
        ([0.7, 0.3, 3.0], [0.7, None, 3.0]),
    ):
        assert spoiled.tick(0.1, H, reference=bad) == clean.tick(0.1, H, reference=good)
    assert spoiled.counts[Status.BAD_REFERENCE] == 1
    assert spoiled.reference == [0.7, 0.3, 3.0]


def test_p01_a_derivative_that_ceases_to_come_is_dropped_without_a_bump() -> None:
    settings = ControllerSettings(max_dt=0.1, reference_derivatives='topics')
    controller, chain = Controller(settings), Chain(2)
    commands = []
    for k in range(300):
        r, rate, acceleration = sin(0.02 * k), 2.0 * cos(0.02 * k), -4.0 * sin(0.02 * k)
        known = [rate, acceleration] if k < 200 else [None, None]
        commands.append(controller.tick(chain.y, H, reference=[r, *known]))
        chain.advance(commands[-1], H)
    assert controller.reference[1:] == [0.0, 0.0]
    # dropped at once, the rate alone would move the command by 8 x 1.3
    assert max(abs(b - a) for a, b in pairwise(commands[150:])) < 1.0


def test_the_counts_add_up_and_name_what_happened() -> None:
    controller = Controller(ControllerSettings(command_max=1.0, max_dt=0.1))
    list(run_chain(controller, 10, r=100.0))
    for y, dt in ((NAN, H), (0.0, -1.0), (0.0, 0.5), (1e308, H)):
        controller.tick(y, dt)
    assert controller.counts[Status.NO_MEASUREMENT] == 2
    assert controller.counts[Status.BAD_TIME_STEP] == 1
    assert controller.counts[Status.RESTARTED] == 1
    assert controller.counts[Status.SATURATED] > 5
    assert sum(controller.counts.values()) == 14


@pytest.mark.parametrize('error_based', (False, True))
@pytest.mark.parametrize('structure', NAMES)
def test_what_it_shows_is_in_the_units_of_the_plant(structure: str, error_based: bool) -> None:
    """L = y'' - b0 u and y, also when the observers run on the error."""
    settings = ControllerSettings(
        structure=structure, error_based=error_based, b0=2.0, inner_bandwidth=20.0
    )
    controller, chain = Controller(settings), Chain(2)
    for k in range(2000):
        t = k * H
        u = controller.tick(chain.y, H, reference=[0.2 * t * t, 0.4 * t, 0.4])
        y = chain.y
        chain.advance(2.0 * u - 1.5, H)
    assert controller.total_disturbance == pytest.approx(-1.5, abs=1e-3)
    assert controller.output_estimate == pytest.approx(y, abs=1e-3)
    assert controller.tracking == 0.2 * t * t
    assert len(controller.disturbances) == controller.design.levels


def test_known_derivatives_are_used_only_when_they_are_received() -> None:
    for source, kept in (('topics', [1.0, 2.0, 3.0]), ('none', [1.0, 0.0, 0.0])):
        controller = Controller(ControllerSettings(reference_derivatives=source))
        controller.tick(0.0, H, reference=[1.0, 2.0, 3.0, 4.0])
        assert controller.reference == kept
    controller = Controller(ControllerSettings(reference_derivatives='topics'))
    array: Any = np.array([1.0, 2.0])
    controller.tick(0.0, H, reference=array)
    assert controller.reference == [1.0, 2.0, 0.0]
    controller.tick(0.0, H, reference=(5.0,))
    assert controller.reference == [5.0, 0.0, 0.0]


def test_p09_a_duplicate_sample_changes_nothing() -> None:
    """The same stamp again: dt = 0."""
    once, twice = (Controller(ControllerSettings()) for _ in range(2))
    chain = Chain(2)
    for _ in range(100):
        u = once.tick(chain.y, H, reference=[1.0])
        assert twice.tick(chain.y, H, elapsed=H / 2, reference=[1.0]) == u
        assert twice.tick(chain.y, 0.0, elapsed=H / 2) == u
        chain.advance(u, H)
    assert state_bits(once.state) == state_bits(twice.state)
    assert twice.counts[Status.BAD_TIME_STEP] == 100


@pytest.mark.parametrize(
    ('settings', 'off'),
    [
        ({'reference_derivatives': 'none'}, (0.3, 0.4)),
        ({'reference_derivatives': 'none', 'error_based': True}, (0.0, 0.01)),
        ({}, (0.0, 0.005)),
    ],
)
def test_a_moving_reference_that_comes_alone_is_followed(
    settings: dict[str, Any], off: tuple[float, float]
) -> None:
    """The figures of robot.md: a sinusoid of 0.5 Hz is 0.35 off, error-based 0.009, or 0.005."""
    controller = Controller(ControllerSettings(b0=4.0, controller_bandwidth=8.0, **settings))
    y = v = worst = 0.0
    for k in range(2000):
        u = controller.tick(y, 0.005, reference=[0.5 * sin(pi * 0.005 * k)])
        for _ in range(10):
            v += 0.0005 * (4.0 * u - v)
            y += 0.0005 * v
        worst = max(worst, abs(0.5 * sin(pi * 0.005 * (k + 1)) - y)) if k > 800 else worst
    assert off[0] < worst < off[1]


def test_p11_to_have_waited_disabled_changes_nothing_of_the_start() -> None:
    """
    On the graph a controller waits at the plant's rest, in a simulation it begins with the sample.

    What a moving reference asks for at once has to fade alike, or both would differ from then on.
    """
    settings = ControllerSettings(
        plant_order=3, b0=2.0, inner_bandwidth=20.0, controller_bandwidth=3.0
    )
    reference = [0.0, 0.5, 0.0]
    waited = Controller(settings, enabled=False)
    for _ in range(400):
        waited.tick(0.0, 0.005, reference=reference)
    waited.enabled = True
    fresh = Controller(settings, checked=True)
    for k in range(200):
        y = 1e-3 * k * 0.005
        commands = [c.tick(y, 0.005, reference=reference) for c in (waited, fresh)]
        assert commands[0] == pytest.approx(commands[1], abs=1e-9)
    assert abs(commands[0]) > 0.1


def test_a_tick_of_nothing_takes_no_time() -> None:
    controller = Controller(ControllerSettings(measurement_timeout=0.5))
    assert controller.sample.span == controller.sample.elapsed == 0.0  # none came yet
    for _ in range(10):
        controller.tick(0.1, H, reference=[0.2])
    for _ in range(5):
        controller.tick()
    assert (controller.mode, controller.cause) == (Mode.OK, Cause.NONE)
    controller.tick(elapsed=1.0)
    assert controller.cause == Cause.MEASUREMENT_TIMEOUT
