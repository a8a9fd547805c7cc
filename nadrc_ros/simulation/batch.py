"""Many runs, of which only the figures of merit are kept, on all cores or on a cluster."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from itertools import islice, product
from typing import Any, TypeVar

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.loop import Loop, ROW_WIDTH
from nadrc_ros.simulation.metrics import MetricValues
from nadrc_ros.simulation.simulate import kernel_of
import numpy as np

T = TypeVar('T')
Run = tuple[Experiment, ControllerSettings, int]
# A task is long enough to make its way to another process not matter, about a tenth of a second,
# and short enough to wait for.
_TASK_RUNS = 100
_TASK_PERIODS = {True: 100_000, False: 5_000}  # compiled, in plain Python
# Tasks handed out at once: more than any cluster has workers, few enough to be held in memory.
_TASKS_AHEAD = 512


@attrs.frozen(kw_only=True)
class RunMetrics(MetricValues):
    """
    The figures of merit of a run, with those that need the truth about the disturbance.

    Attributes
    ----------
    remainder_itae
        Integral of t |L - d_1 - ... - d_k| for each level k [unit of y^(n), s^2]: of the errors
        e_3 = L - d_1 of the inner and zeta_3 = L - d_1 - d_2 of the outer observer in the paper
        (Abdul-Adheem & Ibraheem, nested linear extended state observers).

    """

    remainder_itae: tuple[float, ...]


def simulate_batch(
    experiment: Experiment | Sequence[Experiment],
    settings: Sequence[ControllerSettings],
    seeds: Sequence[int],
    *,
    executor: Executor | None = None,
    compiled: bool | None = None,
    say: Callable[[str], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[RunMetrics]:
    """
    Run every controller in every experiment with every seed, keeping the figures of merit only.

    Memory does not grow with the length of a run. Ctrl-C returns what is done: the first runs, in
    order, fewer than were asked for.

    Parameters
    ----------
    experiment
        What is done to each controller, with one plant or several; the seed of its noise is
        replaced.
    settings, seeds
        The runs are those of the first experiment, there of the first controller, there of the
        first seed; and so on, the seed changing fastest.
    executor
        Where the runs are done: any executor, as of a Dask client. By default threads of its own
        if the runs are compiled, which lets them use all cores, otherwise processes.
    compiled, say
        As in :func:`~nadrc_ros.simulation.simulate.simulate`.
    progress
        Called now and then with the number of runs that are done, and of all.

    """
    experiments = [experiment] if isinstance(experiment, Experiment) else experiment
    each = len(settings) * len(seeds)
    count, periods = len(experiments) * each, sum(one.steps for one in experiments) * each
    if not count:
        return []
    fast = None not in [kernel_of(one, periods, compiled, say) for one in experiments]
    runs: Iterator[Run] = product(experiments, settings, seeds)
    size = batch_size(count, periods, fast)
    tasks = iter(lambda: (list(islice(runs, size)), fast), ([], fast))
    workers = own_workers(fast) if executor is None else executor
    done: list[RunMetrics] = []
    try:
        for some in stream(workers, run_batch, tasks):
            done += some
            if progress is not None:
                progress(len(done), count)
    except KeyboardInterrupt:
        pass
    finally:  # Ctrl-C inside submit leaves a task that is never done: to wait for it is for ever
        if executor is None:
            workers.shutdown(cancel_futures=True)
    return done


def own_workers(fast: bool) -> Executor:
    """Return one worker per core: threads share what is compiled, which runs without the GIL."""
    return ThreadPoolExecutor() if fast else ProcessPoolExecutor(initializer=ignore_interrupts)


def ignore_interrupts() -> None:
    """Leave Ctrl-C, which goes to every process of a terminal, to the one that waits for this."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)


def batch_size(runs: int, periods: int, fast: bool) -> int:
    """Return how many of ``runs``, of ``periods`` in all, make a task."""
    return min(max(_TASK_PERIODS[fast] * runs // max(periods, 1), 1), _TASK_RUNS)


def stream(
    executor: Executor, function: Callable[..., T], tasks: Iterable[tuple[Any, ...]]
) -> Iterator[T]:
    """
    Yield ``function(*task)`` of each task in order, with a bounded number of them under way.

    The first runs alone, except in threads: what it compiles is then there for all. When the
    iterator is closed or fails, tasks that were not begun are cancelled.
    """
    pending: deque[Future[T]] = deque()
    ahead = _TASKS_AHEAD if isinstance(executor, ThreadPoolExecutor) else 1
    try:
        for task in tasks:
            pending.append(executor.submit(function, *task))
            if len(pending) >= ahead:
                yield pending.popleft().result()
                ahead = _TASKS_AHEAD
        while pending:
            yield pending.popleft().result()
    except BrokenExecutor:
        pending.clear()  # it tells them itself
        raise
    finally:
        for future in pending:
            future.cancel()


def run_batch(runs: list[Run], compiled: bool) -> list[RunMetrics]:
    """Return the figures of merit of some runs."""
    return [run_metrics(*run, compiled) for run in runs]


def run_metrics(
    experiment: Experiment,
    settings: ControllerSettings,
    seed: int,
    compiled: bool | None = None,
    say: Callable[[str], None] | None = None,
) -> RunMetrics:
    """Return the figures of merit of one run with noise of that seed."""
    noise = attrs.evolve(experiment.noise, seed=seed)
    one = attrs.evolve(experiment, noise=noise)
    loop = Loop(one, settings)
    loop.run(np.empty((0, ROW_WIDTH)), kernel_of(one, one.steps, compiled, say))
    values = attrs.asdict(loop.metrics.values())
    return RunMetrics(**values, remainder_itae=tuple(loop.remainders[: loop.levels]))
