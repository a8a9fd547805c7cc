"""
From the start of the controller's process to its first command computed from a measurement.

    python -m bench.start_up

The plant is already running and noisy. Until the law acts the safe command 0 is sent, and the
first one of the law equals it, so the time is that at which another process receives the first one
that is not 0: with a tick of 5 ms and the discovery in it. Some starts take 1 to 3 s more, in
which the process idles until Fast DDS has discovered the plant. So the same is measured, in turns,
of a bare node (bare_node.py) that returns each measurement. All nodes end in an orderly way: those
that do not are remembered for 20 s, and in that time discovery is slow.

Own imports are what is left of the imports when ROS (with PyYAML, which rclpy imports too), NumPy
and the standard library are already there: this package and attrs. They are timed in a process of
their own.

Keys: ``start_up.first_command_s``, ``.bare_node_s`` and ``.own_imports_s`` [s], medians, and
``.fastest_first_command_s`` and ``.slowest_first_command_s`` [s]. Samples [s], one for each start.
"""

from __future__ import annotations

import subprocess
import sys
from time import monotonic, time_ns
from typing import Any

from bench.processes import BARE, CONTROLLER, environment, process
from bench.results import save, show
from nadrc_ros.ros.runtime import private_domain
from nadrc_ros.ros.topics import Info, Receive, receive
import numpy as np
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

STARTS = 7
PATIENCE = 60.0
OWN = ('nadrc_ros', 'attr', 'attrs')
NODES = {'first_command_s': CONTROLLER, 'bare_node_s': BARE}
PLANT = 'nadrc_ros.nodes.plant'
# Damped and at rest without a command: it can wait for the next controller.
PLANT_PARAMETERS = {'plant': 'chain', 'damping': '1.0', 'noise_variance': '1e-4'}


class Listener:
    """Hears when a topic first has a value that is not 0."""

    def __init__(self, context: Context) -> None:
        self.node = Node('listener', context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.heard: dict[str, float] = {}
        self._since = 0
        for topic in ('measurement', 'command'):
            receive(self.node, topic, self._taker(topic))

    def _taker(self, topic: str) -> Receive:
        def take(value: float, info: Info) -> None:
            # not what the node before has left in the queue
            if value != 0.0 and info['source_timestamp'] > self._since:
                self.heard.setdefault(topic, monotonic())

        return take

    def wait(self, topic: str) -> float:
        """Return when that was, from now on [s]."""
        self._since = time_ns()
        self.heard.clear()
        end = monotonic() + PATIENCE
        while topic not in self.heard:
            if monotonic() > end:
                raise RuntimeError(f'nothing came on the topic {topic} in {PATIENCE:g} s')
            self.executor.spin_once(timeout_sec=1.0)
        return self.heard[topic]


def first_commands(starts: int) -> dict[str, list[float]]:
    """Return the time from the start of a process to its first command, of each start [s]."""
    context = Context()
    context.init()
    listener = Listener(context)
    found: dict[str, list[float]] = {name: [] for name in NODES}
    with process(PLANT, **PLANT_PARAMETERS):
        for name, module in list(NODES.items()) * starts:
            listener.wait('measurement')
            with process(module) as started:
                found[name].append(listener.wait('command') - started.start)
            while listener.node.count_publishers('command'):
                listener.executor.spin_once(timeout_sec=0.05)
    listener.node.destroy_node()
    context.shutdown()
    return found


def python(code: str, *arguments: str) -> str:
    """Return what a fresh interpreter prints."""
    command = [sys.executable, '-c', code, *arguments]
    return subprocess.run(
        command, check=True, capture_output=True, text=True, env=environment()
    ).stdout


def own_imports(starts: int) -> list[float]:
    """Return how long the controller takes to import when all else it needs is there [s]."""
    listed = python(f'import sys, {CONTROLLER}; print(*sys.modules)').split()
    others = [name for name in listed if name.split('.')[0] not in (*OWN, '__main__')]
    return [float(python(TIME_IMPORT, *others)) for _ in range(starts)]


TIME_IMPORT = f"""
from importlib import import_module
import sys
from time import perf_counter
for name in sys.argv[1:]:
    import_module(name)
start = perf_counter()
import {CONTROLLER}
print(perf_counter() - start)
"""


def main(starts: int = STARTS, **where: Any) -> None:
    private_domain(keep=True)
    samples = first_commands(starts) | {'own_imports_s': own_imports(starts)}
    found = {name: float(np.median(times)) for name, times in samples.items()}
    found['fastest_first_command_s'] = min(samples['first_command_s'])
    found['slowest_first_command_s'] = max(samples['first_command_s'])
    save('start_up', found, samples, **where)
    show('start_up', {name: {'s': value} for name, value in found.items()}, FOOTNOTE)


FOOTNOTE = 'From the start of the process, with the plant already running.'

if __name__ == '__main__':
    main()
