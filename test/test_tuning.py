"""The search for designs: what varies, what is constrained, what is taken, and that it repeats."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from math import log
from pathlib import Path
from threading import Event
from typing import Any

import attrs
from hypothesis import given
from hypothesis import strategies as st
from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.adrc.fields import build
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import loads, Scenario
from nadrc_ros.simulation.batch import run_metrics
from nadrc_ros.simulation.faults import CommandFault, Faults, MeasurementFault
from nadrc_ros.tuning.search.front import choose, front, knee, Point
from nadrc_ros.tuning.search.score import Figures, Judge, Score, with_gain
from nadrc_ros.tuning.search.settings import TuneSettings
from nadrc_ros.tuning.search.study import open_storage, run_studies, Trial, TuningStudy
from nadrc_ros.tuning.search.variables import designed, first_designs, values_of, variables
import pytest

SCENARIO = """
plant: {name: chain, order: 1, damping: 1, load: 2}
reference: {signal: step, amplitude: 1}
noise: {variance: 1e-4}
rate: 50
duration: 1
controllers:
  nested: {inner_bandwidth: 8, outer_bandwidth: 4, controller_bandwidth: 2}
"""
SETTINGS = ControllerSettings(inner_bandwidth=8.0, outer_bandwidth=4.0, controller_bandwidth=2.0)


def scenario(**changes: Any) -> Scenario:
    return attrs.evolve(loads(SCENARIO), **changes)


def judge(**tuning: Any) -> Judge:
    return Judge(scenario(), 'nested', build(TuneSettings, tuning), compiled=False)


def study(storage: Path, **tuning: Any) -> TuningStudy:
    one = judge(**{'population': 4, 'trials': 28, 'seeds': 2} | tuning)
    varied = variables(one.settings, one.tuning.vary, 50.0, 1.0, one.tuning.largest_wh)
    return TuningStudy(one, varied, open_storage(str(storage)), 'nested')


def found(study: TuningStudy, jobs: int = 1) -> list[Trial]:
    with ThreadPoolExecutor(jobs) as executor:
        run_studies([study], executor)
    return study.trials()


def test_a_table_of_b0_is_kept_and_scales_with_a_spread() -> None:
    settings = attrs.evolve(SETTINGS, b0_table=(0.0, 1.0, 2.0, 4.0))
    assert with_gain(settings, 2.0).b0_table == (0.0, 0.5, 2.0, 2.0)
    assert with_gain(SETTINGS, 2.0).b0_table == (0.0,)
    with pytest.raises(SettingError, match='b0_table'):
        variables(settings, {'b0': (0.5, 2.0)}, 100.0, 10.0, 0.3)
    judge = Judge(scenario(), 'nested', build(TuneSettings, {}), compiled=False)
    wrong = attrs.evolve(scenario().controllers['nested'], b0=1e3)
    right = judge.margins(scenario().controllers['nested'])
    assert judge.margins(wrong) != right
    assert judge.margins(attrs.evolve(wrong, b0_table=(0.0, 1.0, 2.0, 4.0))) == pytest.approx(
        right
    )


def names(**settings: Any) -> list[str]:
    varied = variables(attrs.evolve(SETTINGS, **settings), {}, 100.0, 10.0, 0.3)
    return [variable.name for variable in varied]


def test_what_varies_follows_structure_and_feedback() -> None:
    assert names(structure='conventional') == ['inner_bandwidth', 'controller_bandwidth']
    assert names() == ['inner_bandwidth', 'outer_share', 'controller_bandwidth', 'feedback_level']
    assert 'bandwidth_ratio' in names(levels=3)
    assert 'eso_delta' in names(structure='nonlinear')
    fal = names(structure='conventional', feedback='fal', fal_gains=(2.0, 3.0))
    assert fal == ['inner_bandwidth', 'fal_gains[0]', 'fal_gains[1]']


@pytest.mark.parametrize(
    ('wanted', 'said'),
    [
        ({'speed': (1.0, 2.0)}, 'vary.speed: there is no such key; there are b0'),
        ({'b0': (-1.0, 2.0)}, 'without 0'),
        ({'inner_bandwidth': (1.0, 1e9)}, r'from 1e-09 to 1e\+06'),
        ({'feedback_level': (1.0, 3.0)}, 'levels from 1 to 2'),
        ({'fal_gains[0]': ()}, 'given a range'),
    ],
)
def test_what_cannot_vary_is_refused(wanted: dict[str, Any], said: str) -> None:
    with pytest.raises(SettingError, match=said):
        variables(SETTINGS, wanted, 100.0, 10.0, 0.3)


@pytest.mark.parametrize(
    'tuning',
    [
        {'budget': -1.0},
        {'seeds': 0},
        {'sampler': 'pso'},  # finds no front
        {'vary': {'b0': [2.0, 1.0]}},
        {'b0_spread': [-1.0, 1.0]},
        {'plant': {'load': ['a', 1.0]}},
        {'trails': 5},
    ],
)
def test_settings_that_make_no_sense_are_refused(tuning: dict[str, Any]) -> None:
    with pytest.raises(SettingError):
        build(TuneSettings, tuning)


@given(st.floats(1.0, 20.0), st.floats(0.1, 1.5), st.floats(0.5, 20.0), st.integers(1, 2))
def test_a_design_is_what_its_file_shows(
    inner: float, share: float, wc: float, level: int
) -> None:
    varied = variables(SETTINGS, {}, 100.0, 10.0, 0.3)
    values = dict(zip([v.name for v in varied], (inner, share, wc, level)))
    again = values_of(designed(SETTINGS, values), varied)
    assert again == pytest.approx(values, rel=1e-5)


def test_rules_propose_the_controller_itself_first_and_stay_in_range() -> None:
    varied = variables(SETTINGS, {}, 100.0, 10.0, 0.3)
    designs = first_designs(SETTINGS, varied, 20)
    assert designs[0] == values_of(SETTINGS, varied)
    for design in designs:
        assert all(v.low <= design[v.name] <= v.high for v in varied)


@pytest.mark.parametrize('gain', [0.5, 3.0])
def test_a_spread_of_b0_is_a_plant_of_other_gain(gain: float) -> None:
    settings = scenario().controllers['nested']
    text = SCENARIO.replace('damping: 1', f'damping: 1, gain: {gain}').replace(
        'nested: {', f'nested: {{b0: {settings.b0}, '
    )
    truly = run_metrics(loads(text).experiment, settings, 5, False)
    scaled = run_metrics(scenario().experiment, with_gain(settings, gain), 5, False)
    assert scaled.itae == pytest.approx(truly.itae, rel=1e-9)
    assert scaled.isu / gain**2 == pytest.approx(truly.isu, rel=1e-9)


def test_the_worst_corner_counts() -> None:
    values = {'inner_bandwidth': 8.0}
    alone = judge(seeds=2).score(values).figures
    spread = judge(seeds=2, b0_spread=[0.5, 2.0], plant={'load': [1.0, 4.0]})
    assert len(spread.corners) == 5
    worst = spread.score(values).figures
    assert alone is not None and worst is not None
    assert worst.objective > alone.objective and worst.isu > alone.isu


def test_without_noise_the_objective_is_of_one_quiet_run_and_the_effort_of_the_noisy_ones() -> (
    None
):
    values = {'inner_bandwidth': 8.0}
    quiet_plant = scenario(noise=attrs.evolve(scenario().noise, variance=0.0))
    quiet = (
        Judge(quiet_plant, 'nested', build(TuneSettings, {}), compiled=False).score(values).figures
    )
    noisy = judge(seeds=4).score(values).figures
    mixed = judge(seeds=4, noise_free=True).score(values).figures
    assert quiet is not None and noisy is not None and mixed is not None
    assert mixed == Figures(quiet.objective, noisy.isu)
    assert mixed.objective != noisy.objective and mixed.isu != quiet.isu
    budget = 0.5 * (quiet.isu + noisy.isu)
    over = judge(seeds=4, noise_free=True, budget=budget).score(values)
    assert over.violations.keys() == {'budget'}


@pytest.mark.parametrize(
    ('tuning', 'name'),
    [
        ({'gain_margin': 900.0}, 'gain_margin'),
        ({'modulus_margin': 1.0}, 'modulus_margin'),
        ({'delay_margin': 1000.0}, 'delay_margin'),
        ({'largest_wh': 0.01}, 'largest_wh'),
        ({'peak': 0.5}, 'peak'),
        ({'budget': 1e-3}, 'budget'),
    ],
)
def test_every_constraint_can_fail_a_design(tuning: dict[str, Any], name: str) -> None:
    score = judge(seeds=2, **tuning).score({'inner_bandwidth': 8.0})
    assert score.violations.keys() == {name} and score.violations[name] > 0.0


def test_a_known_delay_counts_in_the_margins() -> None:
    own, late = judge(), MeasurementFault(kind='delayed', time=0.04)
    for fault, lost in ((late, 0.04), (attrs.evolve(late, duration=0.1), 0.0)):
        delayed = scenario(faults=Faults(measurement=(fault,)))
        found = Judge(delayed, 'nested', build(TuneSettings, {}), compiled=False).margins(
            own.settings
        )
        assert found.delay == pytest.approx(own.margins(own.settings).delay - lost)


def test_a_delay_of_the_plant_counts_and_so_does_that_the_law_knows_it() -> None:
    at_once, late = (
        judge(),
        Judge(
            attrs.evolve(judge().scenario, input_delay=0.043),
            'nested',
            build(TuneSettings, {}),
            compiled=False,
        ),
    )
    ignorant = attrs.evolve(
        late.settings, inner_bandwidth=8.0, outer_bandwidth=8.0, controller_bandwidth=2.0
    )
    told = attrs.evolve(ignorant, input_delay=0.043)
    assert late.margins(ignorant).modulus < at_once.margins(ignorant).modulus
    assert late.margins(told).modulus > 1.05 * late.margins(ignorant).modulus


def test_a_delay_is_in_the_margins_as_it_is_simulated_in_whole_periods() -> None:
    faults = Faults(measurement=(MeasurementFault(kind='delayed', time=0.03),))
    one = Judge(scenario(faults=faults), 'nested', build(TuneSettings, {}), compiled=False)
    assert one.scenario.rate == 50.0
    left = judge().margins(judge().settings).delay - 0.04
    assert one.margins(one.settings).delay == pytest.approx(left)


def test_the_rate_limit_of_an_actuator_is_counted_in_its_own_unit() -> None:
    faults = Faults(command=(CommandFault(kind='rate_limited', size=20.0),))
    spread = build(TuneSettings, {'b0_spread': [0.5, 2.0]})
    one = Judge(scenario(faults=faults), 'nested', spread, compiled=False)
    sizes = [(corner.gain, corner.experiment.faults.command[0].size) for corner in one.corners]
    assert sizes == [(1.0, 20.0), (0.5, 10.0), (2.0, 40.0)]


def test_a_negative_b0_can_vary(tmp_path: Path) -> None:
    plant = attrs.evolve(loads(SCENARIO).plant, values={'order': 1, 'gain': -2.0})
    one = Judge(scenario(plant=plant), 'nested', build(TuneSettings, {}), compiled=False)
    values = {'b0': (-4.0, -1.0)}
    one.settings = attrs.evolve(one.settings, b0=-2.0)
    one.tuning = build(TuneSettings, {'vary': values, 'population': 4, 'trials': 20, 'seeds': 1})
    varied = variables(one.settings, values, 50.0, 1.0, 0.3)
    trials = found(TuningStudy(one, varied, open_storage(str(tmp_path / 's')), 'nested'))
    assert all(-4.0 <= trial.values['b0'] <= -1.0 for trial in trials)


def test_a_design_within_the_peak_runs_as_if_there_were_none() -> None:
    values = {'inner_bandwidth': 8.0}
    assert judge(peak=50.0).score(values) == judge().score(values)


def test_a_command_at_a_limit_of_the_scenario_is_within_a_peak_beyond_it() -> None:
    one = judge(peak=5.0)
    one.settings = attrs.evolve(one.settings, command_max=0.5)
    score = one.score({'inner_bandwidth': 8.0})
    assert score.figures is not None and not score.violations


def test_a_peak_is_graded_by_the_largest_command_in_the_unit_of_the_plant() -> None:
    values = {'inner_bandwidth': 8.0}
    corner = judge().corners[0]
    largest = run_metrics(corner.experiment, designed(judge().settings, values), 1001).max_command
    score = judge(seeds=1, peak=largest / 2.0).score(values)
    assert score.violations == {'peak': pytest.approx(log(2.0))}
    half = judge(seeds=1, peak=largest / 2.0, b0_spread=[0.5, 1.0]).score(values)
    assert log(2.0) < half.violations['peak'] < log(8.0)  # half the plant asks for more command
    safe = judge(peak=0.5)
    safe.settings = attrs.evolve(safe.settings, safe_command=1.0)
    assert safe.score(values).violations.keys() == {'peak'}


def test_what_the_law_refuses_is_not_run() -> None:
    assert 'settings' in judge().score({'inner_bandwidth': 1e9}).violations


def trial(objective: float, isu: float, **violations: float) -> Trial:
    return Trial({}, Score(figures=Figures(objective, isu), violations=violations))


@given(st.lists(st.tuples(st.floats(1.0, 9.0), st.floats(1.0, 9.0)), min_size=1))
def test_no_design_beats_one_of_the_front(pairs: list[tuple[float, float]]) -> None:
    points = front([trial(*pair) for pair in pairs])
    assert points
    for point in points:
        assert not any(
            Figures(*pair).beats(point.figures) and Figures(*pair) != point.figures
            for pair in pairs
        )


def test_a_design_that_violates_anything_is_not_in_the_front() -> None:
    assert front([trial(1.0, 1.0, peak=0.1), trial(2.0, 2.0)]) == [Point({}, Figures(2.0, 2.0))]


def test_the_knee_is_where_more_effort_begins_to_buy_little() -> None:
    points = front([trial(8.0, 1.0), trial(2.0, 2.0), trial(1.1, 4.0), trial(1.0, 100.0)])
    assert knee(points) == 2
    assert choose(points, 0.0, None, None).index == 2
    assert choose(points, 0.0, 3.0, None).index == 1
    assert choose(points, 0.0, None, 4).index == 3
    for isu, number in ((0.5, None), (None, 5)):
        with pytest.raises(UserError):
            choose(points, 0.0, isu, number)


def test_a_front_without_a_knee_gives_the_least_objective() -> None:
    points = front([trial(8.0, 1.0), trial(7.0, 1.01), trial(1.0, 1.02)])
    assert knee(points) == 2


SEARCHES = [{}, {'budget': 60.0}, {'budget': 60.0, 'sampler': 'pso'}]


@pytest.mark.parametrize('tuning', SEARCHES, ids=['nsga2', 'cmaes', 'pso'])
def test_any_number_of_cores_finds_the_same(tuning: dict[str, Any], tmp_path: Path) -> None:
    first = found(study(tmp_path / 'a', **tuning), jobs=1)
    assert len(first) == 28
    assert found(study(tmp_path / 'b', **tuning), jobs=3) == first
    assert found(study(tmp_path / 'c', **tuning, seed=1)) != first


def test_studies_that_run_in_turn_find_what_each_finds_alone(tmp_path: Path) -> None:
    cases: list[dict[str, Any]] = [{}, {'trials': 20, 'seed': 1}]
    alone = [found(study(tmp_path / str(i), **case)) for i, case in enumerate(cases)]
    together = [study(tmp_path / 'both', **case) for case in cases]
    told: list[int] = []
    with ThreadPoolExecutor(3) as executor:
        run_studies(together, executor, lambda known, best: told.append(known))
    assert [one.trials() for one in together] == alone
    assert told == list(range(1, 49))


def test_a_design_that_fails_ends_all_studies(tmp_path: Path) -> None:
    one, other = study(tmp_path / 'a'), study(tmp_path / 'b')
    scored: list[object] = []
    failed = Event()

    def slow(values: object, better: object) -> Score:
        scored.append(values)
        failed.wait()
        return Score(violations={'peak': 1.0})

    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(1) as executor:
        patch.setattr(one.judge, 'score', lambda values, better: 1 / 0)
        patch.setattr(other.judge, 'score', slow)
        with pytest.raises(ZeroDivisionError):
            run_studies([one, other], executor)
        failed.set()
    assert len(scored) <= 1  # what was under way


@pytest.mark.parametrize('tuning', SEARCHES, ids=['nsga2', 'cmaes', 'pso'])
def test_an_interrupted_study_ends_the_same(tuning: dict[str, Any], tmp_path: Path) -> None:
    whole = study(tmp_path / 'a', **tuning)
    expected = found(whole)
    for kept in (3, 16, 22):
        part = study(tmp_path / str(kept), **tuning)
        part.stored.add_trials(whole.stored.trials[:kept])
        assert found(part) == expected


def test_more_trials_go_on_and_other_settings_start_anew(tmp_path: Path) -> None:
    first = found(study(tmp_path / 'a', trials=20))
    assert found(study(tmp_path / 'a'))[:20] == first
    assert study(tmp_path / 'a', seeds=1).done == 0


def test_two_machines_share_a_study(tmp_path: Path) -> None:
    one, two = study(tmp_path / 'a', trials=60), study(tmp_path / 'a', trials=60)
    two.worker = 1
    with ThreadPoolExecutor(2) as both, ThreadPoolExecutor(2) as executor:
        for future in [both.submit(run_studies, [s], executor) for s in (one, two)]:
            future.result()
    workers = [t.user_attrs['worker'] for t in one.stored.trials]
    assert set(workers) == {0, 1} and one.done >= 60


@pytest.fixture
def better(tmp_path: Path) -> Iterator[list[Trial]]:
    yield found(study(tmp_path / 'a', budget=60.0, trials=44))


def test_a_search_improves_on_the_controller_it_was_given(better: list[Trial]) -> None:
    own = judge(budget=60.0, seeds=2).score({}).figures
    best = front(better)[-1].figures
    assert own is not None and best.objective < own.objective and best.isu <= 60.0


def test_defaults_are_declared() -> None:
    assert TuneSettings().method == 'nsga2' and TuneSettings(budget=1.0).method == 'cmaes'
