"""What a person at the terminals would do to running loops: look, enable, retune, wait."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.demo.graph import expected_readers, Loop
from nadrc_ros.records.recording import SUMMARY
from nadrc_ros.ros.graph import missing_readers
from nadrc_ros.ros.parameter_watch import ASK_AGAIN
from nadrc_ros.ros.runtime import make_executor, spin_for
from nadrc_ros.ros.topics import receive
from nadrc_ros.simulation.experiment import Retune
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

READY_TIME = 30.0
ANSWER_TIME = 5.0
SETTLE_TIME = 0.5

# Called with the time since the start [s] and the ITAE of each loop so far.
Progress = Callable[[float, dict[str, float]], None]


class GraphError(UserError):
    """A node failed, or did not answer in time; the message is for the user."""


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
        self._enable = {
            loop.name: self._node.create_client(SetBool, f'/{loop.name}/controller/enable')
            for loop in loops
        }
        self._set = {
            loop.name: self._node.create_client(
                SetParametersAtomically, f'/{loop.name}/controller/set_parameters_atomically'
            )
            for loop in loops
        }
        for loop in loops:
            receive(self._node, f'/{loop.name}/recorder/itae', self._itae_taker(loop.name))

    def wait_until_ready(self) -> None:
        """Wait until every node is there, every topic has its readers, and these hear it."""
        end = time.monotonic() + READY_TIME
        while missing := self._missing():
            check(self.loops)
            if time.monotonic() > end:
                raise GraphError(f'after {READY_TIME:g} s there is still no {missing}')
            spin_for(self._executor, 0.05)
        spin_for(self._executor, SETTLE_TIME)

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
        end = time.monotonic() + ANSWER_TIME
        while not all(f'/{loop.name}/controller' in self.diagnostics for loop in self.loops):
            if time.monotonic() > end:
                raise GraphError('the controllers did not report on /diagnostics')
            spin_for(self._executor, 0.01)
        self.at_end = dict(self.diagnostics)

    def wait_until_recorded(self) -> None:
        """Wait for the recorders' summaries."""
        end = time.monotonic() + ANSWER_TIME
        while not all((loop.run_folder() / SUMMARY).exists() for loop in self.loops):
            check(self.loops)
            if time.monotonic() > end:
                raise GraphError('the recorders did not end their runs')
            spin_for(self._executor, 0.05)

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

    def _missing(self) -> str:
        for loop in self.loops:
            expected = {
                f'/{loop.name}/{topic}': names
                for topic, (_, names) in expected_readers(loop.settings, lockstep=False).items()
            }
            for topic, name in missing_readers(self._node, f'/{loop.name}', expected):
                return f'reader {name} of {topic}'
            heard = self.diagnostics.get(f'/{loop.name}/controller', {})
            signals = {'reference'} if loop.blind else {'measurement', 'reference'}
            for signal in sorted(signals):
                if not isfinite(float(heard.get(f'{signal}_age', 'inf'))):
                    return f'{signal} at /{loop.name}/controller'
            waiting = self.diagnostics.get(f'/{loop.name}/recorder', {}).get('waiting_for', 'all')
            if not {'all', 'output', *signals}.isdisjoint(waiting.split()):
                return f'signals at /{loop.name}/recorder'
            for client in (self._enable[loop.name], self._set[loop.name]):
                if not client.service_is_ready():
                    return f'service {client.srv_name}'
        return ''

    def _retune(self, retune: Retune) -> None:
        parameters: list[ParameterMessage] = [
            Parameter(
                key, value=list(value) if isinstance(value, tuple) else value
            ).to_parameter_msg()
            for key, value in retune.settings.items()
        ]
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
        end = time.monotonic() + ANSWER_TIME
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

    def _itae_taker(self, name: str) -> Any:
        def take(value: float, _: object) -> None:
            self.itae[name] = value

        return take


def check(loops: list[Loop]) -> None:
    """Raise :class:`GraphError` when a node of one of the loops has failed."""
    for loop in loops:
        if failure := loop.failure():
            raise GraphError(failure)
