"""A scenario file means one thing, survives a round trip, and is refused with its reason."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
import re

from hypothesis import given, settings
from hypothesis import strategies as st
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.scenario import (
    dump,
    find_scenario,
    load,
    loads,
    PlantSpec,
    ScenarioError,
    SignalSpec,
)
from nadrc_ros.scenario.files import shipped_scenarios
from nadrc_ros.simulation.experiment import Retune
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plants import PLANTS
import numpy as np
import pytest

# A run of so many periods is simulated to its end, of a longer one the first seconds.
WHOLE = 10_000
ENOUGH = 5.0
CONFIG = sorted((Path(__file__).parents[1] / 'config').glob('*.yaml'))

FULL = """
plant: {name: paper, a3: 0.3, initial_state: [1, 0]}
reference: {signal: cosine, frequency: 0.5}
disturbance: decaying_cosine
noise: {variance: 1e-4, sample_time: 0.005}
seed: 7
rate: 100
duration: 4
error: tracking
limits: {command_min: -20, command_max: 30}
controllers:
  conventional: {structure: conventional, command_max: 10}
  nested:
retune:
- {time: 2, inner_bandwidth: 20, pole_ratios: [1]}
- {time: 1, b0: 2}
settle_time: 0.5
"""
SHORT = 'plant: chain\nreference: none\ncontrollers: {it: }\n'


def refused(text: str) -> str:
    with pytest.raises((SettingError, ScenarioError)) as caught:
        loads(text)
    message = str(caught.value)
    assert '\n' not in message
    return message


def replaced(old: str, new: str) -> str:
    assert FULL.count(old) == 1
    return FULL.replace(old, new)


def test_every_key_arrives() -> None:
    scenario = loads(FULL)
    assert scenario.plant == PlantSpec(name='paper', values={'a3': 0.3})
    assert scenario.initial_state == (1.0, 0.0)
    assert scenario.reference == SignalSpec(name='cosine', values={'frequency': 0.5})
    assert scenario.disturbance == SignalSpec(name='decaying_cosine')
    assert scenario.noise == Noise(variance=1e-4, sample_time=0.005, seed=7)
    assert (scenario.rate, scenario.duration, scenario.error) == (100.0, 4.0, 'tracking')
    assert scenario.settle_time == 0.5
    conventional, nested = scenario.controllers.values()
    assert (conventional.structure, conventional.command_max) == ('conventional', 10.0)
    assert (nested.structure, nested.command_min, nested.command_max) == ('nested', -20.0, 30.0)
    assert scenario.retunes == (
        Retune(time=1.0, settings={'b0': 2.0}),
        Retune(time=2.0, settings={'inner_bandwidth': 20.0, 'pole_ratios': (1.0,)}),
    )


def test_the_experiment_is_the_scenario() -> None:
    experiment = loads(FULL).experiment
    assert experiment.plant == PLANTS['paper'](a3=0.3)  # type: ignore[call-arg]
    assert experiment.initial_state == (1.0, 0.0)
    assert (experiment.steps, experiment.noise.seed, experiment.error) == (400, 7, 'tracking')
    assert len(experiment.retunes) == 2
    w = [0.0]
    experiment.disturbance.derivatives(0.0, w)
    assert w == [1.0]


def test_what_is_left_out_comes_from_the_plant_or_is_the_default() -> None:
    scenario = loads('plant: pendulum\nreference: none\ncontrollers: {it: {}}')
    settings = scenario.controllers['it']
    assert (settings.plant_order, settings.b0) == (2, 4.0)
    assert scenario.initial_state == (0.0, 0.0)
    assert scenario.disturbance == SignalSpec(name='none')
    assert loads(SHORT).noise == Noise()


def test_a_key_without_a_value_is_left_out() -> None:
    assert loads(SHORT + 'retune:\nnoise:\nlimits:\n') == loads(SHORT)


def test_faults_arrive_and_are_dumped_again() -> None:
    measurement = '[{kind: not_a_number, start: 1}, {kind: bias}]'
    scenario = loads(f'{SHORT}faults: {{measurement: {measurement}, command: [{{kind: gain}}]}}')
    first, second = scenario.faults.measurement
    assert (first.kind, first.start, second.kind) == ('not_a_number', 1.0, 'bias')
    assert [fault.kind for fault in scenario.faults.command] == ['gain']
    assert scenario.experiment.faults == scenario.faults
    assert loads(dump(scenario)) == scenario


def test_b0_of_a_controller_may_differ_from_the_plant() -> None:
    scenario = loads(SHORT.replace('{it: }', '{it: {b0: 3}}'))
    assert scenario.controllers['it'].b0 == 3.0


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        (
            'disturbance:',
            'fault:',
            r'fault: there is no such key; did you mean faults\?$',
        ),
        ('disturbance:', 'faults:', r"faults = 'decaying_cosine': must be a mapping"),
        (
            'seed: 7',
            'faults: {clock: []}',
            r'faults\.clock: there is no such key; .*measurement',
        ),
        ('seed: 7', 'faults: {command: 3}', r'faults\.command = 3: must be a list'),
        (
            'seed: 7',
            'faults: {measurement: [{}, {kind: spick}]}',
            r"faults\.measurement\[1\]\.kind = 'spick': must be one of none, silent",
        ),
        ('variance: 1e-4', 'varianze: 1', r'noise\.varianze: .* did you mean variance\?'),
        (
            'variance: 1e-4',
            'signal: sine, varianze: 1',
            r'noise\.varianze: .* frequency.*; of the random noise variance, .*$',
        ),
        ('variance: 1e-4', 'variance: -1', r'noise\.variance = -1\.0: must be a finite number'),
        ('seed: 7', 'feed_forward: sine', r"^feed_forward = 'sine': .* none listens to it"),
        ('seed: 7', 'seed: -7', r'^seed = -7: must be an integer'),
        ('seed: 7', 'seed: 1.5', r'^seed = 1\.5: must be an integer'),
        ('rate: 100', 'rate: fast', r"^rate = 'fast': must be a finite number"),
        ('rate: 100', 'rate: .nan', r'^rate = nan: must be a finite number'),
        ('duration: 4', 'duration: 0', r'^duration = 0\.0: must be'),
        (
            'settle_time: 0.5',
            'settle_time: 4',
            r'^settle_time = 4\.0: must be at most 3\.99 s',
        ),
        ('error: tracking', 'error: both', r"^error = 'both': must be one of reference, tracking"),
        ('name: paper', 'name: papper', r"plant\.name = 'papper': must be one of paper, chain"),
        ('name: paper', 'nam: paper', r'plant needs either a name, one of paper, .* or a file'),
        ('a3: 0.3', 'a4: 0.3', r'plant\.a4: there is no such key; .*there are a1, a2, a3'),
        ('a3: 0.3', 'a3: 5', r'plant\.a3 = 5\.0: must be a finite number from -0\.9 to 0\.9'),
        ('a3: 0.3', 'class: X', r"plant\.class = 'X': must be left out"),
        ('[1, 0]', '[1]', r'plant\.initial_state = \[1\]: must be a list of 2 finite numbers'),
        ('[1, 0]', '[1, .inf]', r'plant\.initial_state = '),
        ('[1, 0]', '[1, true]', r'plant\.initial_state = '),
        ('[1, 0]', '1', r'plant\.initial_state = 1: must be a list'),
        ('[1, 0]', '[1, 0], input_delay: -1', r'plant\.input_delay = -1: must be a finite'),
        ('[1, 0]', '[1, 0], input_delay: x', r'plant\.input_delay = '),
        ('[1, 0]', '[1, 0], input_delay: 1e6', r'plant\.input_delay = .* at most \d+ s, a mill'),
        ('signal: cosine', 'signal: cos', r"reference\.signal = 'cos': must be one of none, con"),
        ('signal: cosine', 'signal: 3', r'reference\.signal = 3: must be the name of a signal'),
        (
            'frequency:',
            'decay:',
            r'reference\.decay: there is no such key; there are of',
        ),
        ('decaying_cosine', '[1]', r'disturbance = \[1\]: must be a mapping'),
        ('command_min: -20', 'command: 1', r'limits\.command: there is no such key'),
        ('command_min: -20', 'command_min: x', r"limits\.command_min = 'x': must be a finite num"),
        ('command_min: -20', 'command_min: 40', r'limits\.command_min = 40: must be below'),
        ('structure: conventional', 'structure: esop', r'controllers\.conventional\.structure = '),
        (
            'structure: conventional',
            'w0: 4',
            r'controllers\.conventional\.w0: there is no such key',
        ),
        (
            'command_max: 10',
            'command_max: -50',
            r'controllers\.conventional\.command_min = -20\.0',
        ),
        (
            'command_max: 10',
            'plant_order: 1',
            r'controllers\.conventional\.plant_order = 1: must ',
        ),
        ('  nested:', '  2nested:', r"controllers = '2nested': must be named by letters"),
        ('  nested:', '  a/b:', r"controllers = 'a/b': must be named by letters"),
        (
            '  nested:',
            '  on:',
            r'controllers\.True = None: must be left out: a key is a word, in q',
        ),
        ('  nested:', '  nested: 5', r'controllers\.nested = 5: must be a mapping'),
        ('time: 2,', '', r'retune\[0\]\.time is missing'),
        ('time: 2,', 'time: 4,', r'retune\[0\]\.time = 4\.0: must be .* from 0 to 3\.99 s'),
        ('time: 2,', 'time: -1,', r'retune\[0\]\.time = -1\.0: must be'),
        (
            'inner_bandwidth: 20',
            'inner_bandwidth: 0',
            r'retune\[0\]\.inner_bandwidth = 0\.0: must',
        ),
        (
            'inner_bandwidth: 20',
            'w0: 3',
            r'retune\[0\]\.w0: there is no such key',
        ),
        ('inner_bandwidth: 20', 'plant_order: 2', r'plant_order = 2: .* it is fixed at the start'),
        (', b0: 2', '', r'retune\[1\] changes nothing'),
        ('b0: 2', 'command_max: -30', r'retune\[1\]\.command_min = .* \(with controllers\.conven'),
    ],
)
def test_what_is_wrong_is_named_by_its_path(old: str, new: str, message: str) -> None:
    assert re.search(message, refused(replaced(old, new)))


@pytest.mark.parametrize('key', ['plant', 'reference', 'controllers'])
def test_a_missing_key_is_named(key: str) -> None:
    lines = [line for line in SHORT.splitlines() if not line.startswith(key)]
    assert f'the key {key} is missing' in refused('\n'.join(lines))


def test_a_strange_key_does_not_break_the_line() -> None:
    assert refused(SHORT + '"ra\\nte": 1').startswith("'ra\\nte' = 1: must be left out: a key is")
    assert refused(SHORT + '1: 2').startswith('1 = 2: must be left out: a key is a word')
    assert refused(SHORT + 'limits: {"a\\nb": 2}').startswith("limits.'a\\nb' = 2: must be")


def test_a_launcher_finds_numbers_where_the_node_wants_numbers() -> None:
    scenario = loads(replaced('a3: 0.3', 'a3: 0, a1: 1').replace('frequency: 0.5', 'frequency: 2'))
    values = [*scenario.plant.values.values(), *scenario.reference.values.values()]
    assert [type(value) for value in values] == [float] * 3
    assert type(scenario.retunes[0].settings['b0']) is float


def test_at_least_one_controller() -> None:
    assert 'at least one' in refused(SHORT.replace('{it: }', '{}'))


def test_retunes_are_judged_together_in_order_of_time() -> None:
    # Each is valid only on top of the other one.
    both = 'retune: [{time: 2, command_min: 150}, {time: 1, command_max: 200, safe_command: 160}]'
    assert len(loads(SHORT + both).retunes) == 2
    assert 'retune[0].command_min' in refused(SHORT + both.replace('time: 1', 'time: 3'))


# ---- YAML -------------------------------------------------------------------------------------


@pytest.mark.parametrize('text', ['1e-4', '1E-4', '+1e-4', '0.1e-3', '.1e-3', '1.e-4', '1e-04'])
def test_an_exponent_needs_no_decimal_point(text: str) -> None:
    assert loads(replaced('variance: 1e-4', f'variance: {text}')).noise.variance == 1e-4


def test_a_key_given_twice_is_named_with_both_lines() -> None:
    message = refused(replaced('  nested:', '  conventional:'))
    assert message == "line 13: the key 'conventional' was given before, in line 12"
    assert "'rate' was given before, in line 7" in refused(FULL + 'rate: 3\n')


def test_a_merge_key_may_be_overridden() -> None:
    scenario = loads(
        SHORT.replace('{it: }', '\n  a: &a {b0: 2, outer_bandwidth: 9}\n  b: {<<: *a, b0: 3}')
    )
    assert [s.b0 for s in scenario.controllers.values()] == [2.0, 3.0]
    assert scenario.controllers['b'].outer_bandwidth == 9.0


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'there is nothing in it'),
        ('# only a comment', 'there is nothing in it'),
        ('- plant', 'this is a list'),
        ('paper', 'this is a single value'),
        ('plant: [1, 2', r'^line 1, column \d+: not YAML: '),
        ('plant:\n\tx: 1', r'^line 2, column 1: not YAML: .*cannot start any token'),
        ('a: 1\n---\nb: 2', r'^line 2, column 1: not YAML: but found another document'),
        ('plant: !!python/name:os.system x', r'line 1, column 8: not YAML: could not determine'),
        ('plant: *nowhere', r'line 1, column 8: not YAML: found undefined alias'),
        ('plant: 2024-13-45', r'not YAML: month must be'),
        ('plant: \0', r'not YAML: '),
        ('rate: 1' + '0' * 400, r'line 1: an integer is too large'),
        ('rate: 1' + '0' * 5000, r'not YAML: .*digits'),
        ('[' * 5000, r'nested too deeply'),
        ('{[1]: 2}', r'line 1, column 2: not YAML: found unhashable key'),
    ],
)
def test_what_is_no_yaml_mapping_is_refused_in_one_sentence(text: str, message: str) -> None:
    assert re.search(message, refused(text))


@settings(max_examples=300)
@given(st.data())
def test_no_damage_to_a_file_gives_another_exception(data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(FULL)))
    length = data.draw(st.integers(0, 12))
    noise = data.draw(st.text(alphabet='{}[]:,-&*!?|>%@`\'"# \n\t019.eaz~<', max_size=4))
    try:
        loads(FULL[:at] + noise + FULL[at + length :])
    except (SettingError, ScenarioError) as error:
        assert '\n' not in str(error)


# ---- files ------------------------------------------------------------------------------------


def test_a_file_that_cannot_be_read_says_why(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match='No such file'):
        load(tmp_path / 'nothing.yaml')
    with pytest.raises(ScenarioError, match='a directory'):
        load(tmp_path)
    (tmp_path / 'latin.yaml').write_bytes('# Größe'.encode('latin-1'))
    with pytest.raises(ScenarioError, match='not UTF-8'):
        load(tmp_path / 'latin.yaml')
    with pytest.raises(ScenarioError, match='null byte'):
        load('a\0b')


def test_a_shipped_scenario_is_found_by_name_but_a_file_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_scenario('paper').name == 'paper.yaml'
    (tmp_path / 'demo').mkdir()
    assert find_scenario('demo').name == 'demo.yaml'
    (tmp_path / 'paper').write_text(SHORT)
    assert find_scenario('paper') == Path('paper')
    with pytest.raises(ScenarioError, match=r'no such file, .* paper, .*pendulum'):
        find_scenario('papper')
    with pytest.raises(ScenarioError, match='a directory'):
        find_scenario(str(tmp_path))


def test_the_shipped_scenarios_are_those_of_the_source_tree() -> None:
    assert list(shipped_scenarios()) == [path.stem for path in CONFIG]
    assert {'paper', 'demo', 'motor_speed', 'pendulum', 'chain'} <= set(shipped_scenarios())


@pytest.mark.parametrize('path', CONFIG, ids=lambda path: path.stem)
def test_a_shipped_scenario_runs_well(path: Path) -> None:
    scenario = load(path)
    assert loads(dump(scenario)) == scenario
    if scenario.experiment.steps > WHOLE:
        scenario = scenario.changed(duration=min(scenario.duration, ENOUGH))
    for name, controller in scenario.controllers.items():
        result = scenario.run(name)
        late = result.time > 0.8 * scenario.duration
        assert np.isfinite(result.output).all()
        assert controller.command_min <= result.command.min()
        assert result.command.max() <= controller.command_max
        assert all(v is not None and isfinite(v) for v in result.metrics.as_dict().values())
        assert result.metrics.saturated_fraction < 0.05
        # A calibrated scenario follows the lagging profile of its tracking differentiator.
        followed = result.reference if scenario.error == 'reference' else result.tracking
        share = 0.1 if path.stem.startswith('paper_') else 0.03
        assert np.abs(followed - result.output)[late].max() < share * np.ptp(result.reference)


def test_the_demo_shows_that_nesting_wins() -> None:
    scenario = load(find_scenario('demo'))
    conventional, nested = (scenario.run(name).metrics for name in scenario.controllers)
    assert nested.itae < 0.6 * conventional.itae
    assert nested.peak_error < 0.6 * conventional.peak_error
