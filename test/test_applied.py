"""The applied command: what somebody reports to act drives the observers, while it is fresh."""

from __future__ import annotations

from collections import deque
from math import sin
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least, Chain, INF, NAMES, NAN, noise, varied_settings
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Mode
from nadrc_ros.records.step_trace import replay, TraceWriter
from nadrc_ros.scenario.files import load
import pytest

H = 0.01
FOREIGN = 7.3
EXAMPLES = Path(__file__).parents[1] / 'examples' / 'loops'
CASES = varied_settings()


def clipped(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def overshoot(limit: float, reported: bool, rate: float) -> float:
    """Return by how much a step to 10 overshoots behind a limit of 5."""
    settings = ControllerSettings(
        command_min=-limit, command_max=limit, command_rate_limit=rate, controller_bandwidth=5.0
    )
    controller, chain, highest = Controller(settings, checked=True), Chain(2), 0.0
    acting = None
    for _ in range(2000):
        u = controller.tick(chain.y, H, reference=[10.0], applied=acting if reported else None)
        acting = clipped(u, 5.0)
        chain.advance(acting - 1.0, H)
        highest = max(highest, chain.y)
    assert chain.y == pytest.approx(10.0, abs=1e-3)
    return highest - 10.0


@pytest.mark.parametrize('rate', (0.0, 40.0))
def test_p06_a_limit_downstream_that_is_reported_is_like_one_of_our_own(rate: float) -> None:
    own = overshoot(5.0, reported=False, rate=rate)
    assert own > 1.0
    assert overshoot(10.0, reported=True, rate=rate) == pytest.approx(own, rel=1e-9)
    # The observers book it as a disturbance, and the command comes back from far behind it.
    assert overshoot(10.0, reported=False, rate=rate) > (1.5 if rate else 1.1) * own


@pytest.mark.parametrize('structure', NAMES)
@pytest.mark.parametrize('rate', (0.0, 20.0))
def test_p11_enabling_begins_with_the_command_of_who_was_in_control(
    structure: str, rate: float
) -> None:
    """Somebody holds the plant against a load of -7.3; then he stops, and we go on."""
    settings = ControllerSettings(
        structure=structure, applied_timeout=0.1, command_rate_limit=rate, command_max=50.0
    )
    controller, chain = Controller(settings, enabled=False), Chain(2)
    for _ in range(200):
        u = controller.tick(chain.y, H, reference=[0.0], applied=FOREIGN)
        assert u == 0.0 and controller.quiet
        chain.advance(FOREIGN - 7.3, H)
    assert controller.total_disturbance == pytest.approx(-7.3, abs=1e-6)
    controller.enabled = True
    assert controller.tick(chain.y, H, applied=FOREIGN) == pytest.approx(FOREIGN, abs=1e-9)
    u = FOREIGN
    for _ in range(200):
        chain.advance(u - 7.3, H)
        u = controller.tick(chain.y, H, applied=u)
        assert u == pytest.approx(FOREIGN, abs=1e-6) and abs(chain.y) < 1e-9


class Echoed:
    """An enabled loop that holds a plant of order 1 with ``push``, and hears what it sent."""

    def __init__(self, push: float, rate: float, late: int) -> None:
        settings = ControllerSettings(
            applied_timeout=0.2,
            command_rate_limit=rate,
            plant_order=1,
            inner_bandwidth=20.0,
            measurement_timeout=0.03,
            hold_time=1.0,
        )
        self.controller, self.chain = Controller(settings, checked=True), Chain(1)
        self.commands, self.late, self.push = [0.0] * late, late, push
        for _ in range(600):
            self.tick(reference=[0.0])
        assert self.commands[-1] == pytest.approx(push, abs=1e-3)

    def tick(
        self, applied: float | None = None, lost: bool = False, dt: float = H, **more: Any
    ) -> float:
        y, dt = (NAN, 0.0) if lost else (self.chain.y, dt)
        echo = self.commands[-self.late] if applied is None else applied
        age = (self.late - 1) * H
        u = self.controller.tick(y, dt, elapsed=H, applied=echo, applied_age=age, **more)
        self.commands.append(u)
        self.chain.advance((u if applied is None else applied) - self.push, H)
        return u


@pytest.mark.parametrize('rate', (0.0, 10.0, 30.0))
@pytest.mark.parametrize('ticks', (1, 3, 20, 45, 90, 300))
@pytest.mark.parametrize('push', (9.0, 4.0, -9.0))
def test_p11_so_it_does_while_our_own_ramp_after_disabling_still_runs(
    rate: float, ticks: int, push: float
) -> None:
    """Which meanwhile goes on from our last command, or at once from theirs if that is nearer."""
    loop = Echoed(push, rate, late=3)
    loop.controller.enabled = False
    for _ in range(ticks):
        before, u = loop.commands[-1], loop.tick(applied=FOREIGN)
        low, high = sorted((before, FOREIGN))
        assert rate == 0.0 or low - rate * H - 1e-9 <= u <= high + rate * H + 1e-9
    loop.controller.enabled = True
    while loop.controller.mode != Mode.OK:  # for the good samples
        u = loop.tick(applied=FOREIGN)
    assert u == pytest.approx(FOREIGN, abs=1e-9)


@pytest.mark.parametrize('ticks', (1, 2, 5, 20, 29, 30, 31, 32, 33, 34, 60))
def test_p05_p11_enabled_on_its_own_ramp_it_goes_on_from_there(ticks: int) -> None:
    """The reports are of what it sent itself, some periods ago."""
    loop = Echoed(9.0, 30.0, late=4)
    loop.controller.enabled = False
    for _ in range(ticks):
        loop.tick()
    loop.controller.enabled = True
    while loop.controller.mode != Mode.OK:
        loop.tick()
    assert loop.commands[-1] == loop.commands[-2]


@pytest.mark.parametrize('late', (1, 2, 5))
def test_p05_an_echo_of_our_own_commands_costs_nothing_of_the_rate(late: int) -> None:
    """Its age is told, or it would seem that our command is ahead of what acts."""
    settings = ControllerSettings(command_rate_limit=30.0, applied_timeout=0.2, plant_order=1)
    controller = Controller(settings, checked=True)
    echoes: deque[float] = deque([0.0] * late, maxlen=late)
    last, fastest = 0.0, 0.0
    for k in range(600):
        r = 5.0 * sin(3.0 * k * H)
        age = (late - 1) * H  # what was sent last acts from now on
        u = controller.tick(0.0, H, reference=[r], applied=echoes[0], applied_age=age)
        assert abs(u - last) <= 30.0 * H * (1.0 + 1e-12)
        fastest = max(fastest, abs(u - last))
        echoes.append(u)
        last = u
    assert fastest == pytest.approx(30.0 * H)


@pytest.mark.parametrize('what', ('gap', 'reset', 'hold', 'end of a hold'))
def test_p05_p10_nor_does_one_take_the_command_back_where_the_law_begins_anew(what: str) -> None:
    """The report is of the command of 0.05 s ago, on a way at the rate limit."""
    settings = ControllerSettings(
        command_rate_limit=30.0,
        applied_timeout=0.2,
        max_dt=0.1,
        measurement_timeout=0.03,
        hold_time=1.0,
    )
    controller, late = Controller(settings, checked=True), 5
    commands = [0.0] * late
    for k in range(60):
        y, dt = 0.0, 0.2 if what == 'gap' and k == 40 else H
        if what == 'reset' and k == 40:
            controller.reset()
        if 'hold' in what and 40 <= k < (60 if what == 'hold' else 46):
            y, dt = NAN, 0.0
        u = controller.tick(
            y,
            dt,
            elapsed=H,
            reference=[5.0],
            applied=commands[-late],
            applied_age=(late - 1) * H,
        )
        assert commands[-1] - 1e-12 <= u <= commands[-1] + 30.0 * H * (1.0 + 1e-9), k
        commands.append(u)


@pytest.mark.parametrize('what', ('gap', 'reset', 'hold', 'end of a hold'))
def test_p10_p11_nor_does_one_where_no_rate_limit_says_how_old_it_may_be(what: str) -> None:
    """The load grows by 0.2 a tick, and with it the command."""
    loop = Echoed(1.0, 0.0, late=5)
    for _ in range(100):
        loop.push += 0.2
        loop.tick()
    for k in range(8):
        if what == 'reset' and k == 0:
            loop.controller.reset()
        lost = what == 'hold' or (what == 'end of a hold' and k < 5)
        u = loop.tick(dt=1.0 if what == 'gap' and k == 0 else H, lost=lost)
        assert abs(u - loop.commands[-2]) < 0.3, k
    assert loop.controller.mode == (Mode.HOLDING if what == 'hold' else Mode.OK)


@pytest.mark.parametrize('sign', (1.0, -1.0))
def test_p05_behind_a_limit_the_command_comes_back_at_once(sign: float) -> None:
    """And not at the rate limit from where it went in vain."""
    settings = ControllerSettings(command_rate_limit=30.0, applied_timeout=0.1, plant_order=1)
    controller = Controller(settings, checked=True)
    u = 0.0
    for _ in range(500):
        u = controller.tick(0.0, H, reference=[100.0 * sign], applied=clipped(u, 5.0))
    assert u == 100.0 * sign
    u = controller.tick(0.0, H, reference=[-100.0 * sign], applied=5.0 * sign)
    assert u == pytest.approx(sign * (5.0 - 30.0 * H), abs=1e-9)


@pytest.mark.parametrize(('gain', 'bias'), ((1.2, 0.0), (0.8, 0.0), (1.0, 0.5), (1.0, -0.5)))
@pytest.mark.parametrize('rate', (0.0, 60.0))
def test_a_report_by_another_measure_does_not_carry_the_command_away(
    gain: float, bias: float, rate: float
) -> None:
    """
    As of a sensor of the torque that is off: the loop settles, and a fault holds.

    It settles beside the reference, as the law gets what acts to where it should be, and not what
    it sends: by (applied - u) b0 / wc^n.
    """
    settings = ControllerSettings(
        command_rate_limit=30.0, applied_timeout=0.1, measurement_timeout=0.05, hold_time=10.0
    )
    controller, chain, u = Controller(settings, checked=True), Chain(2), 0.0
    for _ in range(2000):
        u = controller.tick(chain.y, H, reference=[1.0], applied=gain * u + bias)
        chain.advance(u - 3.0, H)
    off = (gain * u + bias - u) / 16.0
    assert chain.y - 1.0 == pytest.approx(off, abs=1e-6) and u == pytest.approx(3.0, abs=1e-6)
    for _ in range(100):
        held = controller.tick(NAN, 0.0, elapsed=H, applied=gain * u + bias)
        u = held
    assert controller.mode == Mode.HOLDING
    assert held == pytest.approx(3.0 * gain + bias, abs=1e-6)  # what acted as it began


def test_what_is_old_or_no_number_is_not_taken() -> None:
    controller = Controller(ControllerSettings(applied_timeout=0.055), enabled=False)
    controller.tick(0.0, H, reference=[0.0], applied=FOREIGN)
    for applied in (None, NAN, INF, -1e16, None):
        controller.tick(0.0, H, applied=applied)
        assert controller.sample.applied == FOREIGN
    for _ in range(3):
        controller.tick(0.0, H)
        assert controller.sample.applied == controller.command == 0.0
    controller.tick(0.0, H, applied=-FOREIGN, applied_age=0.06)  # it was long on its way
    assert controller.sample.applied != -FOREIGN


def test_without_a_timeout_it_counts_in_its_own_tick() -> None:
    controller = Controller(ControllerSettings(), checked=True)
    controller.tick(0.0, H, reference=[0.0], applied=FOREIGN)
    assert controller.sample.applied == FOREIGN
    u = controller.command
    controller.tick(0.0, H)
    assert controller.sample.applied == u


def test_a_disabled_controller_falls_silent_whatever_acts() -> None:
    settings = ControllerSettings(applied_timeout=0.1, command_rate_limit=100.0)
    controller = Controller(settings, checked=True)
    for _ in range(50):
        controller.tick(0.0, H, reference=[1.0], applied=FOREIGN)
    assert not controller.quiet
    controller.enabled = False
    for _ in range(200):
        u = controller.tick(0.0, H, applied=FOREIGN)
    assert controller.quiet and u == controller.settings.safe_command


def test_the_timeout_is_refused_where_the_newest_report_is_at_times_too_old_for_it() -> None:
    """One a period, with a period added to its age, is up to two old, and three if one is late."""
    with pytest.raises(SettingError, match=r'at least three periods, 0\.03 s at 100 Hz'):
        ControllerSettings(applied_timeout=0.029).check_rate(100.0)
    ControllerSettings(applied_timeout=0.03).check_rate(100.0)
    ControllerSettings(applied_timeout=0.0).check_rate(100.0)


def test_the_timeout_is_fixed_at_start() -> None:
    with pytest.raises(SettingError, match='applied_timeout'):
        Controller(ControllerSettings()).check_retune(ControllerSettings(applied_timeout=0.1))


@at_least(100)
@given(st.sampled_from(sorted(CASES)), st.integers(0, 2**30))
def test_p02_p18_whatever_is_reported_commands_stay_good_and_replay(case: str, seed: int) -> None:
    settings = ControllerSettings(**CASES[case], applied_timeout=0.05, feed_forward_timeout=0.03)
    values = noise(seed, 60, 30.0)
    controller = Controller(settings)
    again = Controller(settings)
    for i in range(0, 60, 3):
        reported = values[i] if values[i] > -10.0 else None
        fed = values[i + 1] if values[i + 1] > 0.0 else NAN
        y = values[i + 2] * 0.01 if values[i + 2] < 30.0 else NAN
        u = controller.tick(y, H, reference=[0.1], applied=reported, feed_forward=fed)
        assert settings.command_min <= u <= settings.command_max
        told = controller.sample
        replayed = again.tick(
            y,
            H,
            reference=[0.1],
            applied=told.applied,
            applied_age=told.applied_age,
            feed_forward=told.feed_forward,
        )
        assert replayed == u


def test_p18_a_run_with_reports_and_feed_forward_is_replayed(tmp_path: Path) -> None:
    path = tmp_path / 'trace.jsonl'
    settings = ControllerSettings(
        applied_timeout=0.05, feed_forward_timeout=0.05, command_rate_limit=50.0
    )
    controller = Controller(settings, checked=True)
    trace, chain = TraceWriter(path, settings, checked=True), Chain(2)
    u = 0.0
    for k in range(300):
        reported = clipped(u, 2.0) if k % 50 < 30 else None
        fed = sin(0.1 * k) if k % 80 < 50 else None
        lost = k % 7 == 6
        u = controller.tick(
            NAN if lost else chain.y,
            0.0 if lost else H,
            elapsed=H,
            reference=[1.0],
            applied=reported,
            applied_age=0.5 * H,
            feed_forward=fed,
        )
        trace.tick(controller, [1.0])
        chain.advance(clipped(u, 2.0), H)
    trace.close()
    pairs = list(replay(path))
    assert len(pairs) == 300 and all(recorded == again for recorded, again in pairs)
    assert len(set(pairs)) > 200


def test_a_scenario_with_a_limit_downstream_shows_what_a_report_is_worth() -> None:
    scenario = load(EXAMPLES / 'applied.yaml')
    runs = {name: scenario.run(name) for name in scenario.controllers}
    over = {name: run.output.max() - 6.0 for name, run in runs.items()}
    assert over['reported'] == pytest.approx(over['own_limits'], rel=1e-9)
    assert over['unknown'] > 3.0 * over['own_limits']
