"""One step of the law: limits, refusals, restarts; and every structure closes every loop."""

from __future__ import annotations

from math import exp, isfinite
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from law_helpers import (
    at_least,
    bits,
    Chain,
    copy_of,
    design_of,
    INF,
    init,
    Law,
    NAMES,
    NAN,
    noise,
    ORDERS,
    state_bits,
    varied_settings,
)
from nadrc_ros.adrc.law import step
from nadrc_ros.adrc.limiter import clamp, limit
from nadrc_ros.adrc.state import blank_state, match_command, raw_command, start
from nadrc_ros.adrc.status import Status
import pytest

H = 0.01
CASES = varied_settings()
BAD = (NAN, INF, -INF, 1e308, -1e308, 1e100)
FEEDBACKS = ('linear', 'fal')
LEVELS = ('inner', 'outer')


@pytest.mark.parametrize('level', LEVELS)
@pytest.mark.parametrize('feedback', FEEDBACKS)
@pytest.mark.parametrize('structure', NAMES)
@pytest.mark.parametrize('n', ORDERS)
def test_every_loop_settles_under_a_constant_disturbance(
    n: int, structure: str, feedback: str, level: str
) -> None:
    values = {'plant_order': n, 'structure': structure, 'feedback': feedback, 'b0': -2.0}
    slow = {'inner_bandwidth': 40.0, 'outer_bandwidth': 40.0, 'controller_bandwidth': 2.0}
    wide = {'command_min': -1e4, 'command_max': 1e4, 'fal_exponents': (0.9,), 'fal_delta': 0.1}
    law, chain = Law(design_of(feedback_level=level, **values, **slow, **wide)), Chain(n)
    for _ in range(2000):
        chain.advance(-2.0 * law.step([1.0], chain.y, H) + 3.0, H)
    assert chain.y == pytest.approx(1.0, abs=1e-3)
    assert law.u == pytest.approx(1.5, abs=1e-2)


def test_one_nested_level_is_the_conventional_lawto_the_bit() -> None:
    values = {'command_min': -20.0, 'command_max': 20.0, 'command_rate_limit': 300.0}
    nested = Law(design_of(structure='nested', levels=1, **values))
    conventional = Law(design_of(structure='conventional', **values))
    for y, r in zip(noise(1, 3000, 0.1), noise(2, 3000)):
        assert nested.step([r], y, H) == conventional.step([r], y, H)
        assert nested.status == conventional.status


@pytest.mark.parametrize('case', CASES)
@pytest.mark.parametrize('bad', BAD)
def test_p01_a_bad_sample_leaves_the_state_to_the_bit(case: str, bad: float) -> None:
    law = Law(design_of(**CASES[case]))
    for y in noise(1, 30, 0.1):
        law.step([0.5, 0.1], y, H)
    before = state_bits(law.state)
    u = law.u
    assert law.step([0.5, 0.1], bad, H) == u
    assert law.status == Status.NO_MEASUREMENT and state_bits(law.state) == before
    assert law.step([bad, 0.1], 0.1, H) == u
    assert law.status == Status.BAD_REFERENCE and state_bits(law.state) == before
    for dt in (NAN, 0.0, -1.0, -INF, 1e-12):
        assert law.step([0.5, 0.1], 0.1, dt) == u
        assert law.status == Status.BAD_TIME_STEP and state_bits(law.state) == before


@pytest.mark.parametrize('case', CASES)
@pytest.mark.parametrize('bad', (NAN, INF, -INF))
@pytest.mark.parametrize('dt', (H, 3.0))
def test_p01_nor_does_a_bad_derivative_of_the_reference_enter(
    case: str, bad: float, dt: float
) -> None:
    """The differentiator makes its own: there the derivatives given are not used at all."""
    law = Law(design_of(**CASES[case]))
    for y in noise(1, 30, 0.1):
        law.step([0.5, 0.1], y, H)
    before = state_bits(law.state)
    u = law.step([0.5, *[bad] * law.design.order], 0.1, dt)
    if law.design.tracking_acceleration == 0.0:
        assert law.status == Status.BAD_REFERENCE and state_bits(law.state) == before
    assert isfinite(u) and isfinite(law.step([0.5], 0.1, H))
    assert law.status < Status.NO_MEASUREMENT
    assert all(isfinite(float.fromhex(x)) for row in state_bits(law.state) for x in row)


@pytest.mark.parametrize('value', (NAN, INF, -INF))
def test_p03_the_clamp_does_not_turn_nan_into_full_actuator(value: float) -> None:
    design = design_of(command_min=-5.0, command_max=7.0, safe_command=1.5)
    assert clamp(design, value) == 1.5
    law = Law(design)
    law.u = value
    assert -5.0 <= law.step([0.0], 0.0, H) <= 7.0
    law.u = value
    assert law.step([0.0], NAN, H) == 1.5


@pytest.mark.parametrize('value', (NAN, INF, -INF))
def test_p03_a_law_that_is_no_number_is_not_full_actuator(value: float) -> None:
    law = Law(design_of(command_min=-5.0, command_max=7.0), 0.1)
    u = law.step([0.1, 0.2], 0.1, H)
    assert 0.0 < u < 7.0
    assert law.step([0.1, value], 0.1, H) == u
    assert 0.0 < law.step([0.1, 0.2], 0.1, H) < 7.0


ANY = st.one_of(st.floats(), st.sampled_from((*BAD, 0.0, 5e-324, -5e-324, 9.9e99, -9.9e99)))
TIMES = st.one_of(st.floats(1e-9, 1.0), st.just(H), ANY)
NOT_FINITE = st.sampled_from((NAN, INF, -INF))


@at_least(500)
@given(
    st.sampled_from(sorted(CASES)),
    st.lists(st.tuples(ANY, ANY, TIMES), max_size=5),
    st.sampled_from(('reference', 'measurement', 'both')),
    st.tuples(NOT_FINITE, NOT_FINITE, ANY, ANY, TIMES),
)
def test_p01_nothing_but_numbers_enters_whatever_was_before(
    case: str,
    before: list[tuple[float, float, float]],
    bad: str,
    values: tuple[float, float, float, float, float],
) -> None:
    law = Law(design_of(**CASES[case], max_dt=3600.0))
    for r, y, dt in before:
        law.step([r], y, dt)
    bad_r, bad_y, r, y, dt = values
    state = state_bits(law.state)
    law.step([r if bad == 'measurement' else bad_r], y if bad == 'reference' else bad_y, dt)
    assert law.status >= Status.NO_MEASUREMENT
    assert state_bits(law.state) == state


@at_least(2000)
@given(
    st.sampled_from(sorted(CASES)),
    st.lists(st.tuples(ANY, ANY, ANY, ANY, TIMES), min_size=1, max_size=12),
)
def test_p02_p03_no_input_makes_a_command_bad(
    case: str, inputs: list[tuple[float, float, float, float, float]]
) -> None:
    law = Law(design_of(**CASES[case], max_dt=3600.0))
    for r, rate, y, applied, dt in inputs:
        law.u = applied
        u = law.step([r, rate], y, dt)
        assert law.design.command_min <= u <= law.design.command_max
    # And no input is remembered for ever.
    for _ in range(3):
        law.step([0.1], 0.1, H)
        assert law.status < Status.NO_MEASUREMENT
        assert all(isfinite(float.fromhex(x)) for row in state_bits(law.state) for x in row)


def test_p04_estimates_that_overflow_restart() -> None:
    """Wildly uneven dt is outside what the gains are stable for; it must not last."""
    law = Law(design_of(plant_order=5, inner_bandwidth=1e4, max_dt=3600.0))
    seen = set()
    for k in range(400):
        law.step([0.0], (-1.0) ** k, 1e-6 if k % 2 else 3000.0)
        seen.add(law.status)
    assert Status.RESTARTED in seen
    assert not seen & {Status.BAD_REFERENCE, Status.NO_MEASUREMENT}


@pytest.mark.parametrize('structure', NAMES)
@pytest.mark.parametrize('n', (1, 2, 4))
def test_at_rest_the_command_that_keeps_it_goes_on(n: int, structure: str) -> None:
    """d_1 = -b0 u is what keeps y where it is."""
    design = design_of(plant_order=n, structure=structure, b0=2.0)
    law, chain = Law(design, 5.0, 3.0), Chain(n)
    chain.x[0] = 5.0
    for _ in range(200):
        u = law.step([5.0], chain.y, H)
        assert u == pytest.approx(3.0, abs=1e-9)
        chain.advance(2.0 * u - 6.0, H)


def test_p02_p05_rate_first_then_magnitude() -> None:
    design = design_of(command_min=-1.0, command_max=2.0, command_rate_limit=10.0)
    assert limit(design, 5.0, 1.0, 0.01) == (1.1, Status.RATE_LIMITED)
    assert limit(design, -5.0, 1.0, 0.01) == (0.9, Status.RATE_LIMITED)
    assert limit(design, 5.0, 1.95, 0.01) == (2.0, Status.SATURATED)
    assert limit(design, 1.05, 1.0, 0.01) == (1.05, Status.OK)
    assert limit(design_of(command_max=2.0), 5.0, 0.0, 0.01) == (2.0, Status.SATURATED)
    # What acted was outside: the range ranks above the rate.
    assert limit(design, 0.0, 5.0, 0.01) == (2.0, Status.SATURATED)
    assert limit(design, 0.0, -5.0, 0.01) == (-1.0, Status.SATURATED)


@pytest.mark.parametrize('case', CASES)
def test_p05_no_step_exceeds_the_rate_limit(case: str) -> None:
    law = Law(design_of(**CASES[case] | {'command_rate_limit': 25.0}), 0.3, 1.0)
    for y, r, h in zip(noise(1, 500), noise(2, 500), noise(3, 500)):
        before, dt = law.u, H * (1.0 + 0.3 * (h % 1.0))
        u = law.step([r], y, dt)
        assert abs(u - before) <= 25.0 * dt * (1 + 1e-12) + 1e-12


@pytest.mark.parametrize('case', CASES)
def test_p10_beyond_max_dt_the_observers_restart_without_a_bump(case: str) -> None:
    law = Law(design_of(**CASES[case], max_dt=0.2))
    for y in noise(1, 30, 0.1):
        u = law.step([0.5, 0.1], y, H)
    assert law.step([0.5, 0.1], 0.7, 0.21) == u
    assert law.status == Status.RESTARTED
    estimate = law.state.levels[0][0]
    assert estimate + (law.state.profile[0] if law.design.error_based else 0.0) == (
        pytest.approx(0.7, abs=1e-15)
    )
    assert clamp(law.design, raw_command(law.design, law.state)) == pytest.approx(u, abs=1e-9)
    before = state_bits(law.state)
    assert law.step([0.5, 0.1], 0.71, 0.2) is not None
    assert law.status != Status.RESTARTED and state_bits(law.state) != before


@pytest.mark.parametrize('structure', NAMES)
def test_p06_the_observers_see_the_applied_command(structure: str) -> None:
    """Saturated for 10 s, the estimates stay where the truth is."""
    law, chain = Law(design_of(structure=structure, command_min=-1.0, command_max=1.0)), Chain(2)
    for _ in range(1000):
        speed = chain.x[1]
        u = law.step([1000.0], chain.y, H)
        chain.advance(u - 0.5, H)
    assert u == 1.0
    assert sum(level[2] for level in law.state.levels) == pytest.approx(-0.5, abs=1e-3)
    assert law.state.levels[0][1] == pytest.approx(speed, rel=1e-6)


@pytest.mark.parametrize('case', CASES)
def test_the_next_state_never_aliases_and_the_old_one_stays(case: str) -> None:
    design = design_of(**CASES[case])
    state, out = init(design, 0.1, 0.0, 0.3), blank_state(design)
    before = copy_of(state)
    reference = [0.3] + [0.1] * design.order
    first = step(design, state, reference, 0.2, 0.1, H, out)
    assert state_bits(state) == state_bits(before)
    again = blank_state(design)
    assert step(design, state, reference, 0.2, 0.1, H, again) == first
    assert state_bits(again) == state_bits(out)
    assert out.profile is not state.profile and out.profile is not reference
    assert not any(a is b for a, b in zip(out.levels, state.levels))


@pytest.mark.parametrize('case', CASES)
def test_meet_makes_the_command(case: str) -> None:
    law = Law(design_of(**CASES[case]))
    for y in noise(1, 30, 0.1):
        law.step([0.5, 0.1], y, H)
    match_command(law.design, law.state, 0.123)
    assert raw_command(law.design, law.state) == pytest.approx(0.123, abs=1e-9)


@pytest.mark.parametrize('case', CASES)
def test_only_what_is_unusual_of_an_offset_decays_fast(case: str) -> None:
    """Also of the second one, which finds the first."""
    law = Law(design_of(**CASES[case]))
    for y in noise(1, 30, 0.1):
        law.step([0.5, 0.1], y, H)
    usual = 2.0 * law.state.smoothed[0] - law.state.smoothed[1]
    for command in (0.123, 0.456):
        match_command(law.design, law.state, command)
        assert usual + law.state.offset[0] == pytest.approx(command, abs=1e-9)


def test_what_is_noise_of_one_sample_decays_with_the_inner_observer() -> None:
    law = Law(design_of(inner_bandwidth=20.0, controller_bandwidth=2.0))
    for brief in (-1.0, -0.5, 3.0):
        law.state.offset[1] = brief
        law.step([0.0], 0.0, H)
        assert law.state.offset[1] == pytest.approx(brief * exp(-20.0 * H), rel=1e-9)


def test_what_the_law_usually_asks_for_is_without_what_a_transfer_added() -> None:
    law = Law(design_of(command_min=-500.0, command_max=500.0))
    for _ in range(2000):
        law.step([0.0], 0.0, H)
    match_command(law.design, law.state, 100.0)
    for _ in range(20):  # the observers take the applied command, and the law asks for 0 still
        law.u = 0.0
        law.step([0.0], 0.0, H)
    assert abs(law.state.offset[0]) > 10.0
    assert max(map(abs, law.state.smoothed)) < 1e-9


@pytest.mark.parametrize('applied', (NAN, INF, 1e16, -INF, -1e16))
def test_p03_an_applied_command_that_is_no_signal_counts_as_the_safe_one(applied: float) -> None:
    commands = []
    for acted in (applied, 1.0):
        law = Law(design_of(command_min=-20.0, command_max=30.0, safe_command=1.0))
        for y in noise(1, 5, 0.1):
            law.u = acted
            commands.append(law.step([0.5], y, H))
    assert bits(commands[:5]) == bits(commands[5:])


def test_start_writes_all_of_a_used_state() -> None:
    for case in CASES.values():
        case = case | {'input_delay': 0.0}  # what is on its way is not forgotten
        law = Law(design_of(**case))
        for y in noise(1, 30):
            law.step([0.5, 0.1], y, H)
        start(law.design, 0.25, 0.5, 0.75, law.state)
        fresh = init(law.design, 0.25, 0.5, 0.75)
        assert state_bits(law.state) == state_bits(fresh)


def test_without_error_the_measured_reference_is_followed_error_based() -> None:
    """Error-based, a reference whose derivatives nobody knows is tracked as if they were known."""
    errors = {}
    for error_based in (False, True):
        law, chain, worst = Law(design_of(error_based=error_based)), Chain(2), 0.0
        for k in range(1500):
            r = (k * H) ** 2 / 10.0
            chain.advance(law.step([r], chain.y, H), H)
            worst = max(worst, abs(chain.y - r)) if k > 1000 else 0.0
        errors[error_based] = worst
    assert errors[True] < 0.05 < errors[False]


def test_filtered_is_the_nested_law_without_its_second_subtraction() -> None:
    wide: dict[str, Any] = {'command_min': -1e6, 'command_max': 1e6}
    nested, filtered = (
        Law(design_of(structure=name, feedback_level='outer', b0=2.0, **wide))
        for name in ('nested', 'filtered')
    )
    for u, y in zip(noise(3, 200, 5.0), noise(4, 200)):
        nested.u = filtered.u = u
        difference = filtered.step([0.0], y, 0.01) - nested.step([0.0], y, 0.01)
        assert state_bits(nested.state) == state_bits(filtered.state)
        assert difference == pytest.approx(nested.state.levels[1][2] / 2.0, rel=1e-6, abs=1e-9)
    assert nested.status == filtered.status == 0 and abs(difference) > 1.0
