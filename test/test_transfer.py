"""What comes after the first sample of a transfer: enabling, restarting, losing the reference."""

from __future__ import annotations

from itertools import pairwise
from math import sin

import attrs
from law_helpers import Chain, NAMES, state_bits
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import disturbance_estimate, output_estimate
from nadrc_ros.adrc.status import Cause, Mode, Status
from nadrc_ros.adrc.transfer import restart_profile
import pytest

H = 0.01
NAN = float('nan')


# wc times the time until a step response of order n stays within 2 %.
SETTLING = {1: 3.91, 2: 5.83, 3: 7.52, 4: 9.08}


@pytest.mark.parametrize('order', (1, 2, 3))
@pytest.mark.parametrize('at', (0.0, 8.0))
def test_a_step_at_the_start_settles_like_one_of_an_order_more(order: int, at: float) -> None:
    """The bumpless takeover decays with wc."""
    settings = ControllerSettings(
        plant_order=order, controller_bandwidth=1.0, inner_bandwidth=30.0, outer_bandwidth=30.0
    )
    controller, chain, settled = Controller(settings, checked=True), Chain(order), 0.0
    for k in range(2000):
        t = k * H
        if t >= at and abs(chain.y - 1.0) > 0.02:
            settled = t - at
        reference = [1.0] if t >= at else [0.0]
        chain.advance(controller.tick(chain.y, H, reference=reference), H)
    assert settled == pytest.approx(SETTLING[order + (at == 0.0)], abs=0.02)


@pytest.mark.parametrize('acceleration', (0.0, 5.0))
@pytest.mark.parametrize('error_based', (False, True))
def test_p11_enabling_without_a_reference_stays_where_it_is(
    error_based: bool, acceleration: float
) -> None:
    """The first measurement was elsewhere; what counts is where the plant rests now."""
    controller = Controller(
        ControllerSettings(error_based=error_based, tracking_acceleration=acceleration),
        enabled=False,
    )
    controller.tick(0.0, H)
    for _ in range(400):
        controller.tick(1.0, H)
    controller.enabled = True
    commands = [controller.tick(1.0, H) for _ in range(50)]
    assert controller.reference == [1.0, 0.0, 0.0]
    assert commands == pytest.approx([0.0] * 50, abs=1e-4)


@pytest.mark.parametrize('glitch', (10.0, 1e3, 1e6))
@pytest.mark.parametrize('at', (0, 400))
def test_p04_a_bad_sample_at_a_transfer_does_not_wind_the_offset_up(
    glitch: float, at: int
) -> None:
    """At rest in the origin, one wild but finite sample; the plant stays near and settles."""
    controller = Controller(
        ControllerSettings(
            inner_bandwidth=12.0, outer_bandwidth=12.0, command_min=-20.0, command_max=20.0
        ),
        enabled=at == 0,
    )
    chain, largest = Chain(2), 0.0
    for k in range(1500):
        controller.enabled = controller.enabled or k == at
        y = glitch if k == at else chain.y
        chain.advance(controller.tick(y, H, reference=[0.0]), H)
        largest = max(largest, abs(chain.y))
    size = max(1.0, abs(glitch)) ** 0.25  # the observers forget in about log(glitch) / w seconds
    assert largest < 2.0 * size
    assert abs(chain.y) < 0.01


def test_a_reference_that_dies_loses_its_derivatives_without_a_bump() -> None:
    """Held at its last value the reference stands still, whatever its last rate was."""
    controller = Controller(ControllerSettings(max_dt=0.1))
    chain = Chain(2)
    commands = []
    for k in range(1200):
        known = [0.5 * k * H, 0.5] if k <= 400 else None
        commands.append(controller.tick(chain.y, H, reference=known))
        chain.advance(commands[-1], H)
    assert chain.y == pytest.approx(0.5 * 400 * H, abs=1e-3)
    steps = [abs(b - a) for a, b in pairwise(commands[380:])]
    assert max(steps) < 0.5  # the lost rate alone is worth 2 wc r' = 4


def test_p07_the_hold_of_a_lost_reference_begins_without_a_bump() -> None:
    settings = ControllerSettings(reference_timeout=0.1, hold_time=1.0, inner_bandwidth=80.0)
    controller, chain, commands = Controller(settings), Chain(2), []
    for k in range(300):
        reference = [k * H, 1.0, 0.0] if k < 200 else None
        commands.append(controller.tick(chain.y, H, reference=reference))
        chain.advance(commands[-1], H)
    steps = [abs(b - a) for a, b in pairwise(commands[190:])]
    assert max(steps) < 1.0  # dropped at once, r' = 1 would be worth 2 wc = 8


def test_p07_a_reference_that_returns_in_the_hold_is_approached_from_the_profile() -> None:
    controller = Controller(
        ControllerSettings(reference_timeout=0.1, hold_time=10.0, tracking_acceleration=2.0),
        checked=True,
    )
    chain = Chain(2)

    def run(ticks: int, reference: list[float] | None) -> None:
        for _ in range(ticks):
            chain.advance(controller.tick(chain.y, H, reference=reference), H)

    run(60, [1.0])
    run(20, None)
    assert (Mode(controller.mode), controller.cause) == (Mode.HOLDING, Cause.REFERENCE_TIMEOUT)
    reached = controller.tracking
    chain.x[0] -= 0.3
    run(5, [1.0])
    assert Mode(controller.mode) == Mode.OK
    assert reached < controller.tracking < reached + 0.1


@pytest.mark.parametrize('order', (1, 2, 3))
@pytest.mark.parametrize('error_based', (False, True))
def test_a_profile_that_is_moved_leaves_what_is_known_of_the_plant(
    order: int, error_based: bool
) -> None:
    settings = ControllerSettings(
        plant_order=order, error_based=error_based, tracking_acceleration=3.0
    )
    controller = Controller(settings)
    for k in range(50):  # a reference on its way, so that the profile has derivatives
        controller.tick(0.0, 0.01, reference=[1.0 + 0.1 * k])
    design, state = controller.design, controller.state
    before = output_estimate(design, state), disturbance_estimate(design, state)
    assert state.profile[1] > 0.0
    restart_profile(design, 7.0, state)
    assert state.profile == [7.0] + [0.0] * order
    after = output_estimate(design, state), disturbance_estimate(design, state)
    assert after == pytest.approx(before, abs=1e-9)


def test_the_last_pole_ratio_counts_for_the_rest() -> None:
    """So that a change of structure is never trapped by a list of the wrong length."""
    for ratios in ((1.0,), (1.0, 2.0), (1.0, 2.0, 3.0, 4.0, 5.0)):
        for structure in ('conventional', 'generalized'):
            settings = ControllerSettings(structure=structure, pole_ratios=ratios)
            used = Controller(settings).design.pole_ratios
            assert used == [*ratios, *[ratios[-1]] * 5][: len(used)]


def test_p04_an_absurd_sample_is_no_sample() -> None:
    controller = Controller(ControllerSettings())
    controller.tick(0.0, H, reference=[0.0])
    controller.tick(1.1e15, H)
    assert controller.status == Status.NO_MEASUREMENT
    controller.tick(NAN, H)
    assert controller.status == Status.NO_MEASUREMENT


def test_p04_a_glitch_outside_the_range_of_the_sensor_is_no_sample() -> None:
    settings = ControllerSettings(measurement_min=-1.0, measurement_max=2.0)
    controller, untouched = Controller(settings), Controller(settings)
    for k in range(200):
        y = 0.3 * sin(0.05 * k)
        same = controller.tick(y, H, reference=[0.0])
        assert same == untouched.tick(y, H, reference=[0.0])
    for glitch in (2.0001, -1.0001, 1e3, -1e14):
        before = state_bits(controller.state)
        assert controller.tick(glitch, H) == same
        assert controller.status == Status.NO_MEASUREMENT
        assert state_bits(controller.state) == before
    for limit in (2.0, -1.0):
        controller.tick(limit, H)
        assert controller.status < Status.NO_MEASUREMENT
    fresh = Controller(settings)
    fresh.tick(50.0, H, reference=[0.0])
    assert fresh.cause == Cause.START


@pytest.mark.parametrize('poles', ((0.0,), (-2.0, 0.5)))
@pytest.mark.parametrize('error_based', (False, True))
def test_p12_estimates_of_the_error_have_the_rate_of_the_reference_of_now(
    error_based: bool, poles: tuple[float, ...]
) -> None:
    """A differentiator that is switched off leaves them another one; the command jumped by 1.9."""
    settings = ControllerSettings(
        tracking_acceleration=5.0, error_based=error_based, plant_poles=poles
    )
    controller, chain = Controller(settings, checked=True), Chain(2)
    for k in range(1000):
        if k == 500:
            controller.retune(attrs.evolve(settings, tracking_acceleration=0.0))
        before = controller.command
        push = sum(poles) * chain.x[1] - (poles[0] * poles[-1]) * chain.y
        u = controller.tick(chain.y, H, reference=[0.5 * k * H, 0.5])
        chain.advance(u + push, H)
        assert k < 500 or abs(u - before) < 0.05


@pytest.mark.parametrize('structure', NAMES)
def test_p12_a_new_b0_asks_the_estimate_of_what_the_command_did(structure: str) -> None:
    """L = y'' - b0 u, with the u that acted; disabled, that is not the one the law would send."""
    settings = ControllerSettings(structure=structure, safe_command=-2.0)
    controller, chain = Controller(settings, enabled=False), Chain(2)
    for _ in range(300):
        chain.advance(controller.tick(chain.y, H, reference=[5.0]) + 2.5, H)
    assert controller.total_disturbance == pytest.approx(2.5, abs=1e-4)
    controller.retune(attrs.evolve(settings, b0=3.0))
    for _ in range(20):
        chain.advance(controller.tick(chain.y, H, reference=[5.0]) + 2.5, H)
        assert controller.total_disturbance == pytest.approx(2.5 - 2.0 * -2.0, abs=1e-3)
