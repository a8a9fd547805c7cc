"""What may become a setpoint: nothing odd, whoever says it."""

from __future__ import annotations

from itertools import pairwise
from math import exp, nan
import random

from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least, Chain
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Cause, Mode, Status
import pytest

H = 0.1
HEATER = ControllerSettings(
    plant_order=1,
    b0=0.0067,
    command_min=0.0,
    controller_bandwidth=0.05,
    inner_bandwidth=0.5,
    outer_bandwidth=0.5,
    good_samples=5,
)


@pytest.mark.parametrize('at', range(5))
@pytest.mark.parametrize('odd', (85.0, 0.0, -127.0))
def test_p08_one_odd_reading_is_no_setpoint_wherever_it_comes(odd: float, at: int) -> None:
    """A DS18B20 says 85 after power-up, which became the setpoint: full power."""
    controller = Controller(HEATER)
    readings = [20.1] * 30
    readings[at] = odd
    commands = [controller.tick(y, H) for y in readings]
    assert controller.mode == Mode.OK
    assert controller.reference == [20.1, 0.0]
    assert max(commands) == 0.0


def test_p08_a_spoiled_row_begins_again() -> None:
    controller = Controller(HEATER)
    for y in (20.0, 20.0, 20.0, 20.0, nan, 20.0, 20.0, 20.0, 20.0):
        assert controller.tick(y, H) == 0.0
        assert (controller.mode, controller.cause) == (Mode.SAFE, Cause.START)
    controller.tick(20.0, H)
    assert controller.mode == Mode.OK


@pytest.mark.parametrize('good', (1, 2, 3, 20))
@pytest.mark.parametrize('seed', range(20))
def test_p08_a_noisy_sensor_starts_a_few_samples_late_at_most(good: int, seed: int) -> None:
    controller = Controller(ControllerSettings(good_samples=good))
    rng, ticks = random.Random(seed), 0
    while controller.mode != Mode.OK:
        controller.tick(rng.gauss(5.0, 0.1), H)
        ticks += 1
    assert good <= ticks <= good + 3


@at_least(100)
@given(
    st.integers(1, 10),
    st.floats(-10.0, 10.0),
    st.floats(-1e3, 1e3),
    st.floats(-1e4, 1e4),
    st.floats(0.0, 6.0),
    st.sampled_from((0.0, 1e-3, 0.1, 5.0)),
)
def test_p08_a_moving_machine_starts_all_the_same(
    good: int, x: float, v: float, a: float, growth: float, step: float
) -> None:
    """At any speed and acceleration, falling over (the steps grow), and with a coarse sensor."""
    controller = Controller(ControllerSettings(good_samples=good))
    for k in range(good + 3):
        t = k * H
        y = x + v * t + a * t * t / 2 + exp(growth * t)
        controller.tick(step * round(y / step) if step else y, H)
    assert controller.mode == Mode.OK


@pytest.mark.parametrize('ends', ('enabled', 'silent'))
@pytest.mark.parametrize('tracking', (0.0, 2.0))
def test_p08_nor_does_an_odd_reading_at_enabling_or_after_a_fault(
    ends: str, tracking: float
) -> None:
    settings = ControllerSettings(
        good_samples=3, measurement_timeout=0.3, tracking_acceleration=tracking
    )
    controller = Controller(settings, enabled=ends == 'silent')
    for _ in range(20):
        controller.tick(20.1, H)
    if ends == 'silent':
        for _ in range(20):
            controller.tick(nan, 0.0, elapsed=H)
        for _ in range(2):
            controller.tick(20.1, H)
    controller.enabled = True
    controller.tick(85.0, H)
    assert controller.mode != Mode.OK
    controller.tick(20.1, H)
    assert Mode(controller.policy.mode) == Mode.OK
    assert controller.reference == [20.1, 0.0, 0.0]
    assert controller.tracking == 20.1


@pytest.mark.parametrize('tracking', (0.0, 2.0))
def test_a_reset_changes_no_setpoint(tracking: float) -> None:
    """Held or received: only the estimates are forgotten."""
    controller = Controller(ControllerSettings(tracking_acceleration=tracking))
    chain = Chain(2)
    for k in range(300):
        if k in (100, 200):
            controller.reset()
        reference = [1.0] if k >= 150 else None
        y = chain.y + (0.3 if k == 100 else 0.0)
        chain.advance(controller.tick(y, 0.01, reference=reference), 0.01)
        if k == 100:
            assert controller.reference == [0.0, 0.0, 0.0]
    assert controller.tracking > 0.5


def test_in_a_simulation_the_first_sample_is_enough() -> None:
    """There the plant waits at its initial state until the first command."""
    controller = Controller(HEATER, checked=True)
    controller.tick(20.0, H, reference=[30.0])
    assert controller.mode == Mode.OK


def test_p01_a_reference_outside_its_range_is_none() -> None:
    controller = Controller(ControllerSettings(reference_min=0.0, reference_max=300.0))
    for r in (0.0, 300.0, 50.0):
        controller.tick(20.0, H, reference=[r])
        assert controller.reference[0] == r
    for bad in (5000.0, -1e-9, 300.0001):
        controller.tick(20.0, H, reference=[bad])
        assert controller.reference[0] == 50.0
        assert controller.refused_reference == bad
    assert controller.counts[Status.BAD_REFERENCE] == 3
    assert controller.policy.reference_age == pytest.approx(3 * H)
    controller.tick(20.0, H, reference=[60.0])
    assert controller.reference[0] == 60.0 and controller.refused_reference != 300.0001


def test_p13_a_range_of_the_reference_that_is_empty_is_refused() -> None:
    with pytest.raises(SettingError, match='reference_min'):
        ControllerSettings(reference_min=5.0, reference_max=5.0)


def test_p12_derivatives_that_cease_in_saturation_leave_no_trace() -> None:
    """The law asks for the limit with and without them, so that no offset is needed."""
    outputs = []
    for ceased in (10, 50, 100):
        controller, chain = Controller(ControllerSettings(command_max=2.0)), Chain(2)
        for k in range(600):
            r, rate = min(0.04 * k, 8.0), 4.0 if k <= 200 else 0.0
            derivatives = [rate, 0.0] if k < ceased else [None, None]
            u = controller.tick(chain.y, 0.01, reference=[r, *derivatives])
            chain.advance(u, 0.01)
        outputs.append(chain.y)
    assert max(abs(b - a) for a, b in pairwise(outputs)) < 1e-6
