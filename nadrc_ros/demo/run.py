"""
Runs a scenario on the ROS graph, every node its own process: in real time or in lockstep.

In real time an operator does what a person at the terminals would: look, enable, retune, wait.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import json
from math import isfinite
from pathlib import Path
import time
from typing import Any

import attrs
from diagnostic_msgs.msg import DiagnosticArray
from nadrc_ros.demo.loop_parameters import expected_readers, node_parameters
from nadrc_ros.demo.loop_processes import check, GraphError, Loop, running
from nadrc_ros.records.recording import read_samples, SUMMARY
from nadrc_ros.ros.arguments import overrides
from nadrc_ros.ros.graph import missing_readers
from nadrc_ros.ros.parameter_watch import ASK_AGAIN
from nadrc_ros.ros.runtime import init_ros
from nadrc_ros.ros.topics import receive
from nadrc_ros.ros.versions import make_executor, spin_for
from nadrc_ros.scenario import Scenario
from nadrc_ros.simulation.experiment import Retune
from rcl_interfaces.srv import SetParametersAtomically
import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool

# The nodes are there within so long, and services answer [s].
_READY_TIME, _ANSWER_TIME = 30.0, 5.0
# What was discovered works a little later [s].
_SETTLE_TIME = 0.5

# Called with the time since the start [s] and the ITAE of each loop so far.
Progress = Callable[[float, dict[str, float]], None]


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
    _refuse_cascades(scenario, directory)
    for name in scenario.controllers:
        tell(name)
        with running(scenario, [name], directory, lockstep=True) as (loop,):
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
    _refuse_cascades(scenario, directory)
    init_ros()
    try:
        with running(scenario, list(scenario.controllers), directory, lockstep=False) as loops:
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


def _refuse_cascades(scenario: Scenario, directory: Path) -> None:
    """Refuse them before any loop runs."""
    for name in scenario.controllers:
        node_parameters(scenario, name, directory, lockstep=True)


def _collect(loop: Loop, diagnostics: dict[str, float]) -> Run:
    folder = loop.run_folder()
    return Run(
        folder=folder,
        summary=json.loads((folder / SUMMARY).read_text(encoding='utf-8')),
        samples=read_samples(folder),
        diagnostics=diagnostics,
    )


class Operator:
    """What a person at the terminals would do: look, enable, retune, wait."""

    def __init__(self, loops: list[Loop]) -> None:
        self.loops = loops
        self.diagnostics: dict[str, dict[str, str]] = {}
        self.at_start: dict[str, dict[str, str]] = {}
        self.at_end: dict[str, dict[str, str]] = {}
        self.itae: dict[str, float] = {}
        self._asked = 0.0
        self._node = Node('operator')
        self._executor = make_executor()
        self._executor.add_node(self._node)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._enable = self._clients(SetBool, 'enable')
        self._set = self._clients(SetParametersAtomically, 'set_parameters_atomically')
        for loop in loops:
            receive(self._node, f'/{loop.name}/recorder/itae', partial(self._on_itae, loop.name))

    def wait_until_ready(self) -> None:
        """Wait until every node is there, every topic has its readers, and these hear it."""
        self._wait(
            lambda: not self._missing(),
            _READY_TIME,
            lambda: f'after {_READY_TIME:g} s there is still no {self._missing()}',
        )
        spin_for(self._executor, _SETTLE_TIME)

    def enable(self) -> None:
        """Close all loops at the same moment."""
        self._asked = time.monotonic()
        self._call(self._enable, SetBool.Request(data=True))

    def follow(self, duration: float, retunes: list[Retune], progress: Progress) -> None:
        """
        Watch the run for ``duration`` seconds, retuning when it is time.

        Time counts from when the loops were asked to close: a retune then takes as long as that.
        """
        while (now := time.monotonic() - self._asked) < duration:
            check(self.loops)
            if retunes and retunes[0].time <= now:
                self._retune(retunes.pop(0))
            progress(now, self.itae)
            until = retunes[0].time if retunes else duration
            now = time.monotonic() - self._asked
            spin_for(self._executor, min(0.05, max(0.0, until - now)))

    def ask_for_counts(self) -> None:
        """Have every controller report now, as it does whenever it is enabled."""
        self.diagnostics.clear()
        self.enable()
        names = {f'/{loop.name}/controller' for loop in self.loops}
        complaint = 'the controllers did not report on /diagnostics'
        self._wait(lambda: names <= self.diagnostics.keys(), _ANSWER_TIME, lambda: complaint)
        self.at_end = dict(self.diagnostics)

    def wait_until_recorded(self) -> None:
        """Wait for the recorders' summaries."""
        self._wait(
            lambda: all((loop.run_folder() / SUMMARY).exists() for loop in self.loops),
            _ANSWER_TIME,
            lambda: 'the recorders did not end their runs',
        )

    def counted(self, loop: Loop) -> dict[str, float]:
        """Return periods, missed ones and latencies of a controller from start to end."""
        name = f'/{loop.name}/controller'
        first, last = self.at_start.get(name, {}), self.at_end.get(name, {})
        counts = {
            key: float(last[key]) - float(first.get(key, '0'))
            for key in ('periods', 'missed_periods')
            if key in last
        }
        return counts | {k: float(v) for k, v in last.items() if k.startswith('latency')}

    def _clients(self, kind: Any, service: str) -> dict[str, Any]:
        return {
            loop.name: self._node.create_client(kind, f'/{loop.name}/controller/{service}')
            for loop in self.loops
        }

    def _wait(
        self, there: Callable[[], bool], seconds: float, complaint: Callable[[], str]
    ) -> None:
        end = time.monotonic() + seconds
        while not there():
            check(self.loops)
            if time.monotonic() > end:
                raise GraphError(complaint())
            spin_for(self._executor, 0.02)

    def _missing(self) -> str:
        for loop in self.loops:
            expected = {
                f'/{loop.name}/{topic}': names
                for topic, (_, names) in expected_readers(loop.settings, lockstep=False).items()
            }
            for topic, name in missing_readers(self._node, f'/{loop.name}', expected):
                return f'reader {name} of {topic}'
            heard = self.diagnostics.get(f'/{loop.name}/controller', {})
            readers = expected[f'/{loop.name}/command']
            if int(heard.get('command_readers', 0)) < len(readers):
                return f'reader {" or ".join(readers)} of command at /{loop.name}/controller'
            signals = {'reference'} if loop.blind else {'measurement', 'reference'}
            for signal in sorted(signals):
                if not isfinite(float(heard.get(f'{signal}_age', 'inf'))):
                    return f'{signal} at /{loop.name}/controller'
            recorder = self.diagnostics.get(f'/{loop.name}/recorder', {})
            waiting = recorder.get('waiting_for', 'all')
            if not {'all', 'output', *signals}.isdisjoint(waiting.split()):
                return f'signals at /{loop.name}/recorder'
            if 'command' in recorder['unmatched'].split():
                return f'command at /{loop.name}/recorder'
            for client in (self._enable[loop.name], self._set[loop.name]):
                if not client.service_is_ready():
                    return f'service {client.srv_name}'
        return ''

    def _retune(self, retune: Retune) -> None:
        parameters = [each.to_parameter_msg() for each in overrides(retune.settings)]
        request = SetParametersAtomically.Request(parameters=parameters)
        for name, response in self._call(self._set, request).items():
            if not response.result.successful:
                reason = response.result.reason
                raise GraphError(f'/{name}/controller refused the retune: {reason}')

    def _call(self, clients: dict[str, Any], request: Any) -> dict[str, Any]:
        """
        Send one request to all at once and return the answers.

        Who does not answer is asked again: Fast DDS drops the answer to a client that a busy
        machine has not made known to the service in time.
        """
        answers: dict[str, Any] = {}
        end = time.monotonic() + _ANSWER_TIME
        while late := clients.keys() - answers.keys():
            if time.monotonic() > end:
                raise GraphError(f'no answer from the controller of {", ".join(sorted(late))}')
            futures = {name: clients[name].call_async(request) for name in late}
            again = time.monotonic() + ASK_AGAIN
            while not all(f.done() for f in futures.values()) and time.monotonic() < again:
                check(self.loops)
                spin_for(self._executor, 0.01)
            answers |= {name: future.result() for name, future in futures.items() if future.done()}
        return answers

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            values = {pair.key: pair.value for pair in status.values}
            self.diagnostics[status.name] = values
            if values.get('mode') == 'ok':  # a change of mode is reported at once
                self.at_start.setdefault(status.name, values)

    def _on_itae(self, name: str, value: float, _: object) -> None:
        self.itae[name] = value
