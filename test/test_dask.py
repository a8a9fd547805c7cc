"""`nadrc sweep` on a real Dask cluster: a scheduler and two workers by their own command lines."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from nadrc_ros.records.run_table import RunTable
from nadrc_ros.scenario.sweep import load_sweep, run_range
import pytest

ROOT = Path(__file__).parents[1]
ENVIRONMENT = {**os.environ, 'PYTHONPATH': str(ROOT)}
PATIENCE = 60.0
RUNS = 48
# 48 tasks of a run each, some 0.07 s in plain Python.
SWEEP = """
scenario:
  plant: {name: paper}
  reference: cosine
  noise: {variance: 1e-4}
  rate: 1000
  duration: 2.0
  controllers: {conventional: {structure: conventional}, nested: {}}
vary: {plant.a3: [0.1, 0.25]}
seeds: 12
"""


class Process:
    """A command line of Dask or of ours, killed in the end."""

    def __init__(self, log: Path, module: str, *arguments: object) -> None:
        self.log = log
        with log.open('w') as file:
            self.popen = subprocess.Popen(
                [sys.executable, '-m', module, *map(str, arguments)],
                cwd=log.parent,
                env=ENVIRONMENT,
                stdout=file,
                stderr=file,
            )

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *error: object) -> None:
        self.popen.kill()
        self.popen.wait()

    def wait_for(self, condition: str, path: Path, count: int = 1) -> None:
        """Wait until a text is so often in a file, and that this process lives."""
        deadline = time.monotonic() + PATIENCE
        while not path.exists() or path.read_text().count(condition) < count:
            assert self.popen.poll() is None, self.log.read_text()
            assert time.monotonic() < deadline, self.log.read_text()
            time.sleep(0.01)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, Process, list[Process]]]:
    """Address, scheduler and workers."""
    where = tmp_path / 'scheduler.json'
    local = ('--host', '127.0.0.1', '--no-dashboard', '--scheduler-file', where)
    with ExitStack() as running:
        scheduler = running.enter_context(
            Process(tmp_path / 'scheduler', 'distributed.cli.dask_scheduler', '--port', 0, *local)
        )
        scheduler.wait_for('\n}', where)
        workers = [
            running.enter_context(
                Process(
                    tmp_path / f'worker {number}',
                    'distributed.cli.dask_worker',
                    *('--no-nanny', '--nthreads', 1, '--local-directory', tmp_path, *local),
                )
            )
            for number in range(2)
        ]
        scheduler.wait_for('Register worker', scheduler.log, 2)
        yield json.loads(where.read_text())['address'], scheduler, workers


def test_a_worker_that_is_killed_in_the_middle_loses_nothing(
    cluster: tuple[str, Process, list[Process]], tmp_path: Path
) -> None:
    address, scheduler, workers = cluster
    file, out = tmp_path / 'sweep.yaml', tmp_path / 'out.csv'
    file.write_text(SWEEP)
    arguments = ('sweep', file, '--table', out, '--dask', address)
    with Process(tmp_path / 'nadrc', 'nadrc_ros.cli', *arguments) as nadrc:
        nadrc.wait_for('\n', out, 1 + RUNS // 12)
        workers[0].popen.send_signal(signal.SIGKILL)
        assert out.read_text().count('\n') < 1 + RUNS
        assert nadrc.popen.wait(PATIENCE) == 0, nadrc.log.read_text()
    assert 'Remove worker' in scheduler.log.read_text()
    sweep = load_sweep(file)
    table = RunTable(tmp_path / 'local.csv', sweep, sweep.check())
    table.append(run_range(sweep, 0, RUNS, False))
    table.close()
    assert out.read_bytes() == (tmp_path / 'local.csv').read_bytes()
