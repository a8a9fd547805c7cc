"""A dead time as a factor against the same one as states, which holds for short ones only."""

from __future__ import annotations

import resource
from typing import Any

from hypothesis import assume, given, settings
from hypothesis import strategies as st
from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.delayed import (
    closed_response,
    COMMAND,
    command_variance,
    delayed_loop,
    is_stable_loop,
    LOAD,
    loop_grid,
    NOISE,
    open_response,
    OUTPUT,
    REFERENCE,
    step_responses,
)
from nadrc_ros.theory.loop import chain, closed_loop, loop_growth
from nadrc_ros.theory.margins import margins, UNSTABLE
from nadrc_ros.theory.system import Array, pick, StateSpace
from nadrc_ros.tuning.design.first_design import first_design
from nadrc_ros.tuning.design.prediction import settling_time
from nadrc_ros.tuning.design.requirements import Conflict, Requirements
import numpy as np
import pytest
from theory_helpers import LINEAR, output_covariance, response, wide_design

H = 0.01
# Too near to the edge of stability for rounding to say on which side it is.
EDGE = 1e-6

Case = tuple[Design, StateSpace, float]


@st.composite
def cases(draw: Any) -> Case:
    """Loops of any structure around plants with damping, stiffness or neither, up to unstable."""
    n = draw(st.integers(1, 3))
    w = 10.0 ** draw(st.floats(-1.7, -0.2)) / H
    design = wide_design(
        structure=draw(st.sampled_from(LINEAR)),
        plant_order=n,
        inner_bandwidth=w,
        outer_bandwidth=draw(st.floats(0.4, 1.0)) * w,
        controller_bandwidth=draw(st.floats(0.05, 0.3)) * w,
        error_based=draw(st.booleans()),
        input_delay=draw(
            st.just(0.0) | st.floats(1e-3, 12.0 * H) | st.integers(1, 9).map(H.__mul__)
        ),
    )
    damping = draw(st.lists(st.floats(-1.0, 2.0), max_size=n))
    plant = chain(n, design.b0 * 10.0 ** draw(st.floats(-0.5, 0.5)), damping)
    fits, any_delay = st.floats(0.0, 0.4 / w), st.floats(0.0, 40.0 * H)
    return design, plant, draw(st.one_of(fits, any_delay))


@settings(max_examples=30)
@given(case=cases())
def test_stability_response_and_noise_are_those_of_the_loop_with_the_delay_as_states(
    case: Case,
) -> None:
    growth = loop_growth(*case[:2], H, case[2])
    assume(abs(growth - 1.0) > EDGE)
    loop = delayed_loop(*case[:2], H, case[2])
    assert is_stable_loop(loop) == (growth < 1.0)
    assert (command_variance(loop) < np.inf) == (growth < 1.0)
    augmented = closed_loop(*case[:2], H, case[2])
    omega = np.geomspace(0.01, np.pi / H, 30)
    expected = response(augmented, omega)
    np.testing.assert_allclose(
        closed_response(loop)(omega), expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max()
    )
    if growth < 1.0 - 1e-3:
        of_command = output_covariance(pick(augmented, [NOISE], [COMMAND]), 2.0)
        assert command_variance(loop, 2.0) == pytest.approx(float(of_command[0, 0]), rel=1e-6)


@pytest.mark.parametrize(('periods', 'noise'), ((3.0, 98.288), (5.0, 90.728), (2.4, None)))
def test_behind_a_delay_a_law_that_knows_a_vibration_has_the_noise_of_its_own_command(
    periods: float, noise: float | None
) -> None:
    """Not that of the law without the delay, which makes of the same estimates another command."""
    design = wide_design(
        inner_bandwidth=15.0,
        outer_bandwidth=10.0,
        controller_bandwidth=2.0,
        input_delay=periods * H,
        disturbance_frequencies=(20.0,),
    )
    plant = chain(2, design.b0)
    augmented = closed_loop(design, plant, H, periods * H)
    loop = delayed_loop(design, plant, H, periods * H)
    omega = np.geomspace(0.1, np.pi / H, 30)
    expected = response(augmented, omega)
    np.testing.assert_allclose(
        closed_response(loop)(omega), expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max()
    )
    of_command = output_covariance(pick(augmented, [NOISE], [COMMAND]))
    assert command_variance(loop) == pytest.approx(float(of_command[0, 0]), rel=1e-6)
    if noise is not None:
        assert command_variance(loop) ** 0.5 * design.b0 == pytest.approx(noise, rel=1e-4)


def test_noise_near_the_edge_of_stability_has_a_narrow_peak_that_is_not_missed() -> None:
    design = wide_design(
        plant_order=1,
        structure='generalized',
        inner_bandwidth=10.0**1.75,
        controller_bandwidth=10.0**1.75 / 8.0,
        input_delay=0.0625,
    )
    case = design, chain(1, design.b0), H, 0.006190386377497487
    assert 0.99 < loop_growth(*case) < 1.0
    of_command = output_covariance(pick(closed_loop(*case), [NOISE], [COMMAND]))
    assert command_variance(delayed_loop(*case)) == pytest.approx(
        float(of_command[0, 0]), rel=1e-6
    )


def recursion(system: StateSpace, inputs: list[int], count: int) -> Array:
    """Return the output after unit steps, period by period."""
    x, found = np.zeros((len(system.a), len(inputs))), []
    for _ in range(count):
        found.append(system.c[OUTPUT] @ x)
        x = system.a @ x + system.b[:, inputs]
    return np.asarray(np.array(found).T, dtype=float)


@pytest.mark.parametrize('structure', LINEAR)
def test_a_response_in_time_is_that_of_the_recursion(structure: str) -> None:
    """Of every period to rounding; of every k-th, where it takes too many, within a percent."""
    for w, rough in ((20.0, 1e-10), (0.1, 1e-2)):
        design = wide_design(
            structure=structure,
            inner_bandwidth=w,
            outer_bandwidth=w,
            controller_bandwidth=0.2 * w,
            b0=2.0,
        )
        plant, delay = chain(2, 2.0), 0.0435 if w > 1.0 else 0.4
        inputs = [LOAD, REFERENCE]
        found, step = step_responses(delayed_loop(design, plant, H, delay), inputs, 60.0 / w)
        every = round(step / H)
        assert (every == 1) == (w > 1.0)
        expected = recursion(closed_loop(design, plant, H, delay), inputs, 20_000)[:, ::every]
        count = min(len(found[0]), len(expected[0]))
        error = np.abs(found[:, :count] - expected[:, :count]).max(axis=1)
        assert (error <= rough * np.abs(expected).max(axis=1)).all()


@pytest.mark.parametrize('periods', (8, 12))
def test_a_response_lasts_no_longer_than_twice_until_it_rests(periods: int) -> None:
    design = wide_design(inner_bandwidth=20.0, controller_bandwidth=4.0)
    loop = delayed_loop(design, chain(design.order, design.b0), H)
    (found,), step = step_responses(loop, [REFERENCE], periods * H)
    left = np.abs(1.0 - found)
    half, count = len(found) // 2, len(found)
    assert step == H
    assert left[-count // 8 :].max() < 1e-6 < left[half - half // 8 : half].max()


def test_a_thousand_periods_of_delay_are_no_other_problem() -> None:
    """The same loop at 2 and at 100 Hz: 20 periods of delay as states, 1000 as a factor."""
    values = {'inner_bandwidth': 0.05, 'outer_bandwidth': 0.05, 'controller_bandwidth': 0.01}
    design, plant = wide_design(**values), chain(2, 1.0)
    coarse, fine = (margins(design, plant, h, 10.0 + h / 2.0) for h in (0.5, 0.01))
    # Half a period of hold is a part of the loop, so that 10 s hold in both beside it.
    assert fine.delay - coarse.delay == pytest.approx(0.0, abs=0.5)
    for name in ('gain_low', 'gain_high', 'modulus', 'phase', 'crossover'):
        assert getattr(fine, name) == pytest.approx(getattr(coarse, name), rel=0.05)
    late = margins(design, plant, 0.01, 10.0)
    for more, stable in ((0.98, True), (1.02, False)):
        found = margins(design, plant, 0.01, 10.0 + more * late.delay)
        assert (found != UNSTABLE) == stable
    assert margins(design, plant, 0.01, 1e6) == UNSTABLE


def test_a_design_for_a_long_delay_needs_little_memory_and_says_the_same_at_any_rate() -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = [
        first_design(Requirements(order=1, settling_time=500.0, rate=rate, delay=10.0))
        for rate in (5.0, 10.0)
    ]
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000
    slow, fast = (design.chosen.prediction for design in found)
    assert found[0].chosen.name == found[1].chosen.name
    assert fast.settling_time == pytest.approx(slow.settling_time, rel=0.01)
    assert fast.error == pytest.approx(slow.error, rel=0.02)
    assert fast.margins.modulus == pytest.approx(slow.margins.modulus, rel=0.02)
    assert fast.input_gain_margin == pytest.approx(slow.input_gain_margin, rel=0.02)
    runs = [design.expected()[design.chosen.name] for design in found]
    assert runs[1].itae == pytest.approx(runs[0].itae, rel=0.02)


def test_a_grid_follows_each_turn_of_a_delay_where_the_loop_still_acts() -> None:
    design = wide_design(inner_bandwidth=20.0, outer_bandwidth=20.0, controller_bandwidth=5.0)
    for delay in (0.5, 3.0):
        loop = delayed_loop(design, chain(2, design.b0), H, delay)
        omega = loop_grid(loop, 50)
        (acts,) = np.nonzero(np.abs(open_response(loop)(omega)) > 0.5)
        assert np.diff(omega[: acts[-1] + 1]).max() * delay < 0.26
        assert omega[-1] <= np.pi / H * (1.0 + 1e-9) and len(omega) < 2000


def test_milliseconds_that_were_given_as_seconds_are_refused() -> None:
    with pytest.raises(
        Conflict, match=r'delay = 10 s: such a loop tolerates 0.0\d+ s.*possible: '
    ):
        first_design(Requirements(settling_time=0.5, delay=10.0))


def test_the_settling_time_is_read_between_two_samples() -> None:
    response = np.array([0.0, 0.5, 0.96, 1.0, 1.0])
    assert settling_time(response, 0.1, 0.02) == pytest.approx(0.25)
    assert settling_time(response[:3], 0.1, 0.02) == np.inf
    assert settling_time(response[3:], 0.1, 0.02) == 0.0
