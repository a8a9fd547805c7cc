"""A sweep: what varies, in which order, and what is refused before the first run."""

from __future__ import annotations

from pathlib import Path
import pickle
from typing import Any

from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.scenario import loads
from nadrc_ros.scenario.sweep import cell, load_sweep, run_range, Sweep
from nadrc_ros.simulation.batch import run_metrics
import pytest
import yaml

ROOT = Path(__file__).parents[1]
SCENARIO: dict[str, Any] = {
    'plant': 'paper',
    'reference': {'signal': 'cosine'},
    'rate': 100,
    'duration': 0.2,
    'controllers': {'conventional': {'structure': 'conventional'}, 'nested': None},
    'retune': [{'time': 0.1, 'inner_bandwidth': 20}],
}
PLANT = """
class Mine:
    order = 1
    states = 1
    b0 = 1.0

    def __init__(self, pole: float = 1.0, fails: float = 9.0):
        self.pole = pole
        self.fails = fails

    def derivative(self, t, x, u, w, dx):
        if self.fails < t < self.fails + 0.02:
            raise RuntimeError('broken')
        dx[0] = u + w - self.pole * x[0]

    def output(self, x):
        return x[0]
"""


def sweep(folder: Path, **more: Any) -> Sweep:
    path = folder / 'sweep.yaml'
    path.write_text(yaml.safe_dump({'scenario': SCENARIO, **more}, sort_keys=False))
    return load_sweep(path)


def with_plant(folder: Path, **values: Any) -> dict[str, Any]:
    (folder / 'mine.py').write_text(PLANT)
    scenario = {**SCENARIO, 'plant': {'file': 'mine.py', **values}}
    del scenario['retune']
    return scenario


def test_runs_go_through_the_grid_then_the_controllers_then_the_seeds(tmp_path: Path) -> None:
    found = sweep(tmp_path, vary={'plant.a3': [0.1, 0.2], 'rate': [100, 50]}, seeds=[7, 3])
    extent = found.check()
    assert extent.runs == 16 and extent.periods == 2 * 4 * (20 + 10)
    keys = [found.key(run) for run in range(extent.runs)]
    assert [(found.values(point), controller, seed) for point, controller, seed in keys] == [
        ({'plant.a3': a3, 'rate': rate}, controller, seed)
        for a3 in (0.1, 0.2)
        for rate in (100, 50)
        for controller in ('conventional', 'nested')
        for seed in (7, 3)
    ]


def test_a_run_is_that_of_the_scenario_with_the_values_written_in(tmp_path: Path) -> None:
    vary = {
        'plant.a3': [0.3],
        'controllers.nested.inner_bandwidth': [8],
        'limits.command_max': [5.0],
        'noise': [{'variance': 1e-4}],
        'retune[0].inner_bandwidth': [15],
    }
    found = sweep(tmp_path, vary=vary, seeds=2)
    by_hand = loads(
        yaml.safe_dump(
            {
                **SCENARIO,
                'plant': {'name': 'paper', 'a3': 0.3},
                'controllers': {
                    'conventional': {'structure': 'conventional'},
                    'nested': {'inner_bandwidth': 8},
                },
                'limits': {'command_max': 5.0},
                'noise': {'variance': 1e-4},
                'retune': [{'time': 0.1, 'inner_bandwidth': 15}],
            }
        )
    )
    assert found.at(0) == by_hand
    expected = [
        run_metrics(by_hand.experiment, settings, seed, False)
        for settings in by_hand.controllers.values()
        for seed in (0, 1)
    ]
    assert run_range(found, 0, 4, False) == expected
    assert run_range(pickle.loads(pickle.dumps(found)), 1, 3, False) == expected[1:3]
    assert found.scenario['controllers']['nested'] is None  # the file's own is left alone


def test_whole_plants_vary_too(tmp_path: Path) -> None:
    found = sweep(tmp_path, vary={'plant': ['paper', {'name': 'paper', 'a3': 0.0}]})
    assert found.at(0).plant.values == {} and found.at(1).plant.values == {'a3': 0.0}


def test_an_input_gain_that_was_left_out_follows_the_plant(tmp_path: Path) -> None:
    found = sweep(tmp_path, scenario={**SCENARIO, 'plant': 'chain'}, vary={'plant.gain': [2, 3]})
    assert [found.at(point).controllers['nested'].b0 for point in (0, 1)] == [2.0, 3.0]


def test_without_seeds_it_is_the_seed_of_the_scenario(tmp_path: Path) -> None:
    assert sweep(tmp_path).seeds == range(1)
    assert sweep(tmp_path, scenario={**SCENARIO, 'seed': 12}).seeds == (12,)
    assert sweep(tmp_path, seeds=3) == sweep(tmp_path, seeds=[0, 1, 2])
    assert tuple(sweep(tmp_path, seeds=3).seeds) == (0, 1, 2)
    assert sweep(tmp_path).check().runs == 2


def test_a_scenario_goes_by_name_and_a_file_beside_comes_first(tmp_path: Path) -> None:
    assert sweep(tmp_path, scenario='demo').check().runs == 2
    (tmp_path / 'demo').write_text(yaml.safe_dump(SCENARIO))
    assert sweep(tmp_path, scenario='demo').scenario == SCENARIO


@pytest.mark.parametrize(
    ('more', 'said'),
    [
        ({'vary': {'plant.a9': [1]}}, r'plant.a9: there is no such.*\(at plant.a9 = 1\)'),
        ({'vary': {'plant.a3': [0.1, 'x']}}, r"plant.a3 = 'x'.*\(at plant.a3 = x\)"),
        ({'vary': {'controllers.typo.b0': [1]}}, 'in controllers: there are conventional, nested'),
        ({'vary': {'controllers.nested.typo': [1]}}, r'controllers.nested.typo: there is no such'),
        ({'vary': {'controllers': [1]}}, 'the path of one controller'),
        ({'vary': {'retune[1].time': [1]}}, r'in retune: there are 0$'),
        ({'vary': {'retune.time': [1]}}, r'in retune: there are 0$'),
        ({'vary': {'rate.x': [1]}}, 'in rate: there are none'),
        ({'vary': {'[0]': [1]}}, r"vary = '\[0\]': must be a dotted path"),
        ({'vary': {'plant..a3': [1]}}, 'a dotted path'),
        ({'vary': {'seed': [1]}}, 'the seeds are given by seeds'),
        ({'vary': {'plant.a3': 0.1}}, r'vary.plant.a3 = 0.1: must be a list'),
        ({'vary': {'plant.a3': []}}, 'at least one value'),
        ({'vary': {'plant.a3': [1.0, 2.0, 1.0]}}, 'different values'),
        ({'vary': [1]}, 'a mapping of dotted paths'),
        ({'vary': {'nothing': [1]}}, 'nothing: there is no such key; did you mean noise'),
        ({'vary': {'rate': [0.0]}}, r'rate = 0.0: must be'),
        ({'seeds': 0}, 'seeds = 0'),
        ({'seeds': [1, 1]}, r'seeds = \[1, 1\]'),
        ({'seeds': [-1]}, 'seeds'),
        ({'seeds': True}, 'seeds = True'),
        ({'seeds': [2**63]}, 'an integer is too large'),
        ({'typo': 1}, 'typo: there is no such key; there are scenario, vary, seeds'),
        ({'scenario': 'nowhere'}, 'scenario nowhere: there is no such file'),
        ({'scenario': None}, 'scenario = None: must be the name'),
        ({'scenario': {**SCENARIO, 'controllers': {}}}, 'no controller'),
        ({'scenario': {**SCENARIO, 'controllers': 3}}, 'controllers = 3'),
    ],
)
def test_what_is_wrong_is_said_before_the_first_run(
    more: dict[str, Any], said: str, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match=said):
        sweep(tmp_path, **more).check()


def test_the_last_point_is_validated_as_well(tmp_path: Path) -> None:
    values = [*range(10, 40), 1e9]
    with pytest.raises(UserError, match=r'controllers.nested.inner_bandwidth = 1000000000.0'):
        sweep(tmp_path, vary={'controllers.nested.inner_bandwidth': values}).check()


def test_a_plant_that_fails_on_the_way_is_named_with_its_point(tmp_path: Path) -> None:
    found = sweep(tmp_path, scenario=with_plant(tmp_path), vary={'plant.fails': [9.0, 0.15]})
    assert found.check().files == (str(tmp_path / 'mine.py'),)
    assert len(run_range(found, 0, 2, False)) == 2
    with pytest.raises(UserError, match=r'mine.py, line 13: .*broken \(at plant.fails = 0.15\)'):
        run_range(found, 2, 3, False)


def test_the_description_tells_sweeps_apart_and_is_one_itself(tmp_path: Path) -> None:
    one = sweep(tmp_path, vary={'plant.a3': [0.1]}, seeds=2)
    text = one.describe(())
    (tmp_path / 'again.yaml').write_text('# a comment\n' + text)
    assert load_sweep(tmp_path / 'again.yaml') == one
    others = [
        sweep(tmp_path, vary={'plant.a3': [0.2]}, seeds=2),
        sweep(tmp_path, vary={'plant.a3': [0.1]}, seeds=3),
        sweep(tmp_path, vary={'plant.a3': [0.1]}, seeds=2, scenario={**SCENARIO, 'rate': 99}),
    ]
    assert text not in [other.describe(()) for other in others]
    found = sweep(tmp_path, scenario=with_plant(tmp_path))
    files = found.check().files
    before = found.describe(files)
    (tmp_path / 'mine.py').write_text(PLANT + '# another\n')
    assert found.describe(files) != before


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (10, '10'),
        (10.0, '10.0'),
        (1e-6, '1e-06'),
        (0.1 + 0.2, '0.30000000000000004'),
        (True, 'true'),
        ('nested', 'nested'),
        ('a\nb', r'"a\nb"'),
        ({'name': 'paper'}, '{"name": "paper"}'),
    ],
)
def test_a_value_is_one_line_in_a_table(value: Any, text: str) -> None:
    assert cell(value) == text


def test_the_shipped_sweeps_are_valid() -> None:
    paths = list((ROOT / 'config' / 'sweeps').glob('*.yaml'))
    assert paths
    for path in paths:
        extent = load_sweep(path).check()
        assert extent.runs > 50


def test_errors_survive_the_way_from_another_process() -> None:
    error = SettingError('a', 1, 'b')
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
