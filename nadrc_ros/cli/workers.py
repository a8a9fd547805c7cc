"""Where runs are done: threads or processes of our own, or those of a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
import os
import signal
from threading import Thread

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.extras import MissingPackage

_CONNECT_TIMEOUT = 10.0


@contextmanager
def threads(jobs: int | None) -> Iterator[Executor]:
    """Give so many threads, by default one per core, for runs that are compiled."""
    executor = ThreadPoolExecutor(jobs or os.cpu_count())
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)


@contextmanager
def processes(jobs: int | None) -> Iterator[Executor]:
    """Give so many processes, by default one per core, that end with this one."""
    count = jobs or os.cpu_count() or 1
    executor = ProcessPoolExecutor(
        count, mp_context=get_context('spawn'), initializer=_end_with_parent
    )
    try:
        # Ctrl-C goes to every process of a terminal. The workers inherit that they wait with it
        # for ever; each of these tasks starts one.
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        for _ in range(count):
            executor.submit(int)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        yield executor
    except BaseException:
        # First what is waiting, or Python 3.11 complains of it; then what nobody waits for.
        executor.shutdown(wait=False, cancel_futures=True)
        for child in active_children():
            child.terminate()
            child.join()
        raise
    executor.shutdown()


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """
    Give the workers of the Dask scheduler at an address, such as tcp://host:8786.

    Raises
    ------
    UserError
        When Dask is not installed, or no scheduler answers there.
    BrokenExecutor
        When one task has taken several workers with it.

    """
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise MissingPackage('--dask', 'dask', 'sweep') from None
    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UserError(f'--dask {address}: no scheduler answers there ({error})') from None
    try:
        with client:
            yield client.get_executor()
    except KilledWorker as error:
        raise BrokenExecutor(str(error)) from None


def _end_with_parent() -> None:
    """Do not stay behind, waiting for work, when the parent is killed."""
    Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
