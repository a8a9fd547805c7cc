"""From a plain scenario to a tuned loop on ROS, by the three commands of docs/tuning.md."""

from __future__ import annotations

from itertools import pairwise
import json
import os
from pathlib import Path
import re
import subprocess
import sys
from typing import Any

from nadrc_ros.records.recording import read_samples
from probe import Probe, Processes
import pytest
import yaml

ROOT = Path(__file__).parents[2]
DOC = (ROOT / 'docs' / 'tuning.md').read_text(encoding='utf-8')
SCENARIO = """
plant: {name: paper, a3: 0.2}
reference: {signal: cosine, frequency: 0.5}
noise: {variance: 1e-4}
rate: 100
duration: 3
controllers:
  nested: {}
"""
PERIOD = 0.01
ATTEMPTS = 6
SMALL = [
    '--trials',
    '16',
    '--population',
    '4',
    '--seeds',
    '1',
    '--jobs',
    '1',
    '--largest-wh',
    '0.15',
]


def nadrc(words: list[str], folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, '-m', 'nadrc_ros.cli', *words],
        check=False,
        cwd=folder,
        env={**os.environ, 'PYTHONPATH': f'{ROOT}:{os.environ.get("PYTHONPATH", "")}'},
        capture_output=True,
        text=True,
        timeout=180,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope='module')
def commands() -> list[list[str]]:
    (block,) = re.findall(r'```bash\n(nadrc tune.*?)```', DOC, re.DOTALL)
    return [line.replace('paper', 'mine').split()[1:] for line in block.splitlines()]


def test_the_tuned_loop_does_on_ros_what_was_predicted(
    commands: list[list[str]], tmp_path: Path, start: Processes, probe: Probe
) -> None:
    tune, lockstep, real_time = commands
    (tmp_path / 'mine.yaml').write_text(SCENARIO)
    nadrc([*(word.replace('mine', 'mine.yaml') for word in tune), *SMALL], tmp_path)
    folder = tmp_path / 'out' / 'tune' / 'mine'
    predicted = json.loads((folder / 'tune.json').read_text())['controllers']['nested']
    said = nadrc(lockstep, tmp_path)
    assert 'the same bits as the simulation' in said
    for key in ('itae', 'isu', 'total_variation'):
        assert figures(tmp_path)[key] == predicted['predicted'][key], key
    expected = {key: predicted['predicted'][key] for key in ('itae', 'isu')}
    for _ in range(ATTEMPTS):
        nadrc(real_time, tmp_path)
        if in_time(tmp_path):
            live = figures(tmp_path)
            assert {key: live[key] for key in expected} == pytest.approx(expected, rel=0.1)
            break
    parameters = folder / 'nested.yaml'
    values = yaml.safe_load(parameters.read_text())['/**/controller']['ros__parameters']
    start('controller', file=parameters)
    wanted = ['inner_bandwidth', 'outer_bandwidth', 'controller_bandwidth', 'feedback_level']
    assert probe.get('controller', *wanted) == [values[name] for name in wanted]


def in_time(folder: Path) -> bool:
    """Tell whether the plant kept its pace, and each command came well before its next sample."""
    live = figures(folder)
    if live['missed_periods'] or live['samples_lost'] or live['latency_p99_ms'] > 900.0 * PERIOD:
        return False
    run = max((folder / 'out' / 'demo' / 'nested' / 'runs').iterdir())
    samples = read_samples(run)
    sent = samples['measurement_stamp']
    paced = all(abs(b - a - PERIOD) < 0.5 * PERIOD for a, b in pairwise(sent))
    return paced and all(
        0.0 < command - measurement < 0.9 * PERIOD
        for measurement, command in zip(sent, samples['command_stamp'])
    )


def figures(folder: Path) -> dict[str, Any]:
    summary = json.loads((folder / 'out' / 'demo' / 'summary.json').read_text())
    found: dict[str, Any] = summary['runs']['nested']
    return found
