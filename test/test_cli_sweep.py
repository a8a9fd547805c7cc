"""`nadrc sweep`: the table, what a second start skips, and what Ctrl-C and kill -9 leave."""

from __future__ import annotations

import csv
import fcntl
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from typing import Any

import attrs
from nadrc_ros.cli.app import app
from nadrc_ros.cli.sweep import _fill
from nadrc_ros.records.run_table import RunTable
from nadrc_ros.scenario import load
from nadrc_ros.scenario.sweep import Extent, load_sweep, Sweep
from nadrc_ros.simulation.metrics import MetricValues
from pyarrow import parquet
import pytest
from typer.testing import CliRunner

ROOT = Path(__file__).parents[1]
PATIENCE = 60.0
MARK = 'NADRC_TEST'
SWEEP = """
scenario:
  plant: {name: paper}
  reference: cosine
  noise: {variance: 1e-4}
  rate: 100
  duration: DURATION
  controllers: {conventional: {structure: conventional}, nested: {}}
vary:
  plant.a3: [0.1, 0.25]
  controllers.nested.feedback_level: [inner, outer]
seeds: 25
"""
RUNS = 200


def nadrc(*arguments: object) -> Any:
    return CliRunner().invoke(app, ['sweep', *map(str, arguments)])


def start(file: Path, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, '-m', 'nadrc_ros.cli', 'sweep', str(file), *map(str, arguments)],
        cwd=ROOT,
        env={**os.environ, MARK: str(file.parent)},
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def processes_in(folder: Path) -> list[str]:
    """Return the living processes that come from a `start` with a file in this folder."""
    found = []
    for process in Path('/proc').glob('[0-9]*'):
        try:
            if f'{MARK}={folder}'.encode() in (process / 'environ').read_bytes():
                found.append(process.name)
        except OSError:
            continue
    return found


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def wait_for_rows(path: Path, count: int, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not path.exists() or len(path.read_bytes().splitlines()) <= count:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A sweep of 200 short runs."""
    path = tmp_path / 'mine.yaml'
    path.write_text(SWEEP.replace('DURATION', '0.1'))
    return path


def fill(path: Path, sweep: Sweep, extent: Extent, runs: int = RUNS) -> None:
    """Do that many runs here, in this process."""
    from nadrc_ros.scenario.sweep import run_range

    table = RunTable(path, sweep, extent)
    table.append(run_range(sweep, table.done, table.done + runs, False))
    if table.done == table.runs:
        table.finish()
    table.close()


@pytest.fixture
def whole(file: Path, tmp_path: Path) -> bytes:
    sweep = load_sweep(file)
    fill(tmp_path / 'whole.csv', sweep, sweep.check())
    return (tmp_path / 'whole.csv').read_bytes()


def test_a_row_is_a_run_with_its_key_and_every_metric(
    file: Path, tmp_path: Path, whole: bytes
) -> None:
    found = rows(tmp_path / 'whole.csv')
    assert len(found) == RUNS
    row = found[RUNS - 1]
    metrics = [field.name for field in attrs.fields(MetricValues)]
    key = ['plant.a3', 'controllers.nested.feedback_level', 'controller', 'seed']
    assert list(row)[:4] == key and [row[name] for name in key] == [
        '0.25',
        'outer',
        'nested',
        '24',
    ]
    assert [name for name in metrics if name not in row] == ['duration']
    scenario = load_sweep(file).at(3)
    assert scenario.plant.values['a3'] == 0.25
    single = scenario.changed(seed=24).run('nested').metrics
    for name in metrics:
        cell = row['duration_used' if name == 'duration' else name]
        assert float(cell) == getattr(single, name)


def test_the_command_gives_the_same_table_in_both_formats(
    file: Path, tmp_path: Path, whole: bytes
) -> None:
    for name in ('out.csv', 'out.parquet'):
        done = nadrc(file, '--table', tmp_path / name, '--jobs', 2)
        assert done.exit_code == 0, done.output
        assert f'{RUNS} runs in {tmp_path / name}' in done.output
    assert (tmp_path / 'out.csv').read_bytes() == whole
    assert not (tmp_path / 'out.parquet.csv').exists()
    table = parquet.read_table(tmp_path / 'out.parquet')
    expected = rows(tmp_path / 'whole.csv')
    assert table.column_names == list(expected[0])
    kinds = {name: str(table.schema.field(name).type) for name in table.column_names}
    assert (kinds['plant.a3'], kinds['controller']) == ('double', 'string')
    assert (kinds['seed'], kinds['samples'], kinds['itae']) == ('int64', 'int64', 'double')
    for name in table.column_names:
        assert list(map(str, table[name].to_pylist())) == [row[name] for row in expected]


@pytest.mark.parametrize('name', ['out.csv', 'out.parquet'])
def test_a_second_start_does_nothing(name: str, file: Path, tmp_path: Path) -> None:
    sweep, path = load_sweep(file), tmp_path / name
    fill(path, sweep, sweep.check())
    before = path.read_bytes(), path.stat().st_mtime_ns
    done = nadrc(file, '--table', path, '--dask', 'tcp://127.0.0.1:1')  # no worker is asked for
    assert done.exit_code == 0, done.output
    assert (path.read_bytes(), path.stat().st_mtime_ns) == before


@pytest.mark.parametrize('name', ['out.csv', 'out.parquet'])
@pytest.mark.parametrize('torn', [0, 1, 30])
def test_it_goes_on_where_it_was_killed_to_the_same_bytes(
    torn: int, name: str, file: Path, tmp_path: Path, whole: bytes
) -> None:
    sweep, path = load_sweep(file), tmp_path / name
    extent = sweep.check()
    fill(path, sweep, extent, 67)
    journal = path if name == 'out.csv' else tmp_path / f'{name}.csv'
    lines = journal.read_bytes()
    assert whole.startswith(lines)
    with journal.open('r+b') as broken:  # as a kill in the middle of a write leaves it
        broken.truncate(len(lines) - torn)
    table = RunTable(path, sweep, extent)
    assert table.done == (67 if torn == 0 else 66)
    table.close()
    fill(path, sweep, extent, RUNS - table.done)
    fill(tmp_path / f'at once {name}', sweep, extent)
    assert path.read_bytes() == (tmp_path / f'at once {name}').read_bytes()
    assert name != 'out.csv' or path.read_bytes() == whole


def test_a_header_that_was_cut_short_is_written_again(
    file: Path, tmp_path: Path, whole: bytes
) -> None:
    sweep, path = load_sweep(file), tmp_path / 'out.csv'
    extent = sweep.check()
    RunTable(path, sweep, extent).close()
    with path.open('r+b') as broken:
        broken.truncate(5)
    fill(path, sweep, extent)
    assert path.read_bytes() == whole


@pytest.mark.parametrize(
    ('kill', 'code'), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)]
)
def test_what_is_done_is_kept_and_not_done_again(
    kill: signal.Signals, code: int, file: Path, tmp_path: Path
) -> None:
    file.write_text(SWEEP.replace('DURATION', '10.0').replace('25', '16'))
    path = tmp_path / 'out.csv'
    process = start(file, '--table', path, '--jobs', 2)
    wait_for_rows(path, 3, process)
    if kill == signal.SIGINT:
        os.killpg(process.pid, kill)  # as a terminal does
    else:
        process.send_signal(kill)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == code, errors
    kept = path.read_bytes()
    count = kept.count(b'\n') - 1
    assert 3 <= count < 128
    if kill == signal.SIGINT:
        assert f'interrupted: {count} of 128 runs are kept; the same command goes on' in errors
        assert len(errors.splitlines()) == 1
    deadline = time.monotonic() + PATIENCE
    while processes_in(tmp_path):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    done = nadrc(file, '--table', path)
    assert done.exit_code == 0, done.output
    assert path.read_bytes().startswith(kept)
    assert [row['seed'] for row in rows(path)] == [str(seed) for seed in range(16)] * 8


def test_a_worker_that_is_killed_ends_it_with_what_is_done(file: Path, tmp_path: Path) -> None:
    file.write_text(SWEEP.replace('DURATION', '10.0').replace('25', '16'))
    path = tmp_path / 'out.csv'
    process = start(file, '--table', path, '--jobs', 1)
    wait_for_rows(path, 3, process)
    for child in processes_in(tmp_path):
        if b'spawn_main' in (Path('/proc') / child / 'cmdline').read_bytes():
            os.kill(int(child), signal.SIGKILL)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert re.fullmatch(r'error: the workers are gone: \d+ of 128 runs are kept; .*\n', errors)


@pytest.mark.parametrize('name', ['out.csv', 'out.parquet'])
def test_another_sweep_does_not_mix_with_it(name: str, file: Path, tmp_path: Path) -> None:
    sweep, path = load_sweep(file), tmp_path / name
    fill(path, sweep, sweep.check(), 5)
    before = {each: each.read_bytes() for each in tmp_path.iterdir() if each != file}
    file.write_text(file.read_text().replace('seeds: 25', 'seeds: 26'))
    done = nadrc(file, '--table', path)
    assert done.exit_code == 1
    assert 'is the table of another sweep' in done.output and str(path) in done.output
    assert before == {each: each.read_bytes() for each in tmp_path.iterdir() if each != file}


def test_a_file_that_is_no_table_of_ours_is_left_alone(file: Path, tmp_path: Path) -> None:
    path = tmp_path / 'out.csv'
    path.write_text('mine\n')
    done = nadrc(file, '--table', path)
    assert done.exit_code == 1 and 'no out.csv.yaml says' in done.output
    assert path.read_text() == 'mine\n'


@pytest.mark.parametrize(
    ('edit', 'line'), [(('0.1,outer', '0.3,outer'), 52), (('plant.a3', 'a3'), 1), (('', ''), 202)]
)
def test_rows_that_are_not_those_of_the_sweep_are_refused(
    edit: tuple[str, str], line: int, file: Path, tmp_path: Path, whole: bytes
) -> None:
    path = tmp_path / 'whole.csv'
    text = path.read_text()
    path.write_text(text.replace(*edit, 1) if edit[0] else text + text.splitlines()[-1] + '\n')
    done = nadrc(file, '--table', path)
    assert done.exit_code == 1 and f'line {line} is not that of this sweep' in done.output


def test_two_sweeps_do_not_write_one_table(file: Path, tmp_path: Path) -> None:
    sweep, path = load_sweep(file), tmp_path / 'out.csv'
    table = RunTable(path, sweep, sweep.check())
    done = nadrc(file, '--table', path)
    assert done.exit_code == 1 and 'another sweep is writing it' in done.output
    table.close()
    with path.open('rb') as free:
        fcntl.flock(free, fcntl.LOCK_EX | fcntl.LOCK_NB)


@pytest.mark.parametrize(
    ('arguments', 'code', 'said'),
    [
        (('--table', 'x.txt'), 2, 'must end in .csv or .parquet'),
        (('--jobs', '0'), 2, 'jobs'),
        (('--dask', 'nonsense://x'), 1, '--dask nonsense://x: no scheduler answers'),
        (('--table', 'nowhere/x.csv'), 1, 'no such folder'),
    ],
)
def test_what_is_wrong_with_the_command_is_said_in_one_line(
    arguments: tuple[str, ...],
    code: int,
    said: str,
    file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    done = nadrc(file, *arguments)
    assert done.exit_code == code and said in done.output, done.output
    assert 'Traceback' not in done.output


def test_a_bad_value_is_named_with_the_file(file: Path, tmp_path: Path) -> None:
    file.write_text(file.read_text().replace('0.25', '1e99'))
    done = nadrc(file, '--table', tmp_path / 'out.csv')
    assert done.exit_code == 1
    assert done.output.startswith(f'error: {file}: plant.a3 = 1e+99: must be')
    assert len(done.output.splitlines()) == 1
    assert os.listdir(tmp_path) == [file.name]


def test_progress_is_written_now_and_then(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from concurrent.futures import ThreadPoolExecutor

    monkeypatch.setattr('nadrc_ros.cli.progress._EVERY', 0.0)
    sweep = load_sweep(file)
    extent = sweep.check()
    table = RunTable(tmp_path / 'out.csv', sweep, extent)
    with ThreadPoolExecutor(1) as executor:
        _fill(table, sweep, executor, False, extent.periods)
    table.close()
    assert capsys.readouterr().err == (
        'note: sweeping, runs: 100 of 200\nnote: sweeping, runs: 200 of 200\n'
    )


def test_help_has_an_example() -> None:
    assert 'Example: nadrc sweep config/sweeps/' in nadrc('--help').output


def test_a_sweep_is_no_scenario_and_that_is_said(file: Path) -> None:
    with pytest.raises(ValueError, match='this is a sweep, not a scenario: nadrc sweep runs it'):
        load(file)
