"""Which part of N-ADRC brings its improvement, with few seeds and bandwidths."""

from __future__ import annotations

from copy import deepcopy
import json

from nadrc_ros.report.style import render
from nadrc_ros.scenario import find_scenario, load
from paper import attribution
from paper.section import Result
import pytest

SEEDS = 2


@pytest.fixture(scope='module')
def result() -> Result:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(attribution, 'BANDWIDTHS', (6.0, 12.0, 30.0))
        patch.setattr(attribution, 'SEARCH_SEEDS', range(2001, 2002))
        shares: list[float] = []
        found = attribution.measure(shares.append, 2, SEEDS)
        assert shares == sorted(shares)
        again = attribution.measure(shares.append, 1, SEEDS)
    assert json.dumps(found, allow_nan=False) == json.dumps(again)
    back: Result = json.loads(json.dumps(found))
    assert back == found
    return back


def test_the_parts_differ_in_nothing_else() -> None:
    parts = attribution.parts(load(find_scenario('paper_v')))
    c, subtraction, states, n = parts.values()
    assert (c.structure, n.structure) == ('conventional', 'nested')
    assert (subtraction.structure, subtraction.feedback_level) == ('nested', 'inner')
    assert (states.structure, states.feedback_level) == ('filtered', 'outer')
    same = {(s.inner_bandwidth, s.fal_gains, s.fal_exponents, s.fal_delta) for s in parts.values()}
    assert len(same) == 1


def test_the_outer_states_bring_the_noisy_improvement(result: Result) -> None:
    assert attribution.SECTION.check(result) == []
    for found in result['scenarios'].values():
        shares = found['shares']
        assert shares['states']['noisy_isu'] > 0.9
        assert shares['n_adrc'] == dict.fromkeys(attribution.FIGURES_OF_MERIT, 1.0)


def test_in_g_the_second_subtraction_brings_the_noise_free_gain(result: Result) -> None:
    shares = result['scenarios']['G']['shares']
    assert shares['subtraction']['clean_itae'] > 0.9 > 0.1 > shares['states']['clean_itae']
    for name in 'PV':
        shares = result['scenarios'][name]['shares']
        assert shares['states']['clean_itae'] > 0.9 > 0.1 > shares['subtraction']['clean_itae']


def test_the_scenarios_are_tuned_too_high_for_their_noise(result: Result) -> None:
    for found in result['scenarios'].values():
        variants = found['variants']
        assert variants['c_best']['inner_bandwidth'] == 12.0
        assert variants['c_best']['noisy_itae'] < 0.8 * variants['c_adrc']['noisy_itae']
        assert variants['c_best']['noisy_isu'] < 0.2 * variants['n_adrc']['noisy_isu']
        assert variants['n_best']['noisy_itae'] < variants['c_best']['noisy_itae']


@pytest.mark.parametrize(('part', 'share'), [('states', 0.8), ('subtraction', 0.2)])
def test_another_attribution_is_named(part: str, share: float, result: Result) -> None:
    spoilt = deepcopy(result)
    spoilt['scenarios']['P']['shares'][part]['noisy_itae'] = share
    (sentence,) = attribution.SECTION.check(spoilt)
    assert sentence.startswith('attribution: share of the noisy improvement')


def test_the_picture_is_the_same_each_time(result: Result) -> None:
    first, second = (attribution.figures(r)['attribution'] for r in (result, deepcopy(result)))
    assert render(first, 'svg') == render(second, 'svg')
