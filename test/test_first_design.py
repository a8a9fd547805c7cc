"""A first design does what was asked for, measured in simulation and by python-control."""

from __future__ import annotations

from math import degrees, pi
import re
from typing import Any

import attrs
import control
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import Scenario
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.simulate import Result, simulate
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.model import controller
from nadrc_ros.theory.system import pick
from nadrc_ros.tuning.design.bandwidths import BAND, readable, settings_of, settling_factor
from nadrc_ros.tuning.design.candidates import (
    advice,
    advised,
    better_below,
    Candidate,
    candidates,
    single,
    WORTH,
)
from nadrc_ros.tuning.design.first_design import expect, experiment, first_design
from nadrc_ros.tuning.design.limits import check, noise_budget
from nadrc_ros.tuning.design.prediction import curves, predict, settling_time
from nadrc_ros.tuning.design.requirements import Conflict, Requirements
import numpy as np
import pytest

H = 0.002
USUAL = Requirements(
    settling_time=0.5, rate=500.0, noise_std=0.001, disturbance=1.0, reference_step=1.0
)


def wanted(**values: Any) -> Requirements:
    return attrs.evolve(USUAL, command_limit=1e9, **values)


def run(scenario: Scenario, candidate: Candidate, **changes: Any) -> Result:
    """Run a candidate in a changed scenario, in plain Python."""
    scenario = attrs.evolve(scenario, **changes)
    return simulate(scenario.experiment, candidate.settings, compiled=False)


@pytest.mark.parametrize('settling', (0.12, 0.5, 3.0))
@pytest.mark.parametrize('n', (1, 2, 3, 4, 5))
def test_a_step_settles_in_the_time_asked_for(n: int, settling: float) -> None:
    """Of the real law on its nominal plant, without noise; 0.12 s is near the shortest for it."""
    settling = max(settling, 1.001 * settling_factor(n) * 10.0 * H)
    asked = wanted(order=n, settling_time=settling, noise_std=0.0, disturbance=1e-9)
    one = single(asked)
    result = run(experiment(asked, [one]), one, duration=1.5 * settling)
    start = experiment(asked, [one]).reference.values['start_time']
    step = result.output[result.time >= start - 1e-9]
    first = result.time[len(result.time) - len(step)]
    measured = settling_time(step, asked.period, BAND) + first - start
    assert measured == pytest.approx(settling, rel=0.02)
    assert one.prediction.settling_time == pytest.approx(settling, rel=0.02)


@pytest.mark.parametrize('n', (1, 2, 3, 4, 5))
def test_the_settling_factor_solves_the_step_response(n: int) -> None:
    s = control.tf([1], np.poly([-1.0] * n))
    (left,) = 1.0 - control.step_response(s, T=[0.0, settling_factor(n)]).outputs[1:]
    assert left == pytest.approx(0.02, abs=1e-6)


CASES: tuple[dict[str, Any], ...] = (
    {'order': 1},
    {'disturbance_frequency': 8.0, 'b0': -3.0},
    {'half_gain': True},
    {'delay': 0.008},
    {'structure': 'cascade', 'levels': 3},
    {'order': 3, 'structure': 'generalized'},
)


@pytest.mark.parametrize('values', CASES)
def test_margins_equal_those_of_python_control(values: dict[str, Any]) -> None:
    """The plant sampled by python-control, the delay as z^-4, the loop closed by it too."""
    asked = wanted(**values)
    n, omega = asked.order, np.geomspace(1.0, np.pi / H, 2000)
    plant = control.c2d(control.ss(*chain(n, asked.b0)[:4]), H)
    late = control.tf([1.0], [1.0] + [0.0] * round(asked.delay / H), H)
    chosen = candidates(asked)[-1]
    found = chosen.prediction.margins
    law = control.ss(*pick(controller(make_design(chosen.settings), H), [0], [0]))
    loop = -np.prod([part(np.exp(1j * omega * H)) for part in (plant, late, law)], axis=0)
    gains, phases, modulus, *_ = control.stability_margins(
        control.frd(loop, omega), returnall=True
    )
    gains = np.append(gains, -1.0 / loop[-1].real)
    assert min(gains[gains > 1.0]) == pytest.approx(found.gain_high, rel=1e-3)
    assert max(gains[gains < 1.0]) == pytest.approx(found.gain_low, rel=1e-3)
    assert min(abs(phases)) == pytest.approx(degrees(found.phase), rel=1e-3)
    assert min(modulus) == pytest.approx(found.modulus, rel=1e-3)


@pytest.mark.parametrize('values', ({'noise_std': 0.0}, *CASES))
def test_an_input_gain_that_is_wrong_for_ever_is_one_that_is_wrong_in_any_way(
    values: dict[str, Any],
) -> None:
    asked = wanted(**values)
    for candidate in candidates(asked):
        found = candidate.prediction
        share, margins = found.input_gain_margin, found.margins
        assert 0.1 < share <= min(1.0 - margins.gain_low, margins.gain_high - 1.0) * (1.0 + 1e-6)


@pytest.mark.parametrize('values', ({'order': 1}, {'structure': 'nested'}, {'half_gain': True}))
def test_the_command_is_as_noisy_as_predicted(values: dict[str, Any]) -> None:
    """The sample variance of blocks, within four of its standard errors; at rest otherwise."""
    design = first_design(wanted(**values, disturbance=1e-9, reference_step=1e-9))
    result = run(design.scenario, design.chosen, duration=40.0, noise=Noise(variance=1e-6, seed=3))
    blocks = np.square(result.command[500:]).reshape(-1, 500).mean(axis=1)
    error = blocks.std() / len(blocks) ** 0.5
    predicted = design.chosen.prediction.command_noise**2
    assert abs(blocks.mean() - predicted) < 4.0 * error < 0.2 * predicted


def test_the_error_under_the_disturbance_is_as_predicted() -> None:
    """The amplitude left of a sine below the peak of the response, and the area under a step."""
    for frequency in (0.0, 6.0):
        asked = wanted(noise_std=0.0, disturbance_frequency=frequency, disturbance=20.0, b0=2.0)
        asked = attrs.evolve(asked, reference_step=1e-9)
        one = single(asked)
        found = run(experiment(asked, [one]), one, duration=5.0).output
        measured = np.abs(found[-750:]).max() if frequency else np.abs(found).sum() * H
        assert measured == pytest.approx(one.prediction.error, rel=0.02)


def test_noise_adds_the_variance_of_the_command_to_the_isu() -> None:
    asked = wanted()
    one = single(asked)
    scenario = experiment(asked, [one])
    expected = expect(scenario, one)
    still = run(scenario, one, noise=Noise()).metrics.isu
    runs = [
        run(scenario, one, noise=Noise(variance=1e-6, seed=seed)).metrics.isu for seed in range(8)
    ]
    assert expected.isu == runs[1]
    variance = one.prediction.command_noise**2
    assert expected.noise_isu == pytest.approx(variance * scenario.duration, rel=1e-9)
    error = np.std(runs) / len(runs) ** 0.5
    assert abs(np.mean(runs) - still - expected.noise_isu) < 4.0 * error


def test_all_candidates_are_equally_noisy_and_within_the_budget() -> None:
    asked = wanted(command_noise=0.8)
    found = candidates(asked)
    assert [c.name for c in found] == ['conventional', 'nested_2', 'nested_3']
    noise = [c.prediction.command_noise for c in found]
    assert noise == pytest.approx([0.8] * 3, rel=3e-3)
    assert max(noise) <= noise_budget(asked)
    assert found[0].decided_by == 'the limit of the command noise'


@pytest.mark.parametrize(
    ('structure', 'paces'), [('nested', (1.0, 1.0, 1.0)), ('cascade', (1.0, 2.0, 4.0))]
)
def test_levels_are_equally_fast_and_those_of_a_cascade_each_twice_as_fast(
    structure: str, paces: tuple[float, ...]
) -> None:
    settings = settings_of(wanted(), structure, 3, 10.0, 30.0)
    assert make_design(settings).bandwidths == [30.0 * pace for pace in paces]


@pytest.mark.parametrize('half', [False, True])
def test_half_gains_are_named_where_they_act(half: bool) -> None:
    design = first_design(wanted(half_gain=half))
    assert ('half of the observer gains' in ' '.join(design.rules)) == half
    assert design.chosen.settings.observer_gain_factor == (0.5 if half else 1.0)


@pytest.mark.parametrize('n', (1, 2))
def test_the_rules_say_how_many_wc_the_observer_is_and_what_holding_takes_of_order_1(
    n: int,
) -> None:
    controller, observer, *_ = first_design(wanted(order=n)).rules
    assert 'set by the rule of thumb: 5 wc (3 to 10' in observer
    assert (', less for the hold' in controller) == (n == 1)


def test_the_advice_follows_the_disturbance() -> None:
    for frequency, chosen in ((0.0, 'nested_2'), (8.0, 'nested_3'), (25.0, 'conventional')):
        design = first_design(wanted(disturbance_frequency=frequency))
        assert design.chosen.name == chosen
        share = design.chosen.prediction.error / design.candidates[0].prediction.error
        assert chosen == 'conventional' or share < WORTH
        named = {'nested_2': 'two nested', 'nested_3': 'three nested', 'conventional': 'one'}
        assert design.advice.startswith(f'Take {named[chosen]} observer')
        crossing = re.findall(r'only against disturbances below ([\d.]+) rad/s', design.advice)
        assert len(crossing) == 1 and 10.0 < float(crossing[0]) < 25.0
        better = named['nested_2' if chosen == 'conventional' else chosen].capitalize()
        assert f'. {better} observers help only against disturbances below' in design.advice
        other = {'nested_2': 'three', 'nested_3': 'two'}.get(chosen)
        aside = re.findall(r' \((\w+) nested observers \d+ %\)\.', design.advice)
        assert aside == ([other] if other else [])


@pytest.mark.parametrize('frequency', (2.0, 8.0))
def test_the_experiment_lasts_for_three_cycles_of_a_slow_disturbance(frequency: float) -> None:
    scenario = first_design(wanted(disturbance_frequency=frequency)).scenario
    acting = scenario.duration - scenario.disturbance.values['start_time']
    expected = max(4.0 * wanted().settling_time, 3.0 * 2.0 * pi / frequency)
    assert acting == pytest.approx(expected, rel=0.01)  # a duration of three digits


def test_a_delay_that_no_controller_takes_is_refused_by_its_own_name() -> None:
    with pytest.raises(SettingError, match=r'^delay = 10\.0: must be at most 1 s'):
        first_design(Requirements(settling_time=400.0, delay=10.0, rate=100.0))


def test_each_candidate_that_is_not_taken_has_a_reason_of_its_own() -> None:
    asked = wanted()
    one, two, three = candidates(asked)

    def left(c: Candidate, share: float, modulus: float) -> Candidate:
        margins = c.prediction.margins._replace(modulus=modulus)
        error = share * one.prediction.error
        return attrs.evolve(c, prediction=c.prediction._replace(error=error, margins=margins))

    found = [one, left(two, 0.85, 0.45), left(three, 0.7, 0.35)]
    assert advised(found) is one
    assert (
        'two nested observers leave 85 % of its error under a step of the disturbance, which is '
        'too little for the margins lost; three nested observers leave 70 % of its error under a '
        'step of the disturbance, but come too near to instability (modulus 0.35, wanted 0.4).'
    ) in advice(asked, found, one)


def test_what_was_asked_for_is_taken_whatever_the_advice() -> None:
    for structure in ('filtered', 'cascade', 'generalized'):
        design = first_design(wanted(structure=structure, disturbance_frequency=25.0))
        assert design.chosen.settings.structure == structure
        assert design.advice.startswith('Take one observer')
    assert first_design(wanted(levels=4)).chosen.name == 'nested_4'


def test_more_observers_are_better_below_the_frequency_named() -> None:
    asked = wanted()
    one, two, three = candidates(asked)
    for more in (two, three):
        edge = better_below(asked, one, more)
        for share in (0.7, 0.95, 1.05, 1.3):
            omega = np.array([share * edge])
            left = [curves(c.settings, asked, omega).disturbance_to_output[0] for c in (one, more)]
            assert (left[1] < left[0]) == (share < 1.0)


def test_half_gain_is_quieter_at_the_same_bandwidth_and_rejects_as_well() -> None:
    full, half = (single(wanted(half_gain=flag)) for flag in (False, True))
    assert half.settings.inner_bandwidth == full.settings.inner_bandwidth
    assert half.prediction.command_noise < 0.75 * full.prediction.command_noise
    assert half.prediction.error == pytest.approx(full.prediction.error, rel=0.02)
    assert half.prediction.margins.gain_high < 0.7 * full.prediction.margins.gain_high


REFUSED: tuple[tuple[dict[str, Any], tuple[str, ...]], ...] = (
    ({'settling_time': 0.01}, ('settling_time = 0.01 s', 'rate = 500 Hz', '150 rad/s')),
    ({'command_noise': 0.01}, ('command_noise = 0.01', 'noise_std = 0.001')),
    ({'delay': 0.05}, ('delay = 0.05 s', 'tolerates 0.0148 s')),
    ({'order': 4, 'delay': 0.05, 'command_noise': 0.1}, ('delay = 0.05 s',)),
)


@pytest.mark.parametrize(('values', 'words'), REFUSED)
def test_a_conflict_is_named_and_what_it_says_is_possible_is(
    values: dict[str, Any], words: tuple[str, ...]
) -> None:
    asked = wanted(**values)
    with pytest.raises(Conflict) as caught:
        check(asked)
    message = str(caught.value)
    assert all(word in message for word in words) and message.count('possible: ') == 1
    possible = float(message.split('at least ')[-1].removesuffix(' s'))
    check(attrs.evolve(asked, settling_time=possible))
    with pytest.raises(Conflict):
        check(attrs.evolve(asked, settling_time=0.98 * possible))


@pytest.mark.parametrize(
    ('values', 'said'),
    [
        ({'disturbance_frequency': 1600.0}, 'disturbance_frequency = 1600 rad/s cannot be seen'),
        (
            {'settling_time': 1e8, 'rate': 1e-3, 'reference_step': 0.0},
            r'settling_time = 1e\+08 s; possible: another b0',
        ),
    ],
)
def test_what_no_setting_or_sample_can_hold_is_refused(values: dict[str, Any], said: str) -> None:
    with pytest.raises(Conflict, match=said):
        check(wanted(**values))


def test_a_slow_loop_at_a_high_rate_is_predicted_as_a_fast_one() -> None:
    """Time counts in settling times: the integral of |y| goes with its cube for order 2."""
    fast, slow = (
        predict(single(asked).settings, asked)
        for asked in (wanted(noise_std=0.0), wanted(noise_std=0.0, settling_time=400.0))
    )
    assert slow.settling_time == pytest.approx(400.0, rel=1e-3)
    assert slow.error / fast.error == pytest.approx(800.0**3, rel=0.02)


def test_a_delay_that_is_short_for_a_slow_loop_changes_its_margins_little() -> None:
    slow = wanted(noise_std=0.0, settling_time=400.0)
    late = attrs.evolve(slow, delay=0.006)
    before, after = (predict(single(slow).settings, each).margins for each in (slow, late))
    assert after.delay == pytest.approx(before.delay - 0.006, rel=1e-3)
    for name in ('gain_low', 'phase', 'modulus', 'crossover'):
        assert getattr(after, name) == pytest.approx(getattr(before, name), rel=0.01)


def test_noise_that_would_fill_the_range_of_the_command_is_refused() -> None:
    with pytest.raises(Conflict, match='command_limit = 1, of which noise may take a third'):
        check(attrs.evolve(USUAL, command_limit=1.0))


def test_a_delay_that_fits_is_in_the_experiment_and_the_loop_is_stable() -> None:
    design = first_design(wanted(delay=0.006, noise_std=0.0))
    result = run(design.scenario, design.chosen)
    assert design.scenario.input_delay == design.chosen.settings.input_delay == 0.006
    (told,) = (rule for rule in design.rules if 'input_delay = 0.006 s' in rule)
    assert 'without that it comes within' in told and design.pid is None
    assert abs(result.output[-1]) - 1.0 == pytest.approx(0.0, abs=0.02)
    with pytest.raises(Conflict, match='too fast for rate'):
        candidates(wanted(delay=0.0147, structure='cascade', levels=6))


def test_a_step_that_saturates_the_command_is_warned_of() -> None:
    asked = Requirements(settling_time=0.5, rate=500.0, reference_step=0.5, b0=0.5)
    assert 'command of 136.2, more than command_limit = 100' in first_design(asked).warning
    assert not first_design(attrs.evolve(asked, reference_step=0.3)).warning
    assert 'no controller holds' in first_design(attrs.evolve(asked, disturbance=60.0)).warning


def test_numbers_for_people() -> None:
    assert [readable(x) for x in (58.33921, 0.0123456, 42.0, 99999.0)] == [
        58.33,
        0.01234,
        42.0,
        99990.0,
    ]


def test_the_document_holds_settings_that_load() -> None:
    design = first_design(wanted(order=3))
    document = design.document(design.expected())
    for candidate in document['candidates'].values():
        ControllerSettings(**candidate['settings'])
    assert document['pid'] is None and document['chosen'] in document['candidates']
