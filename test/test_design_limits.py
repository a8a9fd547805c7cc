"""What a first design assumes, warns of, and how fast it may be at most."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.design import make_design
from nadrc_ros.theory.delayed import (
    command_variance,
    delayed_loop,
    REFERENCE,
    step_responses,
)
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.margins import margins
from nadrc_ros.tuning import LEAST_GAIN, LEAST_MODULUS
from nadrc_ros.tuning.design.bandwidths import BAND, reference_step, settling_factor
from nadrc_ros.tuning.design.candidates import single
from nadrc_ros.tuning.design.first_design import first_design
from nadrc_ros.tuning.design.limits import (
    check,
    fastest,
    noise_budget,
    obstacle,
    robust_enough,
)
from nadrc_ros.tuning.design.prediction import settling_time
from nadrc_ros.tuning.design.requirements import Conflict, Requirements
import pytest
from test_first_design import wanted

TOP = Path(__file__).parents[1]


def row(factor: float) -> str:
    """Return what the default design of order 2 does with b0 at a multiple of the true one."""
    asked = Requirements(settling_time=0.5, rate=500.0)
    one, plant = single(asked), chain(2, 1.0)
    right, wrong = (
        make_design(attrs.evolve(one.settings, b0=b0, command_max=1e9)) for b0 in (1.0, factor)
    )
    loop = delayed_loop(wrong, plant, asked.period)
    (step,), h = step_responses(loop, [REFERENCE], 2.0)
    louder = command_variance(loop) / command_variance(delayed_loop(right, plant, asked.period))
    found = margins(wrong, plant, asked.period)
    over = 100.0 * max(step.max() - 1.0, 0.0)
    settling = settling_time(step, h, BAND)
    return (
        f'| {factor:g} | {settling:.2g} | {over:.0f} | {louder**0.5:.2g} times '
        f'| {1e3 * found.delay:.2g} | {found.modulus:.2f} |'
    )


def test_what_a_wrong_b0_does_is_as_the_docs_say() -> None:
    page = (TOP / 'docs' / 'choosing.md').read_text()
    rows = [row(factor) for factor in (0.25, 0.35, 0.5, 1.0, 2.0, 2.8, 4.0)]
    assert '\n'.join(rows) in page, '\n'.join(rows)
    rule = ', '.join(f'{settling_factor(order):.1f}' for order in (1, 2, 3))
    assert f'{rule} / settling time for order 1, 2, 3' in (TOP / 'docs' / 'robot.md').read_text()


def test_only_a_stable_loop_is_robust() -> None:
    asked = Requirements(settling_time=0.5, rate=500.0)
    settings = single(asked).settings
    assert robust_enough(make_design(settings), asked)
    too_little = attrs.evolve(settings, b0=0.1 * settings.b0)
    assert not robust_enough(make_design(too_little), asked)


def test_a_disturbance_is_seen_below_half_the_rate() -> None:
    check(wanted(disturbance_frequency=0.9 * 500.0 * pi))
    with pytest.raises(Conflict, match='below 1571 rad/s, half the rate'):
        check(wanted(disturbance_frequency=1.1 * 500.0 * pi))


def test_noise_may_take_a_third_of_the_range_of_the_command_or_what_is_asked_for() -> None:
    asked = Requirements(settling_time=0.5, command_limit=30.0)
    for command_noise, budget in ((0.0, 10.0), (7.0, 7.0), (12.0, 10.0)):
        assert noise_budget(attrs.evolve(asked, command_noise=command_noise)) == budget


def test_a_step_of_the_reference_may_be_a_thousandth_of_the_largest_signal() -> None:
    check(wanted(reference_step=0.9e12))
    with pytest.raises(Conflict, match=r'or a reference_step up to 1e\+12'):
        check(wanted(reference_step=1.1e12))


def test_what_is_not_said_is_taken_from_the_range_of_the_command() -> None:
    """In whatever units: for b0 = 0.0067 a disturbance of 1 would take one and a half ranges."""
    for b0, limit in ((0.0067, 100.0), (-3e4, 0.5)):
        asked = Requirements(order=1, settling_time=300.0, rate=1.0, b0=b0, command_limit=limit)
        design = first_design(asked)
        assert asked.load == pytest.approx(0.1 * abs(b0) * limit)
        assert not design.warning
        assert all(run.saturated == 0.0 for run in design.expected().values())
        assert '10 % of command_limit' in design.rules[3] and 'assumed' in design.rules[3]
        peak = make_design(design.chosen.settings).feedback_gains[0] * reference_step(asked)
        assert peak / abs(b0) == pytest.approx(0.5 * limit, rel=0.01)


def test_a_delay_that_leaves_too_little_distance_slows_the_observer_or_is_warned_of() -> None:
    slower = first_design(wanted(delay=0.0145))
    assert slower.chosen.prediction.margins.modulus >= 0.4 and not slower.warning
    assert 'distance from -1' in slower.candidates[0].decided_by
    near = first_design(wanted(order=3, delay=0.006))
    assert 'comes within 0.35 of instability' in near.warning


def test_no_warning_of_a_library_comes_before_a_refusal(
    recwarn: pytest.WarningsRecorder,
) -> None:
    with pytest.raises(Conflict):
        first_design(Requirements(order=4, settling_time=0.9, rate=22.63))
    assert not recwarn.list


@pytest.mark.parametrize(
    ('values', 'cause'),
    (
        ({'order': 1}, 'the rate'),
        ({'order': 2, 'delay': 0.048}, 'the delay'),
        ({'order': 3}, 'the margins'),
        ({'order': 2, 'noise_std': 0.05, 'command_noise': 0.1}, 'the noise'),
        ({'order': 1, 'reference_step': 80.0}, 'the range of the command'),
    ),
)
def test_the_fastest_design_is_one_that_a_tuning_accepts(
    values: dict[str, Any], cause: str
) -> None:
    asked = Requirements(settling_time=1.0, rate=100.0, **values)
    found, limit = fastest(asked)
    margins = single(found).prediction.margins
    assert limit == cause
    assert margins.modulus >= LEAST_MODULUS and margins.delay >= asked.period
    assert margins.gain_low <= 1.0 / LEAST_GAIN < LEAST_GAIN <= margins.gain_high
    shorter = attrs.evolve(found, settling_time=0.75 * found.settling_time)
    assert obstacle(shorter) == cause and not obstacle(found)


def test_a_loop_that_bears_less_than_twice_its_gain_is_not_sound() -> None:
    asked = Requirements(order=3, settling_time=2.2, rate=100.0, half_gain=True, noise_std=0.001)
    asked = attrs.evolve(asked, command_noise=5.0)
    near = single(asked).prediction.margins
    assert near.modulus > 1.02 * LEAST_MODULUS and near.gain_low < 1.0 / LEAST_GAIN
    assert near.gain_high < LEAST_GAIN and obstacle(asked) == 'the margins'
    assert not obstacle(attrs.evolve(asked, settling_time=4.0))


def test_what_no_settling_time_makes_sound_is_refused_with_the_cause() -> None:
    with pytest.raises(Conflict, match=r'no settling time up to .* the range of the command'):
        fastest(Requirements(settling_time=1.0, rate=100.0, reference_step=1e15, b0=1e-6))


def test_a_heater_gets_no_negative_command() -> None:
    design = first_design(Requirements(order=1, settling_time=0.5, one_sided=True))
    assert design.chosen.settings.command_min == 0.0
    assert design.scenario.disturbance.values['amplitude'] < 0.0  # one that it can cancel
