"""Runs a scenario on the ROS graph, every node its own process: in real time or in lockstep."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import json
from pathlib import Path
import signal
import time
from typing import Any

import attrs
from nadrc_ros.demo.graph import Loop
from nadrc_ros.demo.operation import check, Operator, Progress
from nadrc_ros.records.recording import read_samples, SUMMARY
from nadrc_ros.ros.runtime import init_ros, stop_signals
from nadrc_ros.scenario import Scenario
import rclpy


@attrs.frozen(kw_only=True)
class Run:
    """What one loop left: its summary, its samples by column, what its controller counted."""

    folder: Path
    summary: dict[str, Any]
    samples: dict[str, list[float]]
    diagnostics: dict[str, float]


def run_lockstep(
    scenario: Scenario, directory: Path, tell: Callable[[str], None]
) -> dict[str, Run]:
    """
    Run each loop in lockstep, one after the other; retunes are left out.

    Raises
    ------
    GraphError
        When a node fails.

    """
    runs = {}
    for name in scenario.controllers:
        tell(name)
        with _loops(scenario, [name], directory, lockstep=True) as (loop,):
            while loop.running:
                check([loop])
                time.sleep(0.05)
            check([loop])
            runs[name] = _collect(loop, {})
    return runs


def run_realtime(
    scenario: Scenario, directory: Path, progress: Progress, keep_open: Callable[[], None] | None
) -> dict[str, Run]:
    """
    Run all loops side by side in real time, closed at the same moment, and retune on the way.

    Raises
    ------
    GraphError
        When a node fails, does not appear, or refuses a retune.

    """
    init_ros()
    try:
        with _loops(scenario, list(scenario.controllers), directory, lockstep=False) as loops:
            operator = Operator(loops)
            operator.wait_until_ready()
            operator.enable()
            operator.follow(scenario.duration, list(scenario.retunes), progress)
            operator.ask_for_counts()
            operator.wait_until_recorded()
            runs = {loop.name: _collect(loop, operator.counted(loop)) for loop in loops}
            if keep_open is not None:
                keep_open()
            return runs
    finally:
        rclpy.try_shutdown()


@contextmanager
def _loops(
    scenario: Scenario, names: list[str], directory: Path, *, lockstep: bool
) -> Iterator[list[Loop]]:
    """Start loops, and stop them however the block is left; any stop signal is like Ctrl-C."""
    loops: list[Loop] = []
    numbers = stop_signals()
    before = [signal.signal(number, signal.default_int_handler) for number in numbers]
    try:
        for name in names:
            loops.append(Loop(scenario, name, directory / name, lockstep))
            with _undisturbed():
                loops[-1].start()
        yield loops
    finally:
        # A second Ctrl-C must not leave nodes behind.
        for number in numbers:
            signal.signal(number, signal.SIG_IGN)
        for loop in loops:
            loop.stop()
        for number, handler in zip(numbers, before):
            signal.signal(number, handler)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Let a stop signal come after the block: a process just made must not go unnoticed."""
    signals: list[int] = []
    numbers = stop_signals()
    before = [signal.signal(n, lambda received, _: signals.append(received)) for n in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before):
            signal.signal(number, handler)
    if signals:
        raise KeyboardInterrupt


def _collect(loop: Loop, diagnostics: dict[str, float]) -> Run:
    folder = loop.run_folder()
    return Run(
        folder=folder,
        summary=json.loads((folder / SUMMARY).read_text(encoding='utf-8')),
        samples=read_samples(folder),
        diagnostics=diagnostics,
    )
