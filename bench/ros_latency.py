"""
From a measurement to the command that answers it: our controller against a node that only echoes.

    python -m bench.ros_latency

A third process is the plant: it sends noise as the measurement, on a steady timer, and takes the
commands. Both contestants are processes with the same executor and the same quality of service,
and run at the same time, each half a period after the other, so that they have the same machine.
The controller takes a step of the nested law with two levels for each measurement
(``trigger: measurement``).

A round trip is from before the measurement is published to when the callback of the plant has the
command. No measurement is sent while the last one is not answered: such a period is missed, and
counts with the time from when it was due, so that one long wait does not pass as one sample.

Keys: ``ros_latency.<rate>.<nadrc or echo>`` with ``.median_ms``, ``.p99_ms`` [ms],
``.cpu_percent`` of one core, the middleware's threads included, and ``.missed`` [% of periods].
Samples [ms], in the order taken.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import cycle
import random
from time import monotonic, perf_counter_ns, time_ns
from typing import Any

from bench.processes import BARE, CONTROLLER, Process, process
from bench.results import over, save, show
from nadrc_ros.ros.runtime import init_ros, private_domain
from nadrc_ros.ros.topics import Info, receive, Sender
from nadrc_ros.ros.versions import make_executor, spin_for
import numpy as np
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

RATES = (100, 500, 1000)
TURNS = 3
SECONDS = 8.0
WARM_UP = 1.0
PATIENCE = 30.0
# An answer that did not come by then never will [ns].
LOST = 500_000_000
CONTESTANTS = {'nadrc': CONTROLLER, 'echo': BARE}


class Trip:
    """The round trips through one contestant."""

    def __init__(self, node: Node, name: str) -> None:
        self.latencies: list[float] = []
        self.periods = self.missed = self.answers = 0
        self._due: list[int] = []
        self._sent = 0
        self._measurement = Sender(node, f'/{name}/measurement')
        receive(node, f'/{name}/command', self._take)

    def send(self) -> None:
        """Send a measurement, unless the last one is not answered yet."""
        now = perf_counter_ns()
        self.periods += 1
        if self._due and now - self._due[0] < LOST:
            self.missed += 1
            self._due.append(now)
            return
        self._due = [now]
        self._sent = time_ns()
        self._measurement.send(random.gauss(0.0, 1e-3))

    def _take(self, _: float, info: Info) -> None:
        now = perf_counter_ns()
        if self._due and info['source_timestamp'] >= self._sent:  # not one held before
            self.answers += 1
            self.latencies += [1e-6 * (now - due) for due in self._due]
            self._due = []

    def forget(self) -> None:
        """Begin to count."""
        self.latencies, self.periods, self.missed = [], 0, 0


class Plant:
    """Sends to each contestant in turn, and counts from the end of the warm-up on."""

    def __init__(self, rate: float) -> None:
        init_ros()
        node = Node('plant')
        self.trips = {name: Trip(node, name) for name in CONTESTANTS}
        turns = cycle(self.trips.values())
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(0.5 / rate, lambda: next(turns).send(), clock=steady)
        self._executor = make_executor()
        self._executor.add_node(node)

    def run(self, seconds: float, processes: Mapping[str, Process]) -> dict[str, float]:
        """Return the processor time of each process while that was measured [% of a core]."""
        end = monotonic() + PATIENCE
        while not all(trip.answers for trip in self.trips.values()):
            if monotonic() > end:
                raise RuntimeError(f'no answers in {PATIENCE:g} s')
            spin_for(self._executor, 0.1)
        spin_for(self._executor, WARM_UP)
        for trip in self.trips.values():
            trip.forget()
        begin, before = monotonic(), {name: process.cpu for name, process in processes.items()}
        spin_for(self._executor, seconds)
        took = monotonic() - begin
        return {name: 100.0 * (p.cpu - before[name]) / took for name, p in processes.items()}

    def close(self) -> None:
        self._executor.shutdown(timeout_sec=0.0)
        rclpy.shutdown()


def measure(rate: float, seconds: float) -> dict[str, dict[str, list[float]]]:
    """Return latencies [ms], share of periods missed [%] and load [%] of each contestant."""
    with ExitStack() as stack:
        processes = {
            name: stack.enter_context(
                process(module, namespace=f'/{name}', rate=rate, trigger='measurement')
            )
            for name, module in CONTESTANTS.items()
        }
        plant = Plant(rate)
        stack.callback(plant.close)
        load = plant.run(seconds, processes)
    return {
        name: {
            'ms': trip.latencies,
            'missed': [100.0 * trip.missed / trip.periods],
            'cpu_percent': [load[name]],
        }
        for name, trip in plant.trips.items()
    }


def main(
    rates: Sequence[int] = RATES, turns: int = TURNS, seconds: float = SECONDS, **where: Any
) -> None:
    private_domain(keep=True)
    samples: dict[str, list[float]] = defaultdict(list)
    for rate in [*rates] * turns:
        for name, found in measure(float(rate), seconds).items():
            for what, values in found.items():
                samples[f'{rate}.{name}.{what}'] += values
    figures = {
        str(rate): {name: summary(samples, f'{rate}.{name}') for name in CONTESTANTS}
        for rate in rates
    }
    save('ros_latency', figures, samples, **where)
    for rate in rates:
        show(f'ros_latency, {rate} Hz', over('echo', figures[str(rate)], 'median_ms'), FOOTNOTE)


def summary(samples: Mapping[str, list[float]], name: str) -> dict[str, float]:
    return {
        'median_ms': float(np.median(samples[f'{name}.ms'])),
        'p99_ms': float(np.percentile(samples[f'{name}.ms'], 99)),
        'cpu_percent': float(np.mean(samples[f'{name}.cpu_percent'])),
        'missed': float(np.mean(samples[f'{name}.missed'])),
    }


FOOTNOTE = 'From before the measurement is published to the command in the callback of the plant.'

if __name__ == '__main__':
    main()
