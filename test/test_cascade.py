"""Loops in a cascade: what the inner one cannot do the outer one knows, and it waits for it."""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least, Chain, copy_of, noise, varied_settings
from nadrc_ros.adrc.cascade import Cascade, CascadeSettings, loops_of
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.feedback import fal
from nadrc_ros.adrc.realised import fal_inverse
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import raw_command
from nadrc_ros.adrc.status import Cause, Mode, Status
import pytest

H = 0.005
# The controller bandwidth of the position; the velocity's is four times that.
WC = 2.0
CASES = varied_settings()


def position(**values: Any) -> CascadeSettings:
    """Return a cascade of position over velocity; ``inner_b0`` is of the velocity."""
    inner = {k.removeprefix('inner_'): v for k, v in values.items() if k.startswith('inner_')}
    outer = {k: v for k, v in values.items() if not k.startswith('inner_')}
    return CascadeSettings(
        **{**loop(WC), 'command_min': -1e6, 'command_max': 1e6, **outer},
        inner=ControllerSettings(**{**loop(4.0 * WC), **inner}),
    )


def loop(wc: float) -> dict[str, Any]:
    return {
        'plant_order': 1,
        'controller_bandwidth': wc,
        'inner_bandwidth': 4.0 * wc,
        'outer_bandwidth': 3.0 * wc,
        'command_min': -8.0,
        'command_max': 8.0,
    }


def run(
    cascade: Cascade,
    seconds: float,
    blocked: Callable[[float], bool] = lambda t: False,
    r: float = 1.0,
    chain: Chain | None = None,
) -> list[float]:
    """Return the output of a double integrator, which may be held fast for a time."""
    plant = chain or Chain(2)
    outputs = []
    for k in range(round(seconds / H)):
        u = cascade.tick(plant.x, H, reference=[r])
        outputs.append(plant.y)
        if blocked(k * H):
            plant.x[1] = 0.0
        else:
            plant.advance(u, H)
    return outputs


def test_a_cascade_of_one_is_the_controller() -> None:
    settings = ControllerSettings(plant_order=1, b0=2.0)
    cascade, controller = Cascade(settings), Controller(settings)
    for y in noise(1, 100):
        assert cascade.tick([y], 0.01, reference=[1.0]) == controller.tick(
            y, 0.01, reference=[1.0]
        )
    assert cascade.tick() == controller.tick()


def test_the_inner_loop_takes_the_command_of_the_outer_one_in_the_same_tick() -> None:
    cascade = Cascade(position(), checked=True)
    outer, inner = cascade.loops
    for y, v in zip(noise(2, 50), noise(3, 50)):
        u = cascade.tick([y, v], H, reference=[1.0])
        assert inner.reference == [outer.command, 0.0]
        assert u == inner.command
        if inner.status < Status.RATE_LIMITED:
            assert inner.realised(nan) == (outer.command, True)


def test_three_loops_have_three_measurements_and_a_time_step_for_each() -> None:
    innermost = ControllerSettings(**loop(8.0))
    settings = CascadeSettings(**loop(2.0), inner=CascadeSettings(**loop(4.0), inner=innermost))
    cascade = Cascade(settings, checked=True)
    assert [type(each) for each in loops_of(settings)][:2] == [CascadeSettings] * 2
    for _ in range(4):  # each takes over a tick after the one inside it
        cascade.tick([1.0, 2.0, 3.0], [H, 0.0, H], elapsed=H, reference=[0.0])
    assert [each.policy.last for each in cascade.loops] == pytest.approx(
        [1.0, nan, 3.0], nan_ok=True
    )
    for _ in range(4):
        cascade.tick([1.0, 2.0, 3.0], H, reference=[0.0])
    assert {each.mode for each in cascade.loops} == {Mode.OK}


@at_least(200)
@given(
    st.sampled_from(sorted(CASES)),
    st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=8),
    st.floats(-50.0, 50.0),
)
def test_asked_for_the_realised_reference_the_law_gives_the_command_that_the_limits_left(
    name: str, measurements: list[float], r: float
) -> None:
    inner = Controller(ControllerSettings(**CASES[name]), checked=True)
    for y in measurements:
        inner.tick(y, 0.01, reference=[r])
    realised, in_control = inner.realised(nan)
    assert in_control
    state, design = copy_of(inner.state), inner.design
    before = state.profile[0]
    state.profile[0] = realised
    if design.error_based:
        state.levels[design.feedback_level][0] += before - realised
        if design.known:  # a_0 r is a part of what disturbs y - r
            state.levels[0][design.order] += design.damping[0] * (before - realised)
    raw = raw_command(inner.design, inner.state)
    assert raw_command(design, state) == pytest.approx(
        inner.command, rel=1e-9, abs=1e-9 * max(1.0, abs(raw))
    )
    if raw == inner.command:
        assert realised == before


@given(st.floats(-1e6, 1e6), st.floats(0.01, 1.0), st.floats(1e-6, 1e3))
def test_the_inverse_of_fal(e: float, alpha: float, delta: float) -> None:
    value = fal(e, alpha, delta)
    # To the power of 1 / alpha an error of 1e-16 is one of 1e-16 / alpha.
    assert fal_inverse(value, alpha, delta) == pytest.approx(e, rel=1e-13 / alpha, abs=1e-300)
    assert abs(fal_inverse(1e300, alpha, delta)) < float('inf')


@pytest.mark.parametrize(
    'inner', [{}, {'inner_command_rate_limit': 200.0}, {'inner_feedback': 'fal'}]
)
def test_p06_ten_seconds_of_inner_saturation_leave_the_outer_loop_as_it_was(
    inner: dict[str, Any],
) -> None:
    """The plant is held fast, as by a brake that somebody forgot."""
    settings = position(**inner)
    free = max(run(Cascade(settings, checked=True), 8.0))
    cascade = Cascade(settings, checked=True)
    held = run(cascade, 18.0, lambda t: t < 10.0)
    assert held[1999] == 0.0
    assert max(held) == pytest.approx(free, abs=0.05)
    assert held[-1] == pytest.approx(1.0, abs=0.01)
    unaware = Cascade(settings, checked=True)
    unaware.loops[0].inner = None
    assert max(run(unaware, 18.0, lambda t: t < 10.0)) > 5.0  # it went on counting


@at_least(150)
@given(
    st.sampled_from(sorted(CASES)),
    st.sampled_from([name for name in sorted(CASES) if 'measurement_period' not in CASES[name]]),
    st.lists(
        st.tuples(
            st.one_of(st.floats(-30.0, 30.0), st.floats(allow_nan=True, allow_infinity=True)),
            st.one_of(st.floats(-30.0, 30.0), st.just(nan)),
            st.sampled_from([0.0, 0.004, 0.01, 0.01, 0.7]),
            st.one_of(st.none(), st.floats(-50.0, 50.0), st.just(nan)),
            st.sampled_from(['', '', '', 'inner off', 'inner on', 'outer off', 'outer on']),
        ),
        min_size=5,
        max_size=40,
    ),
)
def test_p02_whatever_comes_both_loops_stay_inside_their_limits_and_the_inner_has_a_reference(
    around: str, inside: str, stream: list[tuple[float, float, float, float | None, str]]
) -> None:
    settings = {'command_min': -20.0, 'command_max': 30.0} | CASES[around]
    inner = ControllerSettings(**CASES[inside])
    cascade = Cascade(CascadeSettings(**settings | {'applied_timeout': 0.0}, inner=inner))
    for y, v, dt, r, switch in stream:
        loop, _, on = switch.partition(' ')
        if loop:
            cascade.loops[loop == 'inner'].enabled = on == 'on'
        waiting = cascade.loops[1].mode != Mode.OK
        cascade.tick([y, v], dt, elapsed=0.01, reference=None if r is None else [r])
        for each in cascade.loops:
            assert each.settings.command_min <= each.command <= each.settings.command_max
        outer, inner_loop = cascade.loops
        assert inner_loop.reference[0] == outer.command
        assert outer.sample.followed is not waiting
        assert not (waiting and outer.mode == Mode.OK)
        if outer.cause == Cause.NOT_FOLLOWED and outer.mode == Mode.HOLDING and waiting:
            low, high = outer.settings.command_min, outer.settings.command_max
            assert outer.command == min(max(outer.sample.applied, low), high)


def moving() -> tuple[Cascade, Chain]:
    """Return a cascade in the middle of a long way, at a speed."""
    cascade, plant = Cascade(position(command_min=-3.0, command_max=3.0), checked=True), Chain(2)
    run(cascade, 3.0, r=100.0, chain=plant)
    assert plant.x[1] == pytest.approx(3.0, abs=0.01)
    return cascade, plant


def test_p11_while_the_inner_loop_is_disabled_the_outer_one_waits_where_the_plant_is() -> None:
    cascade, plant = moving()
    outer, inner = cascade.loops
    inner.enabled = False
    for k in range(400):
        u = cascade.tick(plant.x, H, reference=[100.0])
        plant.advance(u - plant.x[1], H)  # it coasts, and stops
        if k > 1:
            assert (outer.mode, outer.cause) == (Mode.HOLDING, Cause.NOT_FOLLOWED)
            assert outer.command == outer.sample.applied == pytest.approx(plant.x[1], abs=0.2)
    plant.x[1] = 1.0  # somebody turns it
    for _ in range(100):
        plant.advance(cascade.tick(plant.x, H, reference=[100.0]), H)
    inner.enabled = True
    before = inner.command, inner.output_estimate
    assert cascade.tick(plant.x, H, reference=[100.0]) == before[0]
    assert inner.reference[0] == before[1] == pytest.approx(1.0, abs=1e-3)
    assert (inner.mode, outer.mode) == (Mode.OK, Mode.HOLDING)
    asked = outer.command
    cascade.tick(plant.x, H, reference=[100.0])
    assert outer.mode == Mode.OK
    assert outer.command == pytest.approx(asked, abs=1e-9)
    run(cascade, 2.0, r=100.0, chain=plant)
    assert plant.x[1] == pytest.approx(3.0, abs=0.02)


def test_p07_where_the_outer_loop_is_blind_the_inner_one_follows_its_fault_policy() -> None:
    cascade, plant = moving()
    outer, inner = cascade.loops
    modes = []
    for _ in range(300):
        plant.advance(cascade.tick([nan, plant.x[1]], [0.0, H], elapsed=H), H)
        modes.append(outer.mode)
    assert list(dict.fromkeys(modes)) == [Mode.OK, Mode.HOLDING, Mode.RAMPING, Mode.SAFE]
    assert (outer.command, inner.mode) == (0.0, Mode.OK)
    assert plant.x[1] == pytest.approx(0.0, abs=0.01)


def test_p14_both_disabled_both_are_at_their_safe_commands_at_once() -> None:
    cascade, plant = moving()
    for each in cascade.loops:
        each.enabled = False
    for _ in range(4):
        cascade.tick(plant.x, H)
    assert all(each.quiet and each.command == 0.0 for each in cascade.loops)


def test_p11_a_cascade_that_starts_in_motion_takes_over_from_there() -> None:
    cascade = Cascade(position(), checked=False)
    outer, inner = cascade.loops
    for _ in range(3):
        cascade.tick([5.0, 2.0], H)
        assert inner.command == 0.0
    assert (inner.mode, outer.cause) == (Mode.OK, Cause.NOT_FOLLOWED)
    assert inner.reference[0] == outer.command == 2.0
    cascade.tick([5.0, 2.0], H)
    assert outer.mode == Mode.OK and outer.command == 2.0


@pytest.mark.parametrize(
    ('values', 'name'),
    [
        ({'command_max': 3.0, 'inner_reference_max': 2.0}, 'command_max.*reference_max = 2.0'),
        ({'command_min': -3.0, 'inner_reference_min': -2.0}, 'command_min.*reference_min = -2.0'),
        ({'inner_measurement_period': 6.28}, 'measurement_period = 6.28: must be 0 of the inner'),
        ({'applied_timeout': 1.0}, 'applied_timeout = 1.0: must be 0'),
    ],
)
def test_commands_that_the_inner_loop_would_not_take_are_refused(
    values: dict[str, Any], name: str
) -> None:
    with pytest.raises(SettingError, match=name):
        position(**values)


def test_a_time_that_is_too_short_is_named_with_its_loop() -> None:
    with pytest.raises(SettingError, match=r'^inner\.measurement_timeout'):
        position(inner_measurement_timeout=0.01).check_rate(100.0)
    assert make_design(position()) == make_design(
        ControllerSettings(**loop(WC) | {'command_min': -1e6, 'command_max': 1e6})
    )
