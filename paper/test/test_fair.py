"""The fair comparison: its committed designs with few seeds, and the search for them."""

from __future__ import annotations

from copy import deepcopy
from itertools import pairwise
import json
from math import inf, log10
from typing import Any

import attrs
from nadrc_ros.scenario import Scenario
from nadrc_ros.simulation.batch import simulate_batch
from nadrc_ros.yaml_text import read_yaml
from paper import fair, retune
from paper.candidates import (
    AIMS,
    BUDGETS,
    CANDIDATES,
    designed,
    dump_designs,
    load_designs,
    load_scenario,
    RANGES,
)
from paper.drawing import render
from paper.section import Result
import pytest

SEEDS = 2
NAMES = [candidate.name for candidate in CANDIDATES]
BY_NAME = dict(zip(NAMES, CANDIDATES))
BUDGET = 20.0
SHORT_BUDGETS = (4.0, 20.0)


@pytest.fixture(scope='module')
def result() -> Result:
    shares: list[float] = []
    found = fair.measure(shares.append, 2, SEEDS)
    assert shares == sorted(shares)
    back: Result = json.loads(json.dumps(found, allow_nan=False))
    assert back == found
    return back


def test_every_candidate_has_a_design_for_every_aim_and_budget(result: Result) -> None:
    assert list(result['candidates']) == NAMES == list(load_designs())
    for candidate in result['candidates'].values():
        for aim in AIMS:
            assert [row['budget'] for row in candidate[aim]] == list(BUDGETS)


def test_the_verdict_holds_with_few_seeds(result: Result) -> None:
    assert fair.SECTION.check(result) == []


def test_a_larger_budget_never_hurts(result: Result) -> None:
    for candidate in result['candidates'].values():
        for aim in AIMS:
            merits = [fair.merit(row, aim) for row in candidate[aim]]
            slack = 1.05 if aim == 'noisy' else 1.001
            assert all(late <= slack * early for early, late in pairwise(merits))


def test_it_is_the_same_each_time(monkeypatch: pytest.MonkeyPatch, result: Result) -> None:
    monkeypatch.setattr(fair, 'CANDIDATES', (BY_NAME['conventional'], BY_NAME['cascade_2']))
    again = fair.measure(lambda share: None, 1, SEEDS)
    for name, candidate in again['candidates'].items():
        assert json.dumps(candidate) == json.dumps(result['candidates'][name])
    first, second = (fair.figures(each)['fair'] for each in (result, deepcopy(result)))
    assert render(first, 'svg') == render(second, 'svg')


def _over_budget(result: Any) -> None:
    result['candidates']['printed']['clean'][2]['noisy_isu']['mean'] = 1.07 * BUDGETS[2]


def _no_noisy_gain(result: Any) -> None:
    result['gains']['nested_2']['noisy_reduction'][1] = 0.0


def _the_gain_of_the_paper(result: Any) -> None:
    result['gains']['nested_2']['noisy_reduction'][0] = 0.699


def _no_clean_gain(result: Any) -> None:
    result['gains']['nested_2']['clean_factor'][3] = 1.1


@pytest.mark.parametrize(
    'spoil', [_over_budget, _no_noisy_gain, _the_gain_of_the_paper, _no_clean_gain]
)
def test_another_verdict_is_named(spoil: Any, result: Result) -> None:
    spoilt = deepcopy(result)
    spoil(spoilt)
    (sentence,) = fair.SECTION.check(spoilt)
    assert sentence.startswith('fair: ')


def test_the_designs_are_in_the_ranges_and_in_the_file_as_dumped() -> None:
    designs = load_designs()
    assert read_yaml(dump_designs(designs)) == designs
    scenario = load_scenario()
    for name, candidate in BY_NAME.items():
        for aim in AIMS:
            for values in designs[name][aim]:
                settings = designed(scenario, name, values)
                assert settings.structure == name.rstrip('_1234')
                for key in set(candidate.tuned) & set(values):
                    low, high = RANGES[key]
                    assert 0.999 * low <= values[key] <= 1.001 * high


def test_the_scenario_has_the_designs_of_one_budget() -> None:
    scenario, designs = load_scenario(), load_designs()
    place = BUDGETS.index(BUDGET)
    for name in NAMES:
        settings = scenario.controllers[name]
        assert designed(scenario, name, designs[name]['noisy'][place]) == settings


def test_tuning_and_evaluation_share_no_seed() -> None:
    assert not set(retune.SEEDS) & set(range(fair.SEEDS))


@pytest.mark.parametrize('name', NAMES)
def test_a_point_becomes_settings(name: str) -> None:
    candidate = BY_NAME[name]
    point = [log10(RANGES[key][1]) for key in candidate.tuned] + [2.0] * (candidate.levels > 1)
    values = candidate.values(point)
    assert values['controller_bandwidth'] == RANGES['controller_bandwidth'][1]
    assert ('feedback_level' in values) == (candidate.levels > 1)
    if 'outer_share' in candidate.tuned:
        share = values['outer_bandwidth'] / values['inner_bandwidth']
        assert share == pytest.approx(RANGES['outer_share'][1], rel=1e-5)


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> Scenario:
    """Make the search a short one, over a short run, and return what is run."""
    scenario = attrs.evolve(load_scenario(), duration=4.0)
    monkeypatch.setattr(retune, 'load_scenario', lambda: scenario)
    monkeypatch.setattr(retune, 'BUDGETS', SHORT_BUDGETS)
    monkeypatch.setattr(retune, 'FIRST_POINTS', 64)
    monkeypatch.setattr(retune, 'GENERATIONS', 1)
    return scenario


def test_retune_finds_designs_within_the_budget_and_again_the_same(short: Scenario) -> None:
    chosen = [BY_NAME['conventional'], BY_NAME['nested_2']]
    shares: list[float] = []
    designs = retune.retune(shares.append, 2, chosen)
    assert designs == retune.retune(shares.append, 1, chosen)
    assert shares[7] == 1.0 and list(designs) == ['conventional', 'nested_2']
    for name, found in designs.items():
        for aim in AIMS:
            for budget, values in zip(SHORT_BUDGETS, found[aim]):
                runs = simulate_batch(
                    short.experiment,
                    [designed(short, name, values)],
                    retune.SEEDS,
                    compiled=True,
                )
                assert sum(run.isu for run in runs) / len(runs) <= budget


@pytest.mark.parametrize(
    ('name', 'simpler'), [('nonlinear_1', 'conventional'), ('nested_3', 'nested_2')]
)
def test_a_candidate_starts_from_a_simpler_one(name: str, simpler: str, short: Scenario) -> None:
    searches: dict[str, retune.Search] = {}
    for each in (simpler, name):
        search = searches[each] = retune.Search(BY_NAME[each], short, 2)
        search.start(searches.get(BY_NAME[each].simpler))
    for aim in AIMS:
        for budget in SHORT_BUDGETS:
            costs = [s.known[s.best(aim, budget)].cost(aim, budget) for s in searches.values()]
            assert costs[1] <= 1.05 * costs[0]


def test_a_score_over_the_budget_is_worse_than_any_within() -> None:
    good, bad, worse = (retune.Score(0.3, 0.2, isu) for isu in (7.9, 8.1, 800.0))
    assert (good.cost('noisy', 8.0), good.cost('clean', 8.0)) == (0.3, 0.2)
    assert good.cost('noisy', 8.0) < bad.cost('noisy', 8.0) < worse.cost('noisy', 8.0) < inf
    assert retune.Score().cost('clean', 8.0) < inf


def test_what_runs_away_has_no_score() -> None:
    scenario = load_scenario()
    wild = attrs.evolve(scenario.controllers['conventional'], controller_bandwidth=9e3)
    (score,) = retune.measured(scenario.experiment, [wild], 8.0, 1)
    assert score.isu > 1e6 and score.noisy_itae == inf


def test_every_candidate_has_a_look_and_what_it_contains_is_one() -> None:
    assert {candidate.simpler for candidate in CANDIDATES} <= {'', *NAMES}
    assert set(fair.LOOKS) == set(NAMES)
