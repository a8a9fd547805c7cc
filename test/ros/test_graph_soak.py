"""The graph at 500 Hz under random faults: for most of a minute here, for ten in `make soak`."""

from __future__ import annotations

from itertools import pairwise
import json
from pathlib import Path
from statistics import median

from accounting import check_rows
from nadrc_ros.records.recording import read_samples
from probe import Probe, Processes, ROOT
from resources import growth, Held
from soak import LIMIT, NODES, RATE, Soak, UNTIL_CALM

DURATION = {True: 600.0, False: 45.0}
# In its first minute a node still uses pages for the first time, under faults 200 to 400 kB/min:
# there a leak is an object in each period, of 16 bytes at least [kB/min].
LEAST = {True: 0.0, False: 16.0 * RATE * 60.0 / 1024.0}


def test_p20_random_faults_leave_no_growth_no_flood_and_no_lost_record(
    soak: bool, seed: int, probe: Probe, start: Processes, tmp_path: Path
) -> None:
    """That nothing dies, and that the loop recovers and ends, is what the run itself asks for."""
    run = Soak(probe, start, tmp_path, DURATION[soak], seed)
    run.run()
    report(run, seed)
    check_commands(run)
    check_logs(run)
    check_records(run)
    for name in NODES:
        check_resources(name, run, LEAST[soak])


def check_commands(run: Soak) -> None:
    assert len(run.commands) > 0.3 * RATE * run.duration
    assert all(-LIMIT <= command <= LIMIT for command in run.commands)
    assert run.commands[-1] == 0.0


def check_logs(run: Soak) -> None:
    """Some lines per fault and per change of mode, and none per period."""
    for name, process in run.started:
        lines = process.said.count('\n')
        assert lines < 20 + 5 * (run.happened.total() + run.duration), name
        assert 'Traceback' not in process.said, process.said


def check_records(run: Soak) -> None:
    heard = list(zip(run.measurements, run.measurements.numbers))[run.calm :]
    *folders, last = sorted(run.runs.iterdir())
    rows, lost = check_rows(last, RATE, heard)
    print(f'last run: {rows} rows, {lost} measurements lost')
    assert rows > 0.2 * RATE * (1.0 - UNTIL_CALM) * run.duration
    for folder in folders:
        assert all(before < after for before, after in pairwise(read_samples(folder)['time']))


def check_resources(name: str, run: Soak, least: float) -> None:
    samples = judged(run, name)
    assert not growth(samples).leaks(least), (name, [sample.memory for sample in samples])
    files, third = [sample.files for sample in samples], len(samples) // 3
    assert median(files[-third:]) <= median(files[:third]), name


def judged(run: Soak, name: str) -> list[Held]:
    """Return what a node held in the last part of the run, when all was calm for a while."""
    samples = run.held[name]
    return [held for held in samples if held.time > samples[-1].time - 0.4 * run.duration]


def report(run: Soak, seed: int) -> None:
    """Print what happened and what came of it, and write it to build/soak.json."""
    print(f'\nsoak of {run.duration:g} s, seed {seed}: {len(run.commands)} commands')
    print(f'{"node":12}{"started":>8}{"log lines":>10}{"kB":>8}{"kB/min":>24}{"files":>10}')
    for name in NODES:
        lines = [process.said.count('\n') for node, process in run.started if node == name]
        samples = judged(run, name)
        median_rate, low, high = growth(samples)
        files = [sample.files for sample in samples]
        print(
            f'{name:12}{len(lines):8}{sum(lines):10}{samples[-1].memory:8}'
            f'{median_rate:8.1f} in {low:5.1f} ..{high:5.1f}{min(files):5} ..{max(files):3}'
        )
    for fault, count in sorted(run.happened.items()):
        print(f'{count:5} {fault}')
    (ROOT / 'build').mkdir(exist_ok=True)
    content = {'seed': seed, 'duration': run.duration, 'happened': run.happened, 'held': run.held}
    (ROOT / 'build' / 'soak.json').write_text(json.dumps(content), encoding='utf-8')
