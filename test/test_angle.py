"""Angles: what turns without end is controlled through a sensor that wraps as if it did not."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, isfinite, pi, sin
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least, bits, Chain, NAMES, NAN, noise
from nadrc_ros.adrc.angle import short, whole
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Mode, Status
from nadrc_ros.scenario import dump, loads
from nadrc_ros.simulation.sensor import shown
from nadrc_ros.simulation.simulate import simulate
import numpy as np
import pytest

H = 0.01
TURN = 2.0 * pi
WAYS: dict[str, dict[str, Any]] = {
    **{name: {'structure': name} for name in NAMES},
    'error-based': {'error_based': True},
    'error-based cascade': {'structure': 'cascade', 'error_based': True, 'levels': 3},
    'differentiator': {'tracking_acceleration': 200.0},
    'error-based differentiator': {'tracking_acceleration': 200.0, 'error_based': True},
    'first order': {'plant_order': 1, 'feedback_level': 'outer'},
    'fal': {'feedback': 'fal'},
    'known poles': {'plant_poles': (0.0, 2.0)},
    'vibration': {'disturbance_frequencies': (7.0,), 'levels': 1},
    'dead time': {'input_delay': 0.025, 'inner_bandwidth': 20.0, 'controller_bandwidth': 3.0},
}


def wrapped(value: float, period: float) -> float:
    return value - whole(value, period)


def controller_of(period: float = TURN, scale: float = 1.0, **values: Any) -> Controller:
    """Return one of a plant whose output has that unit, so many to a radian."""
    common: dict[str, Any] = {'b0': scale, 'command_min': -1e4, 'command_max': 1e4}
    if 'tracking_acceleration' in values:
        values = values | {'tracking_acceleration': scale * values['tracking_acceleration']}
    return Controller(
        ControllerSettings(measurement_period=period, **common | values), checked=True
    )


def turning(controller: Controller, period: float, scale: float) -> Iterator[float]:
    """Follow 20 pi sin(t / 2) with an inexact model; sensor and reference wrap at ``period``."""
    chain = Chain(controller.design.order)
    for k, v in enumerate(noise(3, 1300, 1e-3)):
        t = k * H
        if 620 <= k < 640:  # a gap at five turns per second
            u = controller.tick(elapsed=H, reference=[target(t, period, scale)])
        else:
            dt = 21 * H if k == 640 else H
            y = wrapped(scale * (chain.y + v), period)
            u = controller.tick(y, dt, elapsed=H, reference=[target(t, period, scale)])
        yield u
        chain.advance(1.2 * u + 3.0 * sin(t), H)


def target(t: float, period: float, scale: float) -> float:
    return wrapped(scale * 20.0 * pi * sin(0.5 * t), period)


@pytest.mark.parametrize('scale', (1.0, 180.0 / pi), ids=('rad', 'deg'))
@pytest.mark.parametrize('way', WAYS)
def test_many_turns_of_a_wrapped_sensor_are_those_of_one_that_counts(
    way: str, scale: float
) -> None:
    """The same commands, also over a gap of 0.2 s in rotation."""
    counting = list(turning(controller_of(0.0, scale, **WAYS[way]), 0.0, scale))
    commands = list(turning(controller_of(TURN * scale, scale, **WAYS[way]), TURN * scale, scale))
    worst = max(abs(u - v) for u, v in zip(commands, counting))
    assert worst < 1e-9 and max(map(abs, counting)) > 10.0, worst


@pytest.mark.parametrize('way', WAYS)
def test_endless_rotation_keeps_its_precision(way: str) -> None:
    """Five ticks a turn: from some turn on, all turns are the same, against a constant load."""
    controller = controller_of(360.0, 180.0 / pi, **WAYS[way])
    chain, commands = Chain(controller.design.order), []
    for k in range(5 * 500):
        r = [wrapped(72.0 * k, 360.0), 7200.0]
        commands.append(controller.tick(chain.x[0], H, reference=r))
        chain.advance(180.0 / pi * (commands[-1] + 3.0), H)
        chain.x[0] = wrapped(chain.x[0], 360.0)
        assert all(abs(level[0]) < 720.0 for level in controller.state.levels)
    assert commands[-300:] == pytest.approx([commands[2000]] * 300, abs=1e-9)
    assert controller.mode == Mode.OK and abs(controller.state.angle[2] - 500.0) < 8.0


@pytest.mark.parametrize('turns', (1e6, -3e9))
def test_the_count_of_turns_is_in_no_command(turns: float) -> None:
    few, many = controller_of(), controller_of()
    for k, v in enumerate(noise(1, 300)):
        if k == 20:
            many.state.angle[2] += turns
        y, r = wrapped(0.7 * k + 0.1 * v, TURN), wrapped(0.7 * k, TURN)
        assert few.tick(y, H, reference=[r]) == many.tick(y, H, reference=[r])
    assert many.tracking - few.tracking == pytest.approx(TURN * turns)
    assert few.mode == many.mode == Mode.OK


@pytest.mark.parametrize('way', WAYS)
def test_what_does_not_turn_far_has_the_bits_of_no_angle(way: str) -> None:
    angle, line = controller_of(100.0, **WAYS[way]), controller_of(0.0, **WAYS[way])
    chain = Chain(angle.design.order)
    for k, v in enumerate(noise(2, 300, 0.01)):
        sample = (chain.y + v, H) if k % 7 else (NAN, 0.0)
        r = [sin(0.02 * k)]
        u = angle.tick(*sample, elapsed=H, reference=r)
        assert bits([u]) == bits([line.tick(*sample, elapsed=H, reference=r)])
        chain.advance(u, H)


@pytest.mark.parametrize('way', WAYS)
@pytest.mark.parametrize('off', (1e-6, -1e-6))
def test_a_jump_by_half_a_turn_does_not_chatter(way: str, off: float) -> None:
    """With noise on measurement and reference, and a plant that can hardly move at first."""
    controller = controller_of(**WAYS[way], command_rate_limit=100.0)
    chain, sides = Chain(controller.design.order), []
    for k, v in enumerate(noise(5, 1000, 1e-3)):
        r = 0.3 if k < 100 else wrapped(0.3 + pi + off + 1e-3 * sin(1e3 * k), TURN)
        u = controller.tick(wrapped(chain.y + v, TURN), H, reference=[r])
        chain.advance(u, H)
        if k >= 100:
            error = controller.reference[0] + TURN * controller.state.angle[2] - chain.y
            sides.append(error > 0.0 if abs(error) > 0.5 else None)
    sides = [side for side in sides if side is not None]
    assert len(sides) > 5 and len(set(sides)) == 1
    assert abs(short(chain.y - r, TURN)) < 0.05 and abs(chain.y - 0.3) < pi + 1.0


def test_a_jump_takes_the_short_way() -> None:
    """From 170 to -170 degrees: over 180, and back."""
    controller, chain = controller_of(360.0, command_max=400.0, command_min=-400.0), Chain(2)
    chain.x[0] = 170.0
    highest = lowest = 170.0
    for k in range(1000):
        r = -170.0 if k < 500 else 170.0
        u = controller.tick(wrapped(chain.y, 360.0), H, reference=[r])
        chain.advance(u, H)
        highest, lowest = max(highest, chain.y), min(lowest, chain.y)
        if k == 499:
            assert chain.y == pytest.approx(190.0, abs=0.1)
    assert chain.y == pytest.approx(170.0, abs=0.1)
    assert 165.0 < lowest < highest < 195.0


def test_a_trajectory_keeps_its_turns_however_far_the_plant_lags() -> None:
    """Three turns in half a second are asked of a plant that can do a third of a turn in it."""
    controller, chain = controller_of(command_max=10.0, command_min=-10.0), Chain(2)
    for k in range(1500):
        r = wrapped(3.0 * TURN * min(1.0, k / 50), TURN)
        u = controller.tick(wrapped(chain.y, TURN), H, reference=[r])
        chain.advance(u, H)
    assert chain.y == pytest.approx(3.0 * TURN, abs=1e-3)
    assert controller.tracking == pytest.approx(3.0 * TURN) != controller.reference[0]


@pytest.mark.parametrize('way', WAYS)
def test_p11_after_a_turn_by_hand_enabling_goes_the_short_way(way: str) -> None:
    controller, chain = controller_of(**WAYS[way]), Chain(1)
    chain = Chain(controller.design.order)
    for _ in range(300):
        chain.advance(controller.tick(wrapped(chain.y, TURN), H, reference=[1.0]), H)
    controller.enabled = False
    start = chain.y
    for k in range(400):  # by three turns and a third
        chain.x = [start + min(1.0, k / 300) * 10 / 3 * TURN, *[0.0] * (len(chain.x) - 1)]
        u = controller.tick(wrapped(chain.y, TURN), H, reference=[1.0])
    assert controller.mode == Mode.SAFE
    controller.enabled = True
    by_hand = chain.y
    for k in range(600):
        before, u = u, controller.tick(wrapped(chain.y, TURN), H, reference=[1.0])
        assert k or u == pytest.approx(before, abs=1e-9)
        chain.advance(u, H)
        assert abs(chain.y - by_hand) < 0.5 * TURN
    assert short(chain.y - 1.0, TURN) == pytest.approx(0.0, abs=0.01)


def test_the_first_reference_is_sought_from_where_the_plant_is() -> None:
    """Held at two turns and 350 degrees, an equivalent of -10: to 10 it is 20 degrees."""
    controller, chain = controller_of(360.0), Chain(2)
    chain.x[0] = 1070.0
    for k in range(500):
        u = controller.tick(chain.y, H, reference=None if k < 100 else [10.0])
        chain.advance(u, H)
        if k < 100:
            assert chain.y == pytest.approx(1070.0, abs=1e-6)
    assert chain.y == pytest.approx(1090.0, abs=0.1)


def test_a_sensor_may_wrap_while_it_proves_itself() -> None:
    """The step over the wrap is not odd, and no rotation."""
    controller = Controller(ControllerSettings(measurement_period=360.0, good_samples=4))
    for y in (179.8, 179.9, -180.0, -179.9):
        assert controller.mode == Mode.SAFE
        controller.tick(y, H)
    assert controller.mode == Mode.OK and controller.policy.spread == pytest.approx(0.1)
    assert abs(controller.command) < 20.0


@pytest.mark.parametrize('way', WAYS)
def test_after_a_long_gap_the_short_way_is_taken(way: str) -> None:
    """Nobody knows how far it turned: without a bump the observers restart near the reference."""
    controller = controller_of(**WAYS[way], measurement_timeout=0.0, max_dt=0.1)
    for k in range(50):
        u = controller.tick(wrapped(0.01 * k, TURN), H, reference=[0.01 * k])
    assert controller.tick(2.9, 5.0, reference=[0.5]) == pytest.approx(u, abs=1e-9)
    assert controller.status == Status.RESTARTED
    controller.tick(-2.9, 5.0, reference=[0.5])
    assert controller.status == Status.RESTARTED
    assert controller.output_estimate - controller.tracking == pytest.approx(TURN - 3.4, abs=0.2)


def test_a_plant_that_lags_at_its_limit_is_no_stall_turn_after_turn() -> None:
    """It does two turns per second of the six that are asked for."""
    controller = controller_of(
        command_max=2 * TURN, command_min=-2 * TURN, stall_time=0.5, plant_order=1
    )
    chain = Chain(1)
    for k in range(600):
        r = wrapped(min(0.06 * k, 12.0) * TURN, TURN)
        chain.advance(controller.tick(wrapped(chain.y, TURN), H, reference=[r]), H)
        assert not controller.stalled
    assert chain.y > 11.0 * TURN


def test_turns_count_from_where_the_sensor_was_when_the_law_took_over() -> None:
    controller = Controller(ControllerSettings(measurement_period=360.0))
    for _ in range(5):
        controller.tick(1000.0, H)
    assert controller.mode == Mode.OK
    assert controller.output_estimate == controller.tracking == pytest.approx(1000.0)
    assert abs(controller.reference[0]) <= 360.0


def test_a_stuck_motor_is_a_stall_though_its_reference_turns() -> None:
    controller = controller_of(command_max=5.0, command_min=-5.0, stall_time=0.5)
    for k in range(300):
        controller.tick(0.1, H, reference=[wrapped(0.05 * k, TURN)])
    assert controller.stalled


def test_at_rest_an_angle_stays_at_rest_where_a_turn_is_taken_off() -> None:
    controller, chain = controller_of(error_deadband=0.2), Chain(2)
    r = chain.x[0] = TURN - 0.01
    for k in range(600):
        if k > 400:  # slowly over the turn
            chain.x = [r + 1e-3 * min(k - 400, 100), 0.0]
        u = controller.tick(chain.y if k == 0 else wrapped(chain.y, TURN), H, reference=[r])
        chain.advance(u, H)
        assert k < 400 or controller.state.resting[0] == 1.0
    assert controller.state.angle[2] == 1.0


def test_p01_a_bad_sample_takes_no_turns_off() -> None:
    controller = controller_of(1.0)
    for _ in range(5):
        controller.tick(0.1, H, reference=[0.1])
    controller.state.levels[0][0] = 1.2  # as where a change lets another level feed the law
    controller.tick(NAN, H)
    assert controller.state.levels[0][0] == 1.2
    controller.tick(0.2, H)
    assert controller.state.levels[0][0] == pytest.approx(0.2, abs=0.02)


def test_p13_a_limited_joint_is_refused() -> None:
    with pytest.raises(SettingError, match='end stops') as refused:
        ControllerSettings(measurement_min=-3.0, measurement_max=3.0, measurement_period=TURN)
    assert refused.value.name == 'measurement_period'
    ControllerSettings(measurement_min=-180.0, measurement_max=180.0, measurement_period=360.0)
    ControllerSettings(measurement_min=0.0, measurement_max=255.0, measurement_period=256.0)


SCENARIO = """
plant: {name: chain, order: 2, initial_state: [900.0, 0.0]}
reference: {signal: cosine, amplitude: 900.0, frequency: 1.0}
disturbance: {signal: decaying_cosine, amplitude: 100.0}
limits: {command_min: -5000, command_max: 5000}
noise: {variance: 1e-2}
sensor: {wrap_min: -180, wrap_max: 180}
faults: {measurement: [{kind: silent, start: 1.5, duration: 0.2}]}
rate: 100
duration: 3
controllers:
  angle: {measurement_period: 360}
  error_based: {measurement_period: 360, error_based: true}
  line: {}
"""


def test_a_simulated_sensor_wraps_also_compiled() -> None:
    """Only the controller that knows of it follows, and the error is the short one."""
    scenario = loads(SCENARIO)
    for name, settings in scenario.controllers.items():
        plain, fast = (
            simulate(scenario.experiment, settings, compiled=compiled)
            for compiled in (False, True)
        )
        for column in ('command', 'tracking', 'output_estimate', 'measurement'):
            one, other = getattr(plain, column), getattr(fast, column)
            assert np.array_equal(one, other, equal_nan=True), column
        assert plain.metrics == fast.metrics
        measured = plain.measurement[np.isfinite(plain.measurement)]
        assert -180.0 <= min(measured) < -170.0 and 170.0 < max(measured) < 180.0
        follows = abs(short(plain.output[-1] - plain.reference[-1], 360.0)) < 20.0
        assert follows == (name != 'line')
        if follows:
            assert min(plain.output) < -800.0 and plain.metrics.max_error <= 180.0
            turned = round((plain.output[0] - plain.output_estimate[0]) / 360.0)
            away = plain.output_estimate + 360.0 * turned - plain.output
            assert max(abs(away)) < 190.0 and abs(away[-1]) < 1.0  # in the gap it is the last one


def test_what_a_sensor_shows_is_an_equivalent_in_its_range() -> None:
    assert [shown(v, 0.0, 360.0) for v in (0.0, 360.0, -1e-20, -1.0, 725.0)] == [0, 0, 0, 359, 5]
    assert [shown(v, -pi, pi) for v in (inf, -3.0, 1e30)] == [inf, -3.0, 1e30]
    assert shown(-pi, -pi, pi) == -pi and shown(pi, -pi, pi) == -pi and shown(7.0, 0.0, 0.0) == 7.0
    assert loads(dump(loads(SCENARIO))) == loads(SCENARIO)
    with pytest.raises(SettingError, match='wrap_max'):
        loads(SCENARIO.replace('wrap_max: 180', 'wrap_max: -181'))


@pytest.mark.parametrize('left_out', ('wrap_min', 'wrap_max'))
def test_a_range_with_one_end_is_refused_by_the_other(left_out: str) -> None:
    other = {'wrap_min': 'wrap_max: 180', 'wrap_max': 'wrap_min: -180'}[left_out]
    with pytest.raises(SettingError, match=f'{other[:8]}.*with {left_out} beside it'):
        loads(SCENARIO.replace('wrap_min: -180, wrap_max: 180', other))
    whole = SCENARIO.replace('wrap_min: -180, wrap_max: 180', 'wrap_min: 0, wrap_max: 360')
    assert loads(dump(loads(whole))) == loads(whole)


def test_a_period_that_is_not_the_range_of_the_sensor_is_refused() -> None:
    """Its figures would be of an error folded to 2 pi, as 6.28 of 360 degrees."""
    with pytest.raises(
        SettingError, match=r'controllers\.angle\.measurement_period = 6\.28'
    ) as no:
        loads(
            SCENARIO.replace(
                'angle: {measurement_period: 360}', f'angle: {{measurement_period: {2 * pi}}}'
            )
        )
    assert '360, what the sensor wraps by (wrap_max - wrap_min)' in str(no.value)
    radians = SCENARIO.replace(
        'wrap_min: -180, wrap_max: 180', 'wrap_min: -3.14159265, wrap_max: 3.14159265'
    )
    assert loads(radians.replace('measurement_period: 360', 'measurement_period: 6.28318531'))
    assert loads(SCENARIO.replace('sensor: {wrap_min: -180, wrap_max: 180}', ''))


@at_least(200)
@given(st.floats(), st.one_of(st.just(0.0), st.floats(1e-15, 1e15)))
def test_the_short_way_is_at_most_half_a_period(difference: float, period: float) -> None:
    left, taken = short(difference, period), whole(difference, period)
    if period == 0.0 or not abs(difference) < 1e9 * period:
        assert taken == 0.0 or abs(left) <= abs(difference)
        return
    assert abs(left) <= 0.5 * period + 1e-15 * abs(difference)
    assert taken == period * round(taken / period)


@at_least(15)
@given(
    st.sampled_from(list(WAYS)),
    st.lists(
        st.tuples(
            st.floats(allow_nan=True, allow_infinity=True),
            st.sampled_from((H, 0.0, 0.2, 3.0, inf)),
            st.one_of(st.none(), st.floats(allow_nan=True)),
            st.booleans(),
        ),
        min_size=20,
        max_size=30,
    ),
)
def test_p01_p02_p03_nothing_makes_the_command_of_an_angle_bad(
    way: str, samples: list[tuple[float, float, float | None, bool]]
) -> None:
    controller = controller_of(1.0, **WAYS[way])
    for y, dt, r, enabled in samples:
        controller.enabled = enabled
        reference = None if r is None else [r]
        assert abs(controller.tick(y, dt, elapsed=H, reference=reference)) <= 1e4
    controller.enabled = True
    for _ in range(40):
        u = controller.tick(0.1, H, reference=[0.2])
    assert controller.mode == Mode.OK and isfinite(u)
    assert isfinite(controller.output_estimate) and isfinite(controller.tracking)
