"""The fault policy, through the controller that runs it."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from law_helpers import Chain, NAN, state_bits
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Cause, Mode
import pytest

H = 0.01
SETTINGS: dict[str, Any] = {
    'measurement_timeout': 0.1,
    'hold_time': 0.05,
    'safe_command': -2.0,
    'command_rate_limit': 40.0,
    'good_samples': 4,
}


class Bench:
    """A controller on a chain whose sensor, reference and enable switch can be worked."""

    def __init__(self, enabled: bool = True, **values: Any) -> None:
        self.controller = Controller(ControllerSettings(**SETTINGS | values), enabled=enabled)
        self.chain = Chain(self.controller.design.order)
        self.commands = [self.controller.command]
        self.modes: list[Mode] = []
        self.since = H

    def run(self, ticks: int, r: float | None = 1.0, bad: float | None = None) -> list[float]:
        """Advance; with ``bad`` as the measurement (nan: a bad sample each tick)."""
        for _ in range(ticks):
            y = self.chain.y if bad is None else bad
            reference = None if r is None else [r]
            u = self.controller.tick(y, self.since, elapsed=H, reference=reference)
            self._end(u)
            self.since = H
        return self.commands[-ticks:]

    def _end(self, u: float) -> None:
        self.commands.append(u)
        self.modes.append(self.controller.mode)
        self.chain.advance(u + 5.0, H)

    def silent(self, ticks: int, r: float | None = 1.0) -> list[float]:
        """No sample at all: dt = 0, time goes on."""
        for _ in range(ticks):
            reference = None if r is None else [r]
            u = self.controller.tick(NAN, 0.0, elapsed=H, reference=reference)
            self._end(u)
            self.since += H
        return self.commands[-ticks:]

    def mode(self) -> Mode:
        return self.controller.mode

    def cause(self) -> Cause:
        return self.controller.cause

    def largest_change(self) -> float:
        return max(abs(b - a) for a, b in pairwise(self.commands))


@pytest.mark.parametrize('silent', (True, False))
def test_p07_silence_leads_to_hold_then_ramp_then_safe(silent: bool) -> None:
    bench = Bench()
    held = bench.run(300)[-1]
    commands = bench.silent(100) if silent else bench.run(100, bad=NAN)
    modes = bench.modes[-100:]
    # Fault action within timeout + 1 Ts, hold_time of holding, then the ramp of 40 per second.
    began = modes.index(Mode.HOLDING)
    assert 10 <= began <= 11
    ramped = modes.index(Mode.RAMPING)
    assert 5 <= ramped - began <= 6
    assert commands[:ramped] == [held] * ramped
    last = modes.index(Mode.SAFE) - 1
    ramp = [held, *commands[ramped:last]]
    assert [b - a for a, b in pairwise(ramp)][:-1] == pytest.approx([0.4] * (len(ramp) - 2))
    assert commands[last:] == [-2.0] * (100 - last)
    assert bench.cause() == Cause.MEASUREMENT_TIMEOUT
    assert bench.largest_change() <= 0.4 * (1 + 1e-9)


def test_p07_silence_counts_from_when_the_sample_was_there() -> None:
    bench = Bench()
    bench.run(100)
    controller = bench.controller
    for age, bridged in ((0.0, 10), (0.065, 3), (5.0, 0)):  # of at most 0.1 s
        controller.tick(bench.chain.y, H, elapsed=H, reference=[1.0], age=age)
        assert controller.mode == Mode.OK  # what came is used, however late
        assert controller.policy.measurement_age == age
        bench.silent(bridged)
        assert bench.mode() == Mode.OK
        bench.silent(2)
        assert (bench.mode(), bench.cause()) == (Mode.HOLDING, Cause.MEASUREMENT_TIMEOUT)
        bench.run(4)
        assert bench.mode() == Mode.OK


@pytest.mark.parametrize('stage', (11, 18, 22, 80))
def test_p05_p07_after_silence_the_loop_resumes_from_where_it_is(stage: int) -> None:
    bench = Bench()
    bench.run(300)
    last = bench.silent(stage)[-1]
    back = bench.run(4)
    if stage < 15:
        assert back == [last] * 4
    assert bench.modes[-2] != bench.modes[-1] == Mode.OK
    assert back[3] == pytest.approx(back[2], abs=1e-9)
    bench.run(600)
    assert bench.chain.y == pytest.approx(1.0, abs=1e-2)
    assert bench.largest_change() <= 0.4 * (1 + 1e-9)


def test_p04_after_bad_samples_the_loop_is_back_within_the_good_ones() -> None:
    """Shorter than the timeout nothing happens at all but a held command and a longer dt."""
    for count in (1, 3, 9):
        bench = Bench()
        bench.run(300)
        assert abs(bench.chain.y - 1.0) < 1e-3
        bench.run(count, bad=NAN)
        assert set(bench.modes[3:]) == {Mode.OK}
        bench.run(20)
        assert abs(bench.chain.y - 1.0) < 1e-2
        assert bench.controller.total_disturbance == pytest.approx(5.0, abs=0.1)


def test_p04_the_step_after_bad_samples_spans_them_too() -> None:
    """As if they had never come: three periods are one step of three periods."""
    spoiled, silent = Bench(command_rate_limit=0.0), Bench(command_rate_limit=0.0)
    for bench in (spoiled, silent):
        bench.run(100)
        bench.chain.x[1] += 1.0
    spoiled.run(2, bad=NAN)
    silent.silent(2)
    silent.since = H + H + H
    assert spoiled.run(1) == silent.run(1)
    assert state_bits(spoiled.controller.state) == state_bits(silent.controller.state)
    assert spoiled.run(1)[0] != spoiled.commands[100]


@pytest.mark.parametrize('bad', (NAN, float('inf'), 1e308))
@pytest.mark.parametrize('feed', ('measurement', 'reference', 'dt', 'elapsed', 'applied'))
def test_p04_no_input_poisons(feed: str, bad: float) -> None:
    """One bad number in any argument; a good loop again after it."""
    bench = Bench(command_rate_limit=0.0)
    bench.run(300)
    arguments: dict[str, Any] = {'measurement': bench.chain.y, 'dt': H, 'reference': [1.0]}
    arguments[feed] = [bad] if feed == 'reference' else bad
    bench.controller.tick(**arguments)
    bench.run(300)
    assert bench.mode() == Mode.OK
    assert bench.chain.y == pytest.approx(1.0, abs=1e-2)
    policy = bench.controller.policy
    assert policy.gap == policy.measurement_age == 0.0 and policy.reference_age == 0.0


@pytest.mark.parametrize('dt', (-5.0, -1e308, float('-inf'), 0.0))
def test_p10_time_that_runs_backwards_is_no_update(dt: float) -> None:
    bench = Bench()
    bench.run(100)
    before, u = state_bits(bench.controller.state), bench.controller.command
    assert bench.controller.tick(bench.chain.y, dt, elapsed=H) == u
    assert state_bits(bench.controller.state) == before
    assert bench.run(1)[0] != u
    assert bench.controller.policy.gap == 0.0


def test_p19_good_samples_are_counted_in_a_row() -> None:
    bench = Bench()
    bench.run(100)
    bench.silent(30)
    for _ in range(10):
        bench.run(3)
        bench.run(1, bad=NAN)
        assert bench.mode() != Mode.OK
    bench.run(2)
    bench.silent(3)  # no sample is not a bad sample
    bench.run(1)
    assert bench.mode() != Mode.OK
    bench.run(1)
    assert bench.mode() == Mode.OK


def test_p19_the_most_severe_cause_wins_and_the_mode_only_rises() -> None:
    bench = Bench(reference_timeout=0.05)
    bench.run(100)
    bench.run(8, r=None)
    assert (bench.mode(), bench.cause()) == (
        Mode.HOLDING,
        Cause.REFERENCE_TIMEOUT,
    )
    bench.silent(12, r=None)
    assert bench.cause() == Cause.MEASUREMENT_TIMEOUT
    bench.controller.enabled = False
    bench.silent(1, r=None)
    assert bench.cause() == Cause.DISABLED
    bench.silent(200, r=None)
    assert bench.mode() == Mode.SAFE and bench.controller.quiet
    first = bench.modes.index(Mode.HOLDING)
    assert bench.modes[first:] == sorted(bench.modes[first:])
    assert bench.largest_change() <= 0.4 * (1 + 1e-9)


def test_p19_switching_off_and_on_does_not_shorten_the_way_out_of_a_fault() -> None:
    bench = Bench()
    bench.run(100)
    bench.silent(30)
    bench.controller.enabled = False
    bench.silent(2)
    bench.controller.enabled = True
    bench.silent(2)
    assert bench.cause() == Cause.MEASUREMENT_TIMEOUT
    bench.run(3)
    assert bench.mode() != Mode.OK
    bench.run(1)
    assert bench.mode() == Mode.OK


def test_p19_switching_off_and_on_beside_a_working_sensor_does_not_shorten_it_either() -> None:
    bench = Bench()
    bench.run(100)
    bench.silent(30)
    bench.run(1)
    bench.controller.enabled = False
    bench.run(1)
    bench.controller.enabled = True
    bench.run(1)
    assert bench.mode() != Mode.OK
    bench.run(1)
    assert bench.mode() == Mode.OK


def test_p07_a_lost_reference_is_held_by_the_law_then_ramped() -> None:
    bench = Bench(reference_timeout=0.1, hold_time=0.5)
    bench.run(300)
    bench.controller.tick(bench.chain.y, H, reference=[1.0, 2.0, 3.0])
    bench.run(30, r=None)
    assert bench.mode() == Mode.HOLDING
    assert bench.controller.reference == [1.0, 0.0, 0.0]
    bench.run(100, r=None)
    assert bench.mode() == Mode.SAFE and bench.commands[-1] == -2.0
    bench.run(10)
    assert bench.mode() == Mode.OK


def test_p07_from_safe_a_returning_reference_is_approached_from_where_the_plant_is() -> None:
    bench = Bench(reference_timeout=0.1, hold_time=0.1, tracking_acceleration=2.0)
    bench.run(200, r=0.0)
    bench.run(100, r=None)
    assert bench.mode() == Mode.SAFE
    bench.chain.x[0] = 3.0
    bench.run(20, r=0.0)
    assert bench.mode() == Mode.OK
    assert 2.0 < bench.controller.tracking < 4.0


def test_p07_in_the_hold_of_a_lost_reference_the_loop_stays_closed() -> None:
    bench = Bench(reference_timeout=0.1, hold_time=10.0)
    bench.run(300)
    bench.run(20, r=None)
    assert (bench.mode(), bench.cause()) == (Mode.HOLDING, Cause.REFERENCE_TIMEOUT)
    bench.chain.x[0] += 0.5
    bench.run(500, r=None)
    assert bench.mode() == Mode.HOLDING
    assert bench.chain.y == pytest.approx(1.0, abs=1e-3)


def test_timeouts_of_zero_are_off() -> None:
    bench = Bench(measurement_timeout=0.0)
    bench.run(100)
    held = bench.commands[-1]
    assert bench.silent(1000, r=None) == [held] * 1000


def test_p08_only_safe_before_the_first_valid_measurement() -> None:
    bench = Bench()
    assert set(bench.run(20, bad=NAN) + bench.run(3, bad=1e308) + bench.silent(20)) == {-2.0}
    assert bench.cause() == Cause.START and bench.mode() == Mode.SAFE


def test_p08_also_disabled_the_last_of_the_good_samples_is_held() -> None:
    bench = Bench(enabled=False)
    bench.chain.x[0] = 7.0
    bench.run(20, r=None)
    assert bench.chain.y > 7.05
    after = pytest.approx(7.0 + 3.0 * (3 * H) ** 2 / 2)  # the fourth sample of a push by 3
    assert bench.controller.reference[0] == bench.controller.tracking == after


def test_p08_p11_the_first_command_of_all_is_the_safe_one() -> None:
    bench = Bench()
    assert bench.run(4, r=50.0) == [-2.0] * 4 and bench.modes[-2:] == [Mode.SAFE, Mode.OK]
    assert bench.run(1, r=50.0) != [-2.0]


def test_p08_before_the_first_reference_the_first_measurement_is_held() -> None:
    bench = Bench(good_samples=1)
    bench.chain.x[0] = 7.0
    bench.run(20, r=None, bad=NAN)
    start = bench.chain.y
    bench.run(800, r=None)
    assert bench.controller.reference == [start, 0.0, 0.0]
    assert bench.chain.y == pytest.approx(start, abs=1e-2)


@pytest.mark.parametrize('structure', ('nested', 'printed', 'cascade', 'conventional'))
@pytest.mark.parametrize('error_based', (False, True))
@pytest.mark.parametrize('tracking', (0.0, 3.0))
def test_p11_enabling_is_bumpless(structure: str, error_based: bool, tracking: float) -> None:
    bench = Bench(
        enabled=False,
        structure=structure,
        error_based=error_based,
        tracking_acceleration=tracking,
        command_rate_limit=0.0,
    )
    assert set(bench.run(200, r=50.0)) == {-2.0}
    bench.controller.enabled = True
    at, moving = bench.chain.y, bench.chain.x[1]
    assert bench.run(1, r=50.0)[0] == pytest.approx(-2.0, abs=1e-9)
    assert bench.mode() == Mode.OK
    if tracking:
        assert bench.controller.tracking == pytest.approx(at, abs=1e-12)
        commands = bench.run(20, r=50.0)
        assert max(abs(u) for u in commands) < 2.0 + 3.0 * abs(moving) * 8.0
    bench.run(2500, r=50.0)
    assert bench.chain.y == pytest.approx(50.0, abs=0.1)


def test_p11_the_law_takes_over_gradually_from_the_first_command() -> None:
    """It would brake by -40 or so at once: the plant moves, as nobody held it while disabled."""
    bench = Bench(enabled=False, command_rate_limit=0.0)
    bench.run(200, r=None)
    assert bench.chain.x[1] == pytest.approx(6.0, abs=0.1)
    bench.controller.enabled = True
    bench.run(50, r=None)
    assert min(bench.commands) < -20.0
    assert bench.largest_change() < 4.2


def test_p05_p14_disabling_ramps_to_safe_and_goes_quiet() -> None:
    bench = Bench()
    bench.run(300)
    assert not bench.controller.quiet
    bench.controller.enabled = False
    commands = bench.run(60)
    assert commands[0] == pytest.approx(-5.0 + 0.4, abs=0.1)
    assert commands[-1] == -2.0 and bench.controller.quiet
    assert bench.largest_change() <= 0.4 * (1 + 1e-9)
    held = Bench(command_rate_limit=0.0)
    held.run(300)
    held.controller.enabled = False
    assert held.run(1) == [-2.0]


def test_a_sample_that_only_restarts_the_observers_says_so() -> None:
    bench = Bench(max_dt=0.05, measurement_timeout=0.0)
    bench.run(10)
    assert not bench.controller.restarted
    bench.silent(9)
    bench.run(1)
    bench.silent(3)
    assert bench.controller.restarted and bench.mode() == Mode.OK
    bench.run(1)
    assert not bench.controller.restarted


def test_p05_a_gap_does_not_save_up_rate() -> None:
    """After bad samples the command may move as far as in any tick, whatever the gap was."""
    bench = Bench(measurement_timeout=0.0)
    bench.run(100)
    bench.run(30, bad=NAN)
    bench.run(100, r=30.0)
    assert bench.largest_change() <= 0.4 * (1 + 1e-9)


@pytest.mark.parametrize('elapsed', (NAN, -1.0, 0.0))
def test_p05_no_time_no_change(elapsed: float) -> None:
    """On the way to safe, a time that is not one moves the command nowhere."""
    bench = Bench()
    bench.run(300)
    bench.controller.enabled = False
    ramping = bench.run(2)[-1]
    assert bench.controller.tick(bench.chain.y, H, elapsed=elapsed) == ramping
    assert bench.mode() == Mode.RAMPING


def test_p04_an_unknown_applied_command_is_the_last_one() -> None:
    bench, other = Bench(), Bench()
    for own, applied in ((bench, NAN), (other, None)):
        own.run(100)
        own.controller.reset()
        own.controller.tick(own.chain.y, H, applied=applied)
        own.run(50)
    assert bench.commands == other.commands
