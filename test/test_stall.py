"""At a limit for ever: told, and by choice the end of it."""

from __future__ import annotations

from math import inf, nan
from typing import Any

from law_helpers import Chain, noise
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Cause, Mode
import pytest

H = 0.1
HEATER: dict[str, Any] = {
    'plant_order': 1,
    'b0': 0.0067,
    'command_min': 0.0,
    'controller_bandwidth': 0.05,
    'inner_bandwidth': 0.3,
    'outer_bandwidth': 0.3,
    'measurement_timeout': 1.0,
}


class Heater:
    """y' = -(y - 20) / 300 + power / 150 under its controller, with a sensor that may be stuck."""

    def __init__(self, deviation: float = 0.0, **values: Any) -> None:
        self.controller = Controller(ControllerSettings(**HEATER | values))
        self.y = self.seen = 20.0
        self.noise = iter(noise(1, 100_000, deviation))

    def run(self, seconds: float, r: float, *, stuck: bool = False, gain: float = 1.0) -> None:
        for _ in range(round(seconds / H)):
            self.seen = self.seen if stuck else self.y
            u = self.controller.tick(self.seen + next(self.noise), H, reference=[r])
            self.y += H * ((20.0 - self.y) / 300.0 + gain * u / 150.0)


@pytest.mark.parametrize('deviation', (0.0, 0.1))
def test_a_stuck_sensor_at_full_power_is_told(deviation: float) -> None:
    heater = Heater(deviation, stall_time=20.0)
    heater.run(60.0, 21.0)
    heater.run(19.0, 60.0, stuck=True)
    assert not heater.controller.stalled
    heater.run(3.0, 60.0, stuck=True)
    assert heater.controller.stalled and heater.controller.mode == Mode.OK
    assert heater.controller.limited_for > 20.0
    assert abs(heater.controller.error_growth) < 5 * deviation + 1e-9
    heater.run(60.0, 60.0)  # it works again: nearer, by a twentieth
    assert not heater.controller.stalled


def test_a_stall_that_is_a_fault_lasts_until_it_is_enabled_anew() -> None:
    heater = Heater(stall_time=20.0, stall_action='fault', command_rate_limit=50.0)
    heater.run(45.0, 60.0, stuck=True)
    controller = heater.controller
    assert (controller.mode, controller.cause) == (Mode.SAFE, Cause.STALLED)
    heater.run(100.0, 60.0)
    assert controller.command == 0.0 and controller.cause == Cause.STALLED
    for _ in range(20):  # another fault on top of it, which ends
        controller.tick(nan, 0.0, elapsed=H)
    assert Cause(controller.policy.cause) == Cause.MEASUREMENT_TIMEOUT
    heater.run(10.0, 60.0)
    assert controller.command == 0.0 and controller.mode != Mode.OK
    controller.enabled = False
    heater.run(1.0, 60.0)
    controller.enabled = True
    heater.run(1.0, 60.0)
    assert Mode(controller.policy.mode) == Mode.OK and controller.limited_for < 1.0


def test_to_disable_it_ends_a_stall_even_if_it_is_enabled_before_the_next_sample() -> None:
    heater = Heater(stall_time=20.0)
    heater.run(30.0, 60.0, stuck=True)
    controller = heater.controller
    controller.enabled = True  # as it was
    assert controller.stalled and controller.limited_for > 20.0
    controller.enabled = False
    controller.enabled = True
    assert not controller.stalled and controller.limited_for == 0.0


@pytest.mark.parametrize('deviation', (0.0, 0.1))
@pytest.mark.parametrize('setpoint', (30.0, 100.0, 190.0))
def test_a_slow_rise_at_full_power_is_no_stall(deviation: float, setpoint: float) -> None:
    """The error shrinks by a twentieth within a time constant over 20, here 15 s at the most."""
    heater = Heater(deviation, stall_time=60.0, stall_action='fault')
    for r in (setpoint, 0.5 * setpoint, setpoint, 20.0, setpoint):
        heater.run(120.0, r)
        assert heater.controller.mode == Mode.OK


def test_a_rise_that_begins_at_full_power_with_the_first_command_is_no_stall() -> None:
    controller = Controller(
        ControllerSettings(
            plant_order=1, command_max=10.0, stall_time=9.0, measurement_timeout=0.0
        )
    )
    y = 0.0
    for _ in range(2000):
        y += 0.01 * (controller.tick(y, 0.01, reference=[1000.0]) - 3.0)
        assert not controller.stalled
    assert controller.error_growth < 0.0


def test_a_load_that_no_command_holds_and_a_wrong_sign_are_stalls() -> None:
    heater = Heater(stall_time=20.0)
    heater.run(1500.0, 250.0)
    assert heater.controller.stalled and heater.controller.error_growth < 0.0
    heater = Heater(stall_time=20.0, command_min=-100.0)
    heater.run(40.0, 25.0, gain=-1.0)
    assert heater.controller.stalled and heater.controller.error_growth > 1.0


@pytest.mark.parametrize('action', ('warn', 'fault'))
def test_a_loop_that_idles_at_its_safe_end_is_not_stalled(action: str) -> None:
    """On a sunny day the room is too warm for hours, and the heating is off."""
    slow = {'measurement_timeout': 30.0, 'max_dt': 30.0, 'stall_time': 600.0}
    controller = Controller(ControllerSettings(**HEATER | slow, stall_action=action))
    for k in range(2000):
        assert controller.tick(min(22.0 + 0.005 * k, 26.0), 1.0, reference=[20.0]) == 0.0
        assert not controller.stalled and controller.limited_for == 0.0
    assert controller.mode == Mode.OK and controller.error_growth == 0.0


def test_a_limit_that_is_not_the_safe_one_is_watched_whatever_its_side() -> None:
    heater = Heater(stall_time=20.0, safe_command=100.0)
    heater.run(60.0, 0.0)
    assert heater.controller.command == 0.0 and heater.controller.stalled


def test_to_disable_and_enable_between_two_ticks_ends_a_stall() -> None:
    heater = Heater(stall_time=20.0, stall_action='fault')
    heater.run(45.0, 60.0, stuck=True)
    controller = heater.controller
    assert controller.cause == Cause.STALLED
    controller.enabled = False
    controller.enabled = True
    assert not controller.stalled
    heater.run(10.0, 60.0)
    assert controller.mode == Mode.OK and controller.command > 0.0


def test_ticks_without_a_sample_go_on_counting() -> None:
    controller = Controller(
        ControllerSettings(stall_time=1.0, measurement_timeout=0.0), checked=True
    )
    for k in range(30):
        y, dt = (0.0, 5 * H) if k % 5 == 0 else (nan, 0.0)
        controller.tick(y, dt, elapsed=H, reference=[1e3])
        assert controller.stalled == (controller.policy.stall.stalled > 1.0)
    assert controller.limited_for - 5.1 * H < controller.policy.stall.stalled
    assert 2.0 < controller.limited_for < 3.0


def test_off_nothing_is_a_stall() -> None:
    controller, chain = Controller(ControllerSettings(stall_action='fault')), Chain(2)
    for _ in range(3000):
        controller.tick(chain.y, H, reference=[1e3])
    assert not controller.stalled and controller.mode == Mode.OK
    assert controller.limited_for < inf
