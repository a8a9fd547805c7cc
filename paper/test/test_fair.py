"""The fair comparison: its committed designs with few seeds, and the commands that made them."""

from __future__ import annotations

from copy import deepcopy
from itertools import pairwise
import json
import re
from typing import Any

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.report.style import render
from nadrc_ros.scenario import find_scenario, load, loads
from nadrc_ros.tuning.search.score import FIRST_SEED
from paper import fair
from paper.fair import AIMS, BUDGETS
from paper.section import Result
import pytest

SEEDS = 2
NAMES = list(fair.LABELS)
BUDGET = 20.0
SCRIPT = fair.DESIGNS / 'tune.sh'


@pytest.fixture(scope='module')
def result() -> Result:
    shares: list[float] = []
    found = fair.measure(shares.append, 2, SEEDS)
    assert shares == sorted(shares)
    back: Result = json.loads(json.dumps(found, allow_nan=False))
    assert back == found
    return back


def test_every_candidate_has_a_design_for_every_aim_and_budget(result: Result) -> None:
    assert list(result['candidates']) == NAMES
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
    names = ('conventional', 'cascade_2')
    monkeypatch.setattr(fair, 'LABELS', {name: fair.LABELS[name] for name in names})
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


def test_every_design_is_of_the_same_experiment_and_of_the_same_observers() -> None:
    given = load(find_scenario('paper_fair'))
    assert list(given.controllers) == NAMES == list(fair.LOOKS)
    for aim in AIMS:
        for budget in BUDGETS:
            tuned = load(fair.design_file(aim, budget))
            assert attrs.evolve(tuned, controllers=given.controllers) == given
            for name, own in tuned.controllers.items():
                assert own.structure == given.controllers[name].structure == name.rstrip('_1234')
                assert own.levels == given.controllers[name].levels


def test_the_shipped_scenario_has_the_designs_of_one_budget() -> None:
    tuned = load(fair.design_file('noisy', BUDGET))
    assert load(find_scenario('paper_fair')).controllers == tuned.controllers


def test_tuning_and_evaluation_share_no_seed() -> None:
    assert fair.SEEDS <= FIRST_SEED


def test_the_commands_tune_every_observer_for_every_aim_and_budget() -> None:
    text = SCRIPT.read_text()
    assert f'for budget in {" ".join(format(budget, "g") for budget in BUDGETS)}; do' in text
    assert all(f'\ntuned {aim}' in text for aim in AIMS)
    assert all(name in text for name in NAMES)


def test_what_was_found_is_not_what_the_search_starts_from() -> None:
    pattern = re.search('^numbers="(.*)"$', SCRIPT.read_text(), re.MULTILINE)
    assert pattern is not None
    text = find_scenario('paper_fair').read_text().splitlines()
    start = loads('\n'.join(line for line in text if not re.match(pattern[1], line)))
    usual = ControllerSettings(command_min=-1e6, command_max=1e6)
    for name in NAMES:
        own = attrs.asdict(start.controllers[name])
        given = {key for key, value in own.items() if value != getattr(usual, key)}
        assert given <= {'structure', 'levels', 'extended_states', 'feedback_level'}
        assert own['feedback_level'] in ('inner', 'outer')
