"""Signals of the user's: a class in a file or a column of a CSV file, wherever a signal may be."""

from __future__ import annotations

from math import exp
from pathlib import Path
import re
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.scenario import dump, load, loads, Scenario, SignalSpec
from nadrc_ros.scenario.sweep import load_sweep
from nadrc_ros.simulation.kernel import kernel_for
from nadrc_ros.simulation.protocols import Signal
from nadrc_ros.simulation.simulate import simulate
import numpy as np
import pytest
from scipy import signal

EXAMPLES = Path(__file__).parents[1] / 'examples'
PAGE = (EXAMPLES.parent / 'docs' / 'own.md').read_text(encoding='utf-8')
PLANT, SIGNALS, LOG, SCENARIO = (
    text
    for kind in ('python', 'text', 'yaml')
    for text in re.findall(f'```{kind}\n(.*?)```', PAGE, re.DOTALL)
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / 'my_plant.py').write_text(PLANT)
    (tmp_path / 'my_signals.py').write_text(SIGNALS)
    (tmp_path / 'log.csv').write_text(LOG)
    (tmp_path / 'scenario.yaml').write_text(SCENARIO)
    return tmp_path


def example(folder: Path) -> Scenario:
    return load(folder / 'scenario.yaml')


def at(signal: Signal, t: float, entries: int = 3) -> list[float]:
    out = [0.0] * entries
    signal.derivatives(t, out)
    return out


def table(folder: Path, text: str, **values: Any) -> Signal:
    (folder / 'own.csv').write_text(text)
    return SignalSpec(csv=str(folder / 'own.csv'), values=values).make()


def refused(folder: Path, **keys: Any) -> str:
    text = f'plant: chain\ncontrollers: {{nested: }}\nreference: {keys}\n'
    with pytest.raises(UserError) as caught:
        loads(text, folder)
    assert '\n' not in str(caught.value)
    return str(caught.value)


def test_the_example_of_the_page_follows_its_reference_and_rejects_what_disturbs(
    folder: Path,
) -> None:
    scenario = example(folder)
    run = scenario.run('nested')
    t = run.time
    assert np.allclose(run.reference, 1.0 - np.exp(-20 * t) * (1 + 20 * t + 200 * t * t))
    assert np.abs(run.reference - run.output)[-100:].max() < 0.02
    assert run.metrics.saturated_fraction == 0.0
    noise = run.measurement - run.output
    for part, level in ((t < 0.5, 0.0), ((t >= 0.5) & (t < 1), 0.002), (t >= 1, -0.001)):
        assert noise[part].mean() == pytest.approx(level, abs=5e-5)


def test_a_published_kind_of_experiment_is_a_file_of_signals_and_a_scenario() -> None:
    """A step through a filter of fifth order, a load in pieces, six states, b0 = 2e6."""
    scenario = load(EXAMPLES / 'buck_converter.yaml')
    design = make_design(scenario.controllers['six_states'])
    assert design.b0 == pytest.approx(2e6) and design.states == 6
    runs = {name: scenario.run(name) for name in scenario.controllers}
    run = runs['six_states']
    filtered = signal.step(([1.0], np.poly([-400.0] * 5) / 400.0**5), T=run.time)[1]
    late = np.concatenate([np.zeros(400), filtered[:-400]])
    assert np.allclose(run.reference, 4.0 + 6.0 * late, atol=1e-6)
    error = {name: one.metrics.itae for name, one in runs.items()}
    assert 5.0 * error['six_states'] > error['four_states'] > 2.0 * error['six_states']
    assert error['conventional'] > 5.0 * error['four_states']
    assert run.metrics.saturated_fraction == 0.0


def test_plain_and_compiled_give_the_same_bits(folder: Path) -> None:
    experiment = example(folder).experiment
    assert kernel_for(experiment) is not None
    settings = example(folder).controllers['nested']
    plain, fast = (simulate(experiment, settings, compiled=c) for c in (False, True))
    for name in ('reference', 'output', 'measurement', 'command', 'total_disturbance'):
        assert np.array_equal(getattr(plain, name), getattr(fast, name)), name


def test_what_would_give_other_bits_when_compiled_is_not(folder: Path) -> None:
    other = SIGNALS.replace('p * p / 2.0))', '0.5 * p**4))')  # as powers are of numba
    (folder / 'my_signals.py').write_text(other)
    assert kernel_for(example(folder).experiment) is None
    (folder / 'my_signals.py').write_text(SIGNALS)
    (folder / 'my_plant.py').write_text(PLANT.replace('* sin(x[0])', '* sin(x[0]) + t**4'))
    assert kernel_for(example(folder).experiment) is None


def test_a_scenario_is_written_with_the_full_paths(folder: Path) -> None:
    scenario = example(folder)
    assert loads(dump(scenario), '/nowhere') == scenario
    assert scenario.files == tuple(
        str(folder / name) for name in ('my_plant.py', *['my_signals.py'] * 2, 'log.csv')
    )


def test_a_sweep_varies_the_numbers_of_a_signal_and_knows_its_files(folder: Path) -> None:
    path = folder / 'sweep.yaml'
    path.write_text('scenario: scenario.yaml\nvary: {reference.speed: [5, 10]}\n')
    sweep = load_sweep(path)
    files = sweep.check().files
    assert [Path(file).name for file in files] == ['log.csv', 'my_plant.py', 'my_signals.py']
    assert at(sweep.at(0).reference.make(), 0.1)[0] == pytest.approx(1.0 - exp(-0.5) * 1.625)
    before = sweep.describe(files)
    (folder / 'log.csv').write_text(LOG + '2;1\n')
    assert sweep.describe(files) != before


def test_a_table_is_a_line_or_held_and_constant_outside(folder: Path) -> None:
    text = 't [ms],a,b\n1000,1,5\n2000,3,5\n4000,-1,5\n'
    line = table(folder, text, time='t', column='a')
    assert at(line, -1.0) == at(line, -1e9) == [1.0, 0.0, 0.0]
    assert at(line, 0.0) == [1.0, 2.0, 0.0]
    assert at(line, 0.5) == [2.0, 2.0, 0.0]
    assert at(line, 1.0) == [3.0, -2.0, 0.0]
    assert at(line, 3.0) == at(line, 1e9) == [-1.0, 0.0, 0.0]
    held = table(folder, text, column='a', between='hold', start=10.0)
    assert [at(held, t)[0] for t in (9.0, 10.9, 11.0, 12.9, 13.0)] == [1.0, 1.0, 3.0, 3.0, -1.0]
    assert at(held, 10.5) == [1.0, 0.0, 0.0]
    gaps = table(folder, 't,a\n0,1\n1,\n2,3\n')
    assert at(gaps, 1.0, 1) == [2.0]


@given(
    st.lists(st.tuples(st.integers(1, 1000), st.integers(-1000, 1000)), min_size=1),
    st.floats(-5, 5e4),
)
def test_a_table_is_numpys_interpolation(rows: list[tuple[int, int]], t: float) -> None:
    from array import array

    from nadrc_ros.simulation.signals import Table

    times, values = np.cumsum([float(step) for step, _ in rows]), [float(v) for _, v in rows]
    signal = Table(times=array('d', times), values=array('d', values), linear=True)
    assert at(signal, t)[0] == pytest.approx(np.interp(t, times, values), abs=1e-9)


def test_a_long_table_compiles_as_fast_as_a_short_one(folder: Path) -> None:
    rows = ''.join(f'{0.001 * k:.3f},{k % 7}\n' for k in range(50_000))
    (folder / 'long.csv').write_text(f't,a\n{rows}')
    (folder / 'my_plant.py').write_text(PLANT)
    text = SCENARIO.replace('{file: my_signals.py, class: Pushes}', '{csv: long.csv}')
    experiment = loads(text, folder).experiment
    settings = loads(text, folder).controllers['nested']
    assert kernel_for(experiment) is not None
    plain, fast = (simulate(experiment, settings, compiled=c) for c in (False, True))
    assert np.array_equal(plain.output, fast.output)


def test_any_signal_may_be_noise_and_none_is_as_before(folder: Path) -> None:
    text = 'plant: chain\nreference: step\ncontrollers: {nested: }\nnoise: {variance: 1e-4'
    bare = loads(text + '}').run('nested')
    hum = loads(text + ', signal: sine, amplitude: 0.5, frequency: 3}').run('nested')
    assert np.array_equal(bare.output, loads(text + ', signal: none}').run('nested').output)
    added = hum.measurement - hum.output - (bare.measurement - bare.output)
    assert np.allclose(added, 0.5 * np.sin(3.0 * hum.time))
    with pytest.raises(SettingError, match=r'noise\.varance'):
        loads(text.replace('variance', 'varance') + '}')


@pytest.mark.parametrize(
    ('keys', 'message'),
    [
        ({'file': 'my_signals.py'}, 'several signals, so `class:` must name one of Filtered, Pus'),
        ({'file': 'my_plant.py'}, 'a class with a method derivatives'),
        ({'file': 'nothing.py'}, 'No such file'),
        ({'file': 'my_signals.py', 'class': 'Filter'}, "reference.class = 'Filter'"),
        (
            {'file': 'my_signals.py', 'class': 'Filtered', 'sped': 1},
            'reference.sped: there is no such key; did you mean speed?',
        ),
        ({'signal': 'step', 'class': 'Filtered'}, 'reference.class'),
        ({'signal': 'step', 'csv': 'log.csv'}, 'reference needs either a signal'),
        ({'csv': 'log.csv', 'column': 'nois'}, "there is no column 'nois'"),
        ({'csv': 'log.csv', 'between': 'cubic'}, "reference.between = 'cubic'"),
        ({'csv': 'nothing.csv'}, 'No such file'),
        ({'csv': 'my_plant.py'}, 'reference: '),
        ({'file': 3}, 'reference.file = 3'),
        ({}, 'reference needs either a signal'),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(
    folder: Path, keys: dict[str, Any], message: str
) -> None:
    assert message in refused(folder, **keys)


@pytest.mark.parametrize(
    ('body', 'message'),
    [
        ('pass', 'reference.derivatives = [nan]: must be writing finite numbers into out'),
        ('out[1] = 0.0', 'bad.py, line 3: IndexError'),
        ('out[0] = 1 / t', 'bad.py, line 3: ZeroDivisionError'),
        ('out[0] = "1"', 'reference.derivatives'),
        ('out.append(0.0)', 'reference.derivatives'),
    ],
)
def test_a_class_that_is_no_signal_is_refused(folder: Path, body: str, message: str) -> None:
    text = f'class Bad:\n    def derivatives(self, t, out):\n        {body}\n'
    (folder / 'bad.py').write_text(text)
    assert message in refused(folder, file='bad.py')


def test_a_signal_that_fails_on_the_way_is_told_by_its_line(folder: Path) -> None:
    path = folder / 'my_signals.py'
    path.write_text(SIGNALS.replace('out[0] = 0.0\n', 'out[0] = 1 / (t < 2 or t > 50)\n'))
    with pytest.raises(UserError, match=r'my_signals\.py, line \d+: ZeroDivisionError'):
        example(folder).run('nested')
