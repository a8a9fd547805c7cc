"""Many runs: their order, what is handed out at once, and what Ctrl-C leaves."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
import gc
import os
from pathlib import Path
import signal
import subprocess
import sys
import tracemalloc
from typing import Any
import weakref

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import loads
from nadrc_ros.simulation import batch, loop
from nadrc_ros.simulation.batch import (
    _TASKS_AHEAD,
    batch_size,
    run_metrics,
    simulate_batch,
    stream,
)
from nadrc_ros.simulation.experiment import Experiment
import pytest

ROOT = Path(__file__).parents[1]
TEXT = """
plant: {name: paper, a3: %s}
reference: {signal: cosine}
noise: {variance: 1e-4}
rate: 100
duration: 0.3
controllers: {nested: {}}
"""
SCRIPT = f"""
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import loads
from nadrc_ros.simulation.batch import simulate_batch

def tell(done, count):
    if done == 100:
        print('going', flush=True)

if __name__ == '__main__':
    one = loads('''{TEXT % 0.2}''').experiment
    found = simulate_batch(
        one, [ControllerSettings()], range(1000), compiled=False, progress=tell
    )
    print(len(found))
"""
# Between the two lines with which a task comes into the books of the executor and its queue.
INTERRUPTED = """
from nadrc_ros.simulation import batch

def own_workers(fast, make=batch.own_workers):
    workers = make(fast)
    put, left = workers._work_ids.put, iter(range(4))

    def interrupted(task):
        if next(left) == 3:
            raise KeyboardInterrupt
        put(task)

    workers._work_ids.put = interrupted
    return workers

batch.own_workers = own_workers
"""
SETTINGS = [ControllerSettings(), ControllerSettings(structure='conventional')]


def experiment(a3: float = 0.2) -> Experiment:
    return loads(TEXT % a3).experiment


class AtOnce(Executor):
    """Does a task when it is submitted; remembers the futures as long as somebody needs them."""

    def __init__(self) -> None:
        self.futures: weakref.WeakSet[Future[Any]] = weakref.WeakSet()
        self.most = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        self.futures.add(future)
        self.most = max(self.most, len(self.futures))
        return future


class Stuck(AtOnce):
    """Does the first task only, and is interrupted when it is given the tenth."""

    def __init__(self, futures: list[Future[Any]]) -> None:
        super().__init__()
        self.given = futures

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.given.append(Future() if self.given else super().submit(fn, *args))
        if len(self.given) == 10:
            raise KeyboardInterrupt
        return self.given[-1]


def test_several_plants_are_run_in_the_order_of_nested_loops() -> None:
    plants = [experiment(0.1), experiment(0.4)]
    seeds = (3, 1)
    expected = [
        run_metrics(one, settings, seed, False)
        for one in plants
        for settings in SETTINGS
        for seed in seeds
    ]
    assert len({run.itae for run in expected}) == len(expected)
    assert simulate_batch(plants, SETTINGS, seeds, compiled=False) == expected
    with ThreadPoolExecutor(2) as threads:
        assert simulate_batch(plants, SETTINGS, seeds, executor=threads) == expected
    assert simulate_batch([], SETTINGS, seeds) == []


def test_progress_is_told_in_order_to_the_end() -> None:
    told: list[tuple[int, int]] = []
    simulate_batch(
        experiment(),
        SETTINGS,
        range(150),
        executor=AtOnce(),
        compiled=False,
        progress=lambda *now: told.append(now),
    )
    assert told[-1] == (300, 300) and told == sorted(told) and len(told) >= 2


def test_ctrl_c_returns_what_is_done() -> None:
    def interrupt(done: int, _: int) -> None:
        if done >= 100:
            raise KeyboardInterrupt

    kwargs: Any = {'executor': AtOnce(), 'compiled': False}
    whole = simulate_batch(experiment(), SETTINGS, range(150), **kwargs)
    part = simulate_batch(experiment(), SETTINGS, range(150), progress=interrupt, **kwargs)
    assert 100 <= len(part) < len(whole) == 300
    assert part == whole[: len(part)]


def test_ctrl_c_on_a_terminal_is_no_matter_of_the_processes() -> None:
    process = subprocess.Popen(
        [sys.executable, '-c', SCRIPT],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == 'going\n'
    os.killpg(process.pid, signal.SIGINT)
    out, errors = process.communicate(timeout=300.0)
    assert (process.returncode, errors) == (0, '')
    assert 0 < int(out.split()[-1]) < 1000


def test_ctrl_c_while_a_task_is_handed_out_does_not_wait_for_it_for_ever() -> None:
    command = [sys.executable, '-c', INTERRUPTED + SCRIPT]
    done = subprocess.run(
        command, check=False, cwd=ROOT, capture_output=True, text=True, timeout=60.0
    )
    assert (done.returncode, done.stderr) == (0, '')
    assert 0 < int(done.stdout.split()[-1]) < 1000


def test_without_the_compiler_all_cores_are_used_by_processes() -> None:
    assert isinstance(batch.own_workers(True), ThreadPoolExecutor)
    with batch.own_workers(False) as workers:
        assert isinstance(workers, ProcessPoolExecutor)


def test_a_bounded_number_of_tasks_is_under_way() -> None:
    executor = AtOnce()
    count = 3 * _TASKS_AHEAD
    drawn = 0

    def tasks() -> Any:
        nonlocal drawn
        for drawn in range(count):
            yield (drawn,)

    found = stream(executor, abs, tasks())
    assert next(found) == 0 and drawn == 0  # the first alone
    assert next(found) == 1 and drawn <= _TASKS_AHEAD
    assert list(found) == list(range(2, count))
    assert executor.most <= _TASKS_AHEAD + 2


def test_what_was_not_begun_is_cancelled_when_the_reader_goes() -> None:
    waiting: list[Future[Any]] = []
    with pytest.raises(KeyboardInterrupt):
        list(stream(Stuck(waiting), abs, ((i,) for i in range(20))))
    assert [future.cancelled() for future in waiting[:9]] == [False] + [True] * 8


@pytest.mark.parametrize('fast', [True, False])
def test_a_task_is_neither_too_long_nor_too_short(fast: bool) -> None:
    limit = batch._TASK_PERIODS[fast]
    assert batch_size(1000, 1000 * 10 * limit, fast) == 1
    assert batch_size(1000, 1000 * limit // 10, fast) == 10
    assert batch_size(10**5, 10**5, fast) == batch._TASK_RUNS
    assert batch_size(5, 0, fast) == batch._TASK_RUNS


def test_memory_does_not_grow_with_the_length_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, '_NOISE_BLOCK', 128)

    def peak(periods: int) -> int:
        one = attrs.evolve(experiment(), duration=periods / 100.0)
        gc.collect()
        tracemalloc.start()
        simulate_batch(one, SETTINGS[:1], [1], executor=AtOnce(), compiled=False)
        top = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return top

    peak(200)
    assert peak(2000) < 1.2 * peak(200)
