"""`nadrc tune`: its files, what a second start does, and what Ctrl-C and kill -9 leave."""

from __future__ import annotations

import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from nadrc_ros.cli.app import app
from nadrc_ros.scenario import load
import pytest
from typer.testing import CliRunner
import yaml

ROOT = Path(__file__).parents[1]
PATIENCE = 120.0
SCENARIO = """
plant: {name: chain, order: 1, damping: 1, load: 2}
reference: {signal: step, amplitude: 1}
noise: {variance: 1e-4}
rate: 50
duration: 1
controllers:
  conventional: {structure: conventional}
  nested: {inner_bandwidth: 8, outer_bandwidth: 4, controller_bandwidth: 2}
retune: [{time: 0.5, b0: 2}]
"""
SMALL = ('--trials', 20, '--population', 4, '--seeds', 2, '--jobs', 1)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / 'mine.yaml'
    path.write_text(SCENARIO)
    return path


def words(file: object, *arguments: object) -> list[str]:
    return ['tune', *map(str, (file, *arguments))]


def nadrc(file: object, *arguments: object) -> Any:
    return CliRunner().invoke(app, words(file, *arguments))


def start(file: Path, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, '-m', 'nadrc_ros.cli', *words(file, *arguments)],
        cwd=ROOT,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def result(folder: Path) -> dict[str, Any]:
    content = json.loads((folder / 'tune.json').read_text())
    found: dict[str, Any] = content['controllers']
    return found


def test_without_optuna_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [n for n in sys.modules if n.startswith('nadrc_ros.tuning.search.s')]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'optuna', None)
    done = nadrc('motor_speed', '--out', tmp_path)
    assert done.exit_code == 1
    assert "-m pip install 'optuna>=5,<6' cmaes pymoo" in done.output


def test_the_files_hold_what_was_found(file: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out'
    done = nadrc(file, *SMALL, '--out', out)
    assert done.exit_code == 0, done.output
    assert sorted(os.listdir(out)) == [
        *('conventional.yaml', 'front.png', 'nested.yaml'),
        *('scenario.yaml', 'study.log', 'tune.json'),
    ]
    tuned = load(out / 'scenario.yaml')
    assert tuned.retunes == ()
    for name, found in result(out).items():
        assert found['trials'] == 20
        assert found['predicted'] == tuned.run(name).metrics.as_dict()
        parameters = yaml.safe_load((out / f'{name}.yaml').read_text())
        values = parameters['/**/controller']['ros__parameters']
        assert values['rate'] == 50.0
        for key in ('inner_bandwidth', 'outer_bandwidth', 'controller_bandwidth', 'b0'):
            assert values[key] == getattr(tuned.controllers[name], key)
        assert found['margins']['modulus'] >= 0.4


def test_a_finished_study_answers_other_questions(file: Path, tmp_path: Path) -> None:
    arguments = (*SMALL, '--controller', 'nested', '--out', tmp_path / 'out')
    assert nadrc(file, *arguments).exit_code == 0
    study = (tmp_path / 'out' / 'study.log').read_bytes()
    effort = result(tmp_path / 'out')['nested']['front'][-1]['isu']
    again = nadrc(file, *arguments, '--isu', effort)
    assert f'best within ISU {effort:g}' in again.output
    assert (tmp_path / 'out' / 'study.log').read_bytes().startswith(study)
    assert result(tmp_path / 'out')['nested']['trials'] == 20
    assert 'point 1, as asked for' in nadrc(file, *arguments, '--choose', 1).output
    assert nadrc(file, *arguments, '--isu', 1e-9).exit_code == 1


def test_nothing_is_written_when_nothing_is_feasible(file: Path, tmp_path: Path) -> None:
    done = nadrc(file, *SMALL, '--peak', 1e-3, '--controller', 'nested', '--out', tmp_path / 'out')
    assert done.exit_code == 1
    assert 'none of 20 designs meets the constraints (violated: peak ' in done.output
    assert os.listdir(tmp_path / 'out') == ['study.log']


def test_more_designs_than_asked_for_are_told(file: Path, tmp_path: Path) -> None:
    few = ('--trials', 5, '--population', 4, '--seeds', 1, '--jobs', 1, '--controller', 'nested')
    done = nadrc(file, *few, '--out', tmp_path / 'out')
    said = 'nested: 16 designs, not 5: the first generation has 16, each later one 4'
    assert said in done.output
    assert result(tmp_path / 'out')['nested']['trials'] == 16


@pytest.mark.parametrize('blow', [signal.SIGKILL, signal.SIGINT])
def test_what_was_stopped_goes_on_to_the_same_end(
    blow: signal.Signals, file: Path, tmp_path: Path
) -> None:
    arguments = (*SMALL, '--trials', 48, '--out')
    assert nadrc(file, *arguments, tmp_path / 'whole').exit_code == 0
    process = start(file, *arguments, tmp_path / 'part')
    log = tmp_path / 'part' / 'study.log'
    _wait_for(lambda: log.exists() and log.read_bytes().count(b'\n') > 18, process)
    process.send_signal(blow)
    _, error = process.communicate(timeout=PATIENCE)
    if blow is signal.SIGINT and process.returncode:
        assert process.returncode == 130
        assert error.splitlines()[-1].endswith('is kept; the same command goes on')
    assert nadrc(file, *arguments, tmp_path / 'part').exit_code == 0
    assert result(tmp_path / 'part') == result(tmp_path / 'whole')


def _wait_for(condition: Any, process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition() and process.poll() is None:
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (('--controller', 'fuzzy'), '--controller = '),
        (('--vary', 'speed=1:2'), '--vary speed: there is no such key'),
        (('--vary', 'b0=2'), '--vary b0 = '),
        (('--b0-spread', 'much'), '--b0-spread = '),
        (('--plant', 'mass=1:2'), '--plant mass: there is no such key'),
        (('--controller', 'nestd'), 'did you mean nested?'),
        (('--budget', '-3'), '--budget = '),
        (('--sampler', 'bfo'), '--sampler = '),
        (('--sampler', 'pso'), 'nsga2 without a budget'),
        (('--settings', 'nowhere.yaml'), 'cannot be read'),
        (('--storage', 'nosql://x'), '--storage nosql://x'),
    ],
)
def test_nonsense_is_one_line(
    arguments: tuple[str, ...], said: str, file: Path, tmp_path: Path
) -> None:
    done = nadrc(file, *SMALL, *arguments, '--out', tmp_path / 'out')
    assert done.exit_code == 1
    lines = [line for line in done.output.splitlines() if 'retune' not in line]
    assert len(lines) == 1 and lines[0].startswith('error: ') and said in lines[0]


@pytest.mark.parametrize('content', ['trails: 4', 'trials: 0', 'trials: ['])
def test_an_error_in_a_file_of_options_names_the_file(
    content: str, file: Path, tmp_path: Path
) -> None:
    settings = tmp_path / 'tune.yaml'
    settings.write_text(content)
    done = nadrc(file, '--settings', settings, '--out', tmp_path / 'out')
    assert done.exit_code == 1 and f'error: {settings}: ' in done.output


def test_options_may_come_from_a_file(file: Path, tmp_path: Path) -> None:
    settings = tmp_path / 'tune.yaml'
    settings.write_text('{trials: 20, population: 4, seeds: 1, vary: {b0: [0.7, 1.4]}}')
    arguments = ('--settings', settings, '--controller', 'nested', '--out', tmp_path / 'out')
    assert nadrc(file, *arguments).exit_code == 0
    assert result(tmp_path / 'out')['nested']['ranges'] == {'b0': [0.7, 1.4]}
    nested = load(tmp_path / 'out' / 'scenario.yaml').controllers['nested']
    assert 0.7 <= nested.b0 <= 1.4 and nested.inner_bandwidth == 8.0
