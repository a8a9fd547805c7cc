"""
Many runs of which only the figures of merit are kept, as ``nadrc sweep`` makes them.

    python -m bench.batch

A run is 10 s at 1 kHz on the plant of the paper, with a seed of its own, in compiled threads. On
one core and on two it is the same process that is given one core or two, in turns of which the
best counts: the others tell what else the machine had to do. What two cores are worth here is told
by the loop in C (loop.c), which does the same in as many threads. Memory is the peak of a
process of its own, Python, NumPy and numba included. How the cost grows is measured on the
``chain``, which there is for every order, on one core, in turns and by the best as well.

Keys: ``batch.runs_per_s_1core`` and ``.runs_per_s_2core`` [1/s], ``.c_per_s_1core`` and
``.c_per_s_2core`` of the loop in C; ``.peak_mb`` of 10^5 short runs, ``.peak_mb_<n>_steps`` of a
few with that many steps [MB]; ``.us_per_run_<case>`` [us].
Samples: runs per second of each turn, and microseconds per run of each turn and case.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
import os
from resource import getrusage, RUSAGE_SELF
import subprocess
import sys
from time import perf_counter
from typing import Any

import attrs
from bench.results import save, show
from bench.simulate import c_loop, EXPERIMENT, Run, SETTINGS
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.simulation.batch import simulate_batch
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.plants import Chain

RUNS = 10_000
TURNS, GROWTH_TURNS = 4, 8
MANY_RUNS, SHORT = 100_000, 0.01
LENGTHS = (10_000, 1_000_000)
Case = tuple[Experiment, ControllerSettings, int]


def lasting(seconds: float, experiment: Experiment = EXPERIMENT) -> Experiment:
    return attrs.evolve(experiment, duration=seconds)


def time_runs(experiment: Experiment, settings: ControllerSettings, runs: int) -> float:
    """Return how long that many runs take [s]."""
    start = perf_counter()
    simulate_batch(experiment, [settings], range(runs), compiled=True)
    return perf_counter() - start


@contextmanager
def cores(count: int) -> Iterator[None]:
    """Give that many cores to the threads that are started in here."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(allowed)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def rates(experiment: Experiment, runs: int, turns: int) -> dict[str, list[float]]:
    """Return the runs per second of each turn, on one core and on two, and those of the C loop."""
    each = runs // turns
    found: dict[str, list[float]] = {}
    by_hand = [c_loop(experiment) for _ in range(2)]
    time_runs(experiment, SETTINGS, 1)  # what is compiled, or read from disk, is so now
    for _ in range(turns):
        for count in (1, 2):
            with cores(count):
                took = time_runs(experiment, SETTINGS, each)
                found.setdefault(f'runs_per_s_{count}core', []).append(each / took)
                loops = [loop[0] for loop in by_hand[:count] if loop is not None]
                if loops:
                    times = max(each // 8, 1)
                    took = time_loops(loops, times)
                    found.setdefault(f'c_per_s_{count}core', []).append(count * times / took)
    return found


def time_loops(loops: list[Run], times: int) -> float:
    """Return how long it takes to run each of these so many times, in a thread of its own [s]."""

    def repeat(loop: Run) -> None:
        for _ in range(times):
            loop()

    start = perf_counter()
    with ThreadPoolExecutor(len(loops)) as threads:
        list(threads.map(repeat, loops))
    return perf_counter() - start


def cases(steps: int, runs: int) -> dict[str, Case]:
    """Return the base case and those that differ from it in one number."""

    def case(n: int = 2, k: int = 2, longer: int = 1, more: int = 1) -> Case:
        experiment = attrs.evolve(
            EXPERIMENT,
            plant=Chain(order=n, damping=1.0),
            initial_state=(0.0,) * n,
            duration=longer * steps * EXPERIMENT.period,
        )
        structure = 'nested' if k > 1 else 'conventional'
        settings = attrs.evolve(SETTINGS, plant_order=n, structure=structure, levels=max(k, 2))
        return experiment, settings, more * runs

    return {
        'base': case(),
        'k1': case(k=1),
        'k4': case(k=4),
        'n1': case(n=1),
        'n4': case(n=4),
        '10x_steps': case(longer=10),
        '10x_runs': case(more=10),
    }


def growth(steps: int, runs: int, turns: int) -> dict[str, list[float]]:
    """Return the time per run [us] of each turn, by case."""
    found: dict[str, list[float]] = {name: [] for name in cases(steps, runs)}
    with cores(1):
        for turn in range(-1, turns):
            for name, (experiment, settings, count) in cases(steps, runs).items():
                took = time_runs(experiment, settings, 1 if turn < 0 else count)
                if turn >= 0:  # the first is for compiling
                    found[name].append(1e6 * took / count)
    return found


def peak_memory(runs: int, seconds: float) -> float:
    """Return the peak memory [MB] of a process that makes so many runs of so many seconds."""
    command = [sys.executable, '-m', 'bench.batch', str(runs), str(seconds)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return float(done.stdout)


def child(runs: int, seconds: float) -> None:
    time_runs(lasting(seconds), SETTINGS, runs)
    print(getrusage(RUSAGE_SELF).ru_maxrss / 1024.0)


def main(
    experiment: Experiment = EXPERIMENT,
    runs: int = RUNS,
    turns: int = TURNS,
    many_runs: int = MANY_RUNS,
    lengths: tuple[int, ...] = LENGTHS,
    growth_turns: int = GROWTH_TURNS,
    growth_runs: int = 20,
    **where: Any,
) -> None:
    speed = rates(experiment, runs, turns)
    cost = growth(experiment.steps // 10, growth_runs, growth_turns)
    found = {name: max(each) for name, each in speed.items()}
    found['peak_mb'] = peak_memory(many_runs, SHORT)
    for steps in lengths:
        found[f'peak_mb_{steps}_steps'] = peak_memory(2, steps * EXPERIMENT.period)
    for name, each in cost.items():
        found[f'us_per_run_{name}'] = min(each)
    save('batch', found, speed | cost, **where)
    show('batch', {name: {'': value} for name, value in found.items()}, FOOTNOTE)


FOOTNOTE = (
    'Runs of 10 s at 1 kHz; peak_mb: 10^5 runs of 10 steps; us_per_run: 1000 steps of n = 2 and '
    'K = 2, or with that one number changed.'
)

if __name__ == '__main__':
    if len(sys.argv) > 1:
        child(int(sys.argv[1]), float(sys.argv[2]))
    else:
        main()
