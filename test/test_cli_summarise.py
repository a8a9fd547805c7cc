"""`nadrc summarise` on the folders that runs leave, whole and broken."""

from __future__ import annotations

import csv
import json
from math import inf, nan
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.cli.app import app
from nadrc_ros.records.figures import Figures, summarise, summary
from nadrc_ros.records.history import append_parameters
from nadrc_ros.records.read_run import read_runs
from nadrc_ros.records.recording import (
    read_samples,
    RunFolder,
    RunSettings,
    SAMPLES,
    SETTINGS,
    SUMMARY,
)
from nadrc_ros.report.summary import summary_of
import pytest
from typer.testing import CliRunner

COLUMNS = ('time', 'reference', 'measurement', 'command', 'output', 'tracking')
RUN = RunSettings(rate=300.0, command_min=-1.0, command_max=1.0)
ROOT = Path(__file__).parents[1]
# Writes rows as fast as it can, and hands them to the system now and then.
WRITER = """
import sys
from pathlib import Path
from nadrc_ros.records.recording import RunSettings
from nadrc_ros.records.recording import RunFolder

columns = ['time', 'reference', 'measurement', 'command']
folder = RunFolder(Path(sys.argv[1]), columns, RunSettings())
print('open', flush=True)
k = 0
while True:
    folder.write([k / 200.0, 1.0, 1.0 / (k + 1), -0.1 * k])
    k += 1
    if k % 97 == 0:
        folder.flush()
"""
OPENER = """
import sys
from pathlib import Path
from nadrc_ros.records.recording import RunSettings
from nadrc_ros.records.recording import RunFolder

print('ready', flush=True)
sys.stdin.read()
for _ in range(20):
    folder = RunFolder(Path(sys.argv[1]), ['time'], RunSettings())
    folder.write([float(sys.argv[2])])
    folder.close()
    print(folder.path)
"""


def nadrc(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def python(code: str, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, '-c', code, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
    )


def record(
    directory: Path,
    run: RunSettings = RUN,
    count: int = 50,
    lost: tuple[int, ...] = (),
    clipped: float = inf,
) -> tuple[Path, dict[str, Any]]:
    """Record a run of odd numbers; return its folder and what a recorder would say of it."""
    folder, figures, rng = RunFolder(directory, COLUMNS, run), Figures(run), random.Random(5)
    kept = [k for k in range(count) if k not in lost]
    for k in kept:
        values = {name: rng.gauss(0.0, 1.0) for name in COLUMNS[1:]}
        if k == 7:
            values['reference'] = values['output'] = nan
        values['command'] = 1.0 if k % 3 == 0 else nan if k == 8 else values['command']
        values['command'] = min(max(values['command'], -clipped), clipped)
        figures.add(k / run.rate, values)
        folder.write([k / run.rate, *values.values()])
    folder.close()
    return folder.path, summary(figures)


@pytest.mark.parametrize('error', ['reference', 'tracking'])
def test_the_figures_are_those_of_the_recorder_to_the_bit(error: str, tmp_path: Path) -> None:
    run = RunSettings(rate=300.0, command_min=-1.0, command_max=1.0, error=error)
    folder, recorded = record(tmp_path, run)
    done = nadrc('summarise', folder)
    assert done.exit_code == 0, done.output
    assert '50 rows' in done.output and 'ITAE' in done.output
    rebuilt = json.loads((folder / SUMMARY).read_text())
    assert {key: rebuilt[key] for key in recorded} == recorded
    assert rebuilt['metrics']['skipped'] == 1
    assert rebuilt['metrics']['saturated_fraction'] > 0.3
    told = {'format', 'samples_lost', 'samples_lost_by_signal', 'commands_before', 'complete'}
    assert rebuilt.keys() == {*recorded, *told}
    # what the samples do not tell is not made up
    assert (rebuilt['samples_lost'], rebuilt['complete']) == (None, None)


OWN = {'structure': 'nested', 'inner_bandwidth': 40.0, 'command_min': -1.0, 'command_max': 1.0}


@pytest.mark.parametrize(
    ('told', 'known'),
    [
        ([(None, '/controller', OWN), (None, '/recorder', {'command_max': 9.0})], True),
        ([(0.1, '/controller', OWN), (0.15, '/controller', {'b0': 2.0})], True),  # told late
        ([(None, '/controller', OWN | {'command_max': 9.0}), (None, '/controller', OWN)], True),
        ([(None, '/controller', OWN), (0.1, '/controller', {'command_max': 0.5})], False),
        ([(None, '/a/controller', OWN), (None, '/b', OWN | {'command_min': -3.0})], False),
        ([(None, '/controller', OWN | {'command_max': 0.9})], False),  # somebody else commands
        ([(None, '/controller', OWN | {'command_max': None})], False),
        ([(None, '/recorder', {'command_min': -1.0, 'command_max': 1.0})], False),
        ([], False),
    ],
)
def test_without_limits_of_its_own_a_run_takes_those_that_its_controller_told(
    told: list[tuple[float | None, str, dict[str, Any]]], known: bool, tmp_path: Path
) -> None:
    clipped = 1.0  # what the commands are clipped to, in both runs
    _, recorded = record(tmp_path / 'own', clipped=clipped)
    folder, _ = record(tmp_path / 'told', RunSettings(rate=RUN.rate), clipped=clipped)
    for time, node, values in told:
        append_parameters(folder, time, node, values)
    found = summarise(folder)['metrics']
    share = recorded['metrics']['saturated_fraction'] if known else None
    assert found == recorded['metrics'] | {'saturated_fraction': pytest.approx(share)}
    assert share is None or share > 0.3
    ((_, subject),) = read_runs([folder]).items()
    assert subject.metrics.as_dict() == found
    assert ('the command was at a limit for' in summary_of({'': subject}, [])) == known


@pytest.mark.parametrize('name', ['log.csv', 'empty'])
def test_what_is_no_folder_of_a_run_is_refused_as_that(name: str, tmp_path: Path) -> None:
    (tmp_path / 'log.csv').write_text('t,y\n0,1\n')
    (tmp_path / 'empty').mkdir()
    done = nadrc('summarise', tmp_path / name)
    assert done.exit_code == 1 and 'not the folder of a run' in done.output


def test_gaps_in_time_are_periods_without_a_row(tmp_path: Path) -> None:
    folder, _ = record(tmp_path, lost=(3, 4, 20))
    found = summarise(folder)
    assert (found['rows'], found['periods']) == (47, 50)


@pytest.mark.parametrize('end', ['0.1', '0.1,2.0,3.0', '0.1,1,1,1,1,1'])
def test_a_row_that_was_cut_short_is_left_out_and_that_is_said(end: str, tmp_path: Path) -> None:
    folder, recorded = record(tmp_path)
    with (folder / SAMPLES).open('a') as file:
        file.write(end)
    done = nadrc('summarise', folder)
    assert done.exit_code == 0
    assert 'the last row was cut short and was skipped' in done.output
    rebuilt = json.loads((folder / SUMMARY).read_text())
    assert {key: rebuilt[key] for key in recorded} == recorded
    assert rebuilt['complete'] is False


def test_a_summary_that_a_recorder_ended_its_run_with_stays(tmp_path: Path) -> None:
    folder, recorded = record(tmp_path)
    (folder / SUMMARY).write_text('{"complete": false}')  # saved in mid-run
    assert nadrc('summarise', folder).exit_code == 0
    assert json.loads((folder / SUMMARY).read_text())['rows'] == recorded['rows']
    own = '{"complete": true, "samples_lost": 12}'
    (folder / SUMMARY).write_text(own)
    done = nadrc('summarise', folder)
    assert (done.exit_code, (folder / SUMMARY).read_text()) == (0, own)
    assert 'left unchanged' in done.output


@pytest.mark.parametrize(
    ('file', 'content', 'said'),
    [
        (SAMPLES, None, f'there is no {SAMPLES} in it'),
        (SETTINGS, None, f'{SETTINGS}: No such file'),
        (SETTINGS, '{', SETTINGS),
        (SETTINGS, '[]', 'rate'),
        (SETTINGS, '{"rate": 100.0}', 'command_min'),
        (
            SETTINGS,
            '{"error": "x", "command_min": 0, "command_max": 1, "rate": 9}',
            'run.json.error',
        ),
        (SAMPLES, '', 'no column time'),
        (SAMPLES, 'time,reference,measurement', 'no column command'),
        (SAMPLES, 'time,reference,measurement,command\n', 'no samples'),
        (SAMPLES, 'time,reference,measurement,command\n0.0,1,1', 'no samples'),
        (SAMPLES, 'time,reference,measurement,command\n0,1,1\n0.1,1,1,1\n', 'line 2'),
        (SAMPLES, 'time,reference,measurement,command\n0,1,x,1\n', 'line 2'),
        (SAMPLES, 'time,reference,measurement,command\n\0\0\0\n', 'line 2'),
        (SAMPLES, 'time,reference,measurement,command\n,1,1,1\n', 'not a number'),
    ],
)
def test_a_folder_that_is_no_run_is_refused_with_a_reason(
    file: str, content: str | None, said: str, tmp_path: Path
) -> None:
    folder, _ = record(tmp_path)
    (folder / file).unlink()
    if content is not None:
        (folder / file).write_text(content)
    done = nadrc('summarise', folder)
    assert done.exit_code == 1
    assert said in done.output and str(folder) in done.output
    assert len(done.output.splitlines()) == 1
    assert not (folder / SUMMARY).exists()


def test_help_has_an_example() -> None:
    assert 'Example: nadrc summarise runs/' in nadrc('summarise', '--help').output


def test_killed_at_any_moment_a_run_is_readable_by_anything_that_reads_csv(
    tmp_path: Path,
) -> None:
    rng = random.Random(11)
    for attempt in range(6):
        directory = tmp_path / str(attempt)
        process = python(WRITER, directory)
        assert process.stdout is not None
        process.stdout.readline()
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(rng.uniform(0.0, 0.05))
        process.kill()
        process.communicate()
        assert process.returncode == -signal.SIGKILL
        (folder,) = directory.iterdir()
        samples = read_samples(folder)
        assert samples['time'] == [k / 200.0 for k in range(len(samples['time']))]
        assert samples['command'] == [-0.1 * k for k in range(len(samples['time']))]
        with (folder / SAMPLES).open(newline='') as file:
            rows = list(csv.DictReader(file))
        assert len(rows) - len(samples['time']) in (0, 1)
        for t, row in zip(samples['time'], rows):
            assert float(row['time']) == t
        try:
            assert summarise(folder)['rows'] == len(samples['time'])
        except UserError as error:
            assert 'no samples' in str(error) and not samples['time']


def test_runs_that_are_opened_at_the_same_moment_do_not_meet(tmp_path: Path) -> None:
    processes = [python(OPENER, tmp_path, number) for number in range(3)]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == 'ready\n'
    opened = [process.communicate()[0].split() for process in processes]
    assert len({path for paths in opened for path in paths}) == 60
    for number, paths in enumerate(opened):
        assert len(paths) == 20
        assert all(read_samples(Path(path)) == {'time': [float(number)]} for path in paths)
