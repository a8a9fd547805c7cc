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
# Even a machine that keeps time is late now and then.
ATTEMPTS = 4
SMALL = ('--trials=16', '--population=4', '--seeds=1', '--jobs=1', '--largest-wh=0.15')
FIGURES = ('itae', 'isu', 'total_variation')


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


def tuned(folder: Path) -> tuple[dict[str, float], list[list[str]]]:
    """Tune, and return what is predicted and the two further commands."""
    (block,) = re.findall(r'```bash\n(nadrc tune.*?)```', DOC, re.DOTALL)
    tune, *further = (line.replace('paper', 'mine').split()[1:] for line in block.splitlines())
    (folder / 'mine.yaml').write_text(SCENARIO)
    nadrc([*(word.replace('mine', 'mine.yaml') for word in tune), *SMALL], folder)
    written = json.loads((folder / 'out' / 'tune' / 'mine' / 'tune.json').read_text())
    predicted = written['controllers']['nested']['predicted']
    return {name: predicted[name] for name in FIGURES}, further


def test_the_tuned_loop_does_in_lockstep_what_was_predicted(
    tmp_path: Path, start: Processes, probe: Probe
) -> None:
    predicted, (lockstep, _) = tuned(tmp_path)
    assert 'the same bits as the simulation' in nadrc(lockstep, tmp_path)
    assert {name: figures(tmp_path)[name] for name in FIGURES} == predicted
    parameters = tmp_path / 'out' / 'tune' / 'mine' / 'nested.yaml'
    values = yaml.safe_load(parameters.read_text())['/**/controller']['ros__parameters']
    start('controller', file=parameters)
    wanted = ['inner_bandwidth', 'outer_bandwidth', 'controller_bandwidth', 'feedback_level']
    assert probe.get('controller', *wanted) == [values[name] for name in wanted]


@pytest.mark.realtime
def test_the_tuned_loop_does_in_real_time_what_was_predicted(tmp_path: Path) -> None:
    predicted, (_, real_time) = tuned(tmp_path)
    late = []
    for _ in range(ATTEMPTS):
        nadrc(real_time, tmp_path)
        if not (reason := lateness(tmp_path)):
            break
        late.append(reason)
    else:
        pytest.fail(f'no run was in time: {late}')
    live = figures(tmp_path)
    assert [live[name] for name in ('itae', 'isu')] == pytest.approx(
        [predicted[name] for name in ('itae', 'isu')], rel=0.1
    )


def lateness(folder: Path) -> str:
    """Tell what was not in time; empty where each command came well before its next sample."""
    live = figures(folder)
    lost = {key: live[key] for key in ('missed_periods', 'samples_lost') if live[key]}
    if lost or live['latency_p99_ms'] > 900.0 * PERIOD:
        return f'{lost}, 99 % of the commands in {live["latency_p99_ms"]:.1f} ms'
    run = max((folder / 'out' / 'demo' / 'nested' / 'runs').iterdir())
    samples = read_samples(run)
    sent = samples['measurement_stamp']
    uneven = max(abs(b - a - PERIOD) for a, b in pairwise(sent))
    delays = [command - y for y, command in zip(sent, samples['command_stamp'])]
    if uneven < 0.5 * PERIOD and min(delays) > 0.0 and max(delays) < 0.9 * PERIOD:
        return ''
    return f'a period was {uneven:.4f} s off, commands took {min(delays):.4f}..{max(delays):.4f} s'


def figures(folder: Path) -> dict[str, Any]:
    summary = json.loads((folder / 'out' / 'demo' / 'summary.json').read_text())
    found: dict[str, Any] = summary['runs']['nested']
    return found
