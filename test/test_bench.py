"""The benches: each of them runs, in small, and writes the keys that it documents."""

from __future__ import annotations

import json
from math import nan
from pathlib import Path
import shutil
from typing import Any

import attrs
from bench import batch, results, simulate, step
import numpy as np
import pytest

SMALL = attrs.evolve(simulate.EXPERIMENT, duration=0.05)
LONGER = attrs.evolve(simulate.EXPERIMENT, duration=6.0)  # the reference is then at -1


def written(part: str, folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the figures and the samples of a part."""
    document = json.loads((folder / 'bench.json').read_text(encoding='utf-8'))
    with np.load(folder / 'raw' / f'{part}.npz') as samples:
        return document[part], dict(samples)


def test_a_part_replaces_its_own_figures_only(tmp_path: Path) -> None:
    results.save('a', {'x': 1.0}, {'x': [1.0, 1.0]}, tmp_path)
    results.save('b', {'y': 2.0, 'none': {'y': nan}}, {'y': [2.0]}, tmp_path)
    results.save('a', {'z': 3.0}, {'z': [3.0, 3.0, 3.0]}, tmp_path)
    figures, samples = written('a', tmp_path)
    assert figures == {'z': 3.0}
    assert list(samples) == ['z'] and samples['z'].tolist() == [3.0, 3.0, 3.0]
    assert written('b', tmp_path)[0] == {'y': 2.0, 'none': {'y': None}}


def test_step_times_every_call_of_every_contestant(tmp_path: Path) -> None:
    step.main(blocks=2, calls=5, folder=tmp_path)
    figures, samples = written('step', tmp_path)
    names = {'nadrc_n2_k2', 'nadrc_n2_k1', 'nadrc_n2_k4', 'nadrc_n4_k2', 'nadrc_n2_k2_jitter'}
    assert set(figures) == names | {'pyadrc_statespace', 'pyadrc_feedbacktf', 'simple_pid'}
    for name, figure in figures.items():
        assert set(figure) == {'median_us', 'p99_us'}
        assert samples[name].shape == (10,)
        assert 0.0 < figure['median_us'] <= figure['p99_us']


def test_simulate_writes_a_figure_for_every_contestant(tmp_path: Path) -> None:
    simulate.main(SMALL, rounds=1, repeats=2, folder=tmp_path)
    figures, samples = written('simulate', tmp_path)
    names = {'nadrc', 'nadrc_loop', 'nadrc_plain', 'pyadrc', 'python_control', 'solve_ivp'}
    names |= {'c'} if shutil.which('cc') else set()
    assert set(figures) == names
    assert all(figure['ns_per_step'] > 0.0 for figure in figures.values())
    assert len(samples['nadrc']) == 2 and len(samples['pyadrc']) == 1


@pytest.mark.parametrize('change', ('rows', 'sums', 'state'))
def test_a_loop_in_c_that_comes_to_something_else_is_no_measure(change: str) -> None:
    ours, by_hand = simulate.ours_loop(SMALL), simulate.c_loop(SMALL)
    if by_hand is None:
        pytest.skip('DID NOT RUN: no C compiler')
    simulate.check_agreement(ours, by_hand)
    run, loop, rows = by_hand

    def wrong() -> simulate.Outcome:
        outcome = run()
        if change == 'rows':
            rows[-1, 5] += 1e-6
        elif change == 'sums':
            loop.metrics.sums[simulate.SUMS[0]] += 1e-6
        else:
            loop.plant_run.state[1] += 1e-6
        return outcome

    with pytest.raises(AssertionError):
        simulate.check_agreement(ours, (wrong, loop, rows))


def test_all_loops_follow_the_reference() -> None:
    runs = simulate.measure(LONGER, rounds=1, repeats=1)
    time = np.arange(LONGER.steps) * LONGER.period
    error = {
        name: np.abs(own[0].output - np.cos(simulate.FREQUENCY * time))[-500:].max()
        for name, own in runs.items()
    }
    assert max(error.values()) < 0.15, error


def test_without_a_compiler_the_loop_in_c_is_left_out_and_said_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv('PATH', str(tmp_path))
    simulate.main(SMALL, rounds=1, repeats=1, folder=tmp_path)
    assert 'c' not in written('simulate', tmp_path)[0]
    assert 'no C compiler' in capsys.readouterr().out


def test_batch_writes_speed_memory_and_growth(tmp_path: Path) -> None:
    batch.main(
        SMALL,
        runs=4,
        turns=2,
        many_runs=2,
        lengths=(20,),
        growth_turns=2,
        growth_runs=1,
        folder=tmp_path,
    )
    figures, samples = written('batch', tmp_path)
    expected = {'runs_per_s_1core', 'runs_per_s_2core', 'peak_mb', 'peak_mb_20_steps'}
    expected |= {'c_per_s_1core', 'c_per_s_2core'} if shutil.which('cc') else set()
    assert expected < set(figures)
    assert {name for name in figures if name.startswith('us_per_run_')} == {
        f'us_per_run_{case}' for case in batch.cases(1, 1)
    }
    assert all(value > 0.0 for value in figures.values())
    assert len(samples['runs_per_s_2core']) == len(samples['base']) == 2
