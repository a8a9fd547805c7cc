"""
Many axes in one process: our controllers against as many bare nodes, on one timer each.

    python -m bench.axes

A process has 1, 4, 16 or 64 axes at 100 Hz: ``controller --axes ...``, each axis with a step of
the nested law with two levels, and bare nodes (bare_node.py) that send back the last measurement.
They take turns. Another process is all the plants: it sends every measurement, at the same rate
and an arbitrary phase, and takes every command. On a machine with two cores it keeps one of them
busy, which with 64 axes is felt by both.

A period is missed when its command was not published, which is told by the numbers and the times
of publication that each command carries, as the plants see them. What is measured begins 5 s after
every axis was heard.

Keys: ``axes.<n>.missed`` [% of periods, all axes] and ``axes.<n>.cpu_percent`` of one core, the
middleware's threads included; ``axes.<n>.echo...`` the same of the bare nodes. Samples: the same,
for each turn; ``.late_ms`` is the time between commands of the first axis beyond a period [ms].
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from contextlib import closing
from time import monotonic
from typing import Any

import attrs
from bench.processes import BARE, CONTROLLER, Process, process
from bench.results import save, show
from nadrc_ros.ros.runtime import init_ros, private_domain
from nadrc_ros.ros.topics import Info, receive, Sender
from nadrc_ros.ros.versions import make_executor, spin_for
import numpy as np
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

COUNTS = (1, 4, 16, 64)
RATE = 100.0
TURNS = 2
SETTLE = 5.0
SECONDS = 10.0
PATIENCE = 120.0


@attrs.define
class Heard:
    """When the commands of an axis were published [ns], and their numbers."""

    times: list[int] = attrs.Factory(list)
    numbers: list[int] = attrs.Factory(list)

    def take(self, _: float, info: Info) -> None:
        self.times.append(info['source_timestamp'])
        self.numbers.append(info['publication_sequence_number'])

    @property
    def missed(self) -> float:
        """Return the share of periods without a command [%]."""
        due = (self.times[-1] - self.times[0]) * 1e-9 * RATE
        return max(0.0, 100.0 * (1.0 - (self.numbers[-1] - self.numbers[0]) / due))


class Plants:
    """Sends a measurement to every axis in each period, and hears the commands."""

    def __init__(self, axes: list[str]) -> None:
        init_ros()
        node = Node('plants')
        self.heard = {axis: Heard() for axis in axes}
        senders = [Sender(node, f'/{axis}/measurement') for axis in axes]
        for axis, heard in self.heard.items():
            receive(node, f'/{axis}/command', heard.take)
        k = 0

        def tick() -> None:
            nonlocal k
            k += 1
            for sender in senders:
                sender.send(1e-3 * (k % 7))

        node.create_timer(1.0 / RATE, tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._executor = make_executor()
        self._executor.add_node(node)

    def run(self, contestant: Process, settle: float, seconds: float) -> float:
        """Return the load [%] of the process while it was heard for so many seconds."""
        end = monotonic() + PATIENCE
        while not all(heard.times for heard in self.heard.values()):
            if monotonic() > end:
                raise RuntimeError(f'not all axes were heard in {PATIENCE:g} s')
            spin_for(self._executor, 0.1)
        spin_for(self._executor, settle)
        for heard in self.heard.values():
            heard.times, heard.numbers = [], []
        begin, before = monotonic(), contestant.cpu
        spin_for(self._executor, seconds)
        return 100.0 * (contestant.cpu - before) / (monotonic() - begin)

    def close(self) -> None:
        self._executor.shutdown(timeout_sec=0.0)
        rclpy.shutdown()


def measure(name: str, count: int, settle: float, seconds: float) -> dict[str, list[float]]:
    """Return what one process with so many axes came to."""
    axes = [f'a{i}' for i in range(count)]
    module, option = {'nadrc': (CONTROLLER, ['--axes']), 'echo': (BARE, [])}[name]
    with process(module, *option, *axes, rate=RATE) as contestant, closing(Plants(axes)) as plants:
        load = plants.run(contestant, settle, seconds)
    late = np.diff(plants.heard['a0'].times) * 1e-6 - 1e3 / RATE
    missed = float(np.mean([heard.missed for heard in plants.heard.values()]))
    return {'missed': [missed], 'cpu_percent': [load], 'late_ms': late.tolist()}


def main(
    counts: Sequence[int] = COUNTS,
    turns: int = TURNS,
    settle: float = SETTLE,
    seconds: float = SECONDS,
    **where: Any,
) -> None:
    private_domain(keep=True)
    samples: dict[str, list[float]] = defaultdict(list)
    for count in [*counts] * turns:
        for name in ('nadrc', 'echo'):
            for what, values in measure(name, count, settle, seconds).items():
                samples[f'{count}.{name}.{what}'] += values

    def mean(count: int, name: str) -> dict[str, float]:
        keys = 'missed', 'cpu_percent'
        return {key: float(np.mean(samples[f'{count}.{name}.{key}'])) for key in keys}

    figures = {str(n): {**mean(n, 'nadrc'), 'echo': mean(n, 'echo')} for n in counts}
    save('axes', figures, samples, **where)
    rows = {f'{n} {name}': mean(n, name) for n in counts for name in ('nadrc', 'echo')}
    show('axes', rows, FOOTNOTE)


FOOTNOTE = f'Axes in one process at {RATE:g} Hz; missed: % of all periods.'

if __name__ == '__main__':
    main()
