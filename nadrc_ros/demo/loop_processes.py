"""The four nodes of a loop as processes: started together, watched, and stopped in order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
import signal
import subprocess
import sys
import time

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.demo.loop_parameters import node_parameters
from nadrc_ros.ros.children import start_child
from nadrc_ros.ros.runtime import LOCKED_UP, stop_signals_go_to
from nadrc_ros.scenario import Scenario
from nadrc_ros.scenario.parameter_files import parameter_text

NODES = ('plant', 'reference', 'recorder', 'controller')
# How long [s] a node may take to end before it is killed.
_STOP_TIME = 3.0


class GraphError(UserError):
    """A node failed, or did not answer in time; the message is for the user."""


class Loop:
    """
    The four node processes of one controller, in a namespace of its name; ``blind`` at the start.

    Parameters
    ----------
    scenario, name, lockstep
        What runs.
    directory
        Where the run, the parameter file and the logs of the nodes go.

    """

    def __init__(self, scenario: Scenario, name: str, directory: Path, lockstep: bool) -> None:
        self.name = name
        self.settings = scenario.controllers[name]
        self.blind = scenario.faults.blind
        self.directory = directory
        directory.mkdir(parents=True, exist_ok=True)
        self.parameter_file = directory / 'parameters.yaml'
        parameters = node_parameters(scenario, name, directory / 'runs', lockstep)
        self.parameter_file.write_text(
            parameter_text({f'/{name}/{node}': p for node, p in parameters.items()}),
            encoding='utf-8',
        )
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self) -> None:
        """Start the nodes."""
        for node in NODES:
            self.processes[node] = self._start(node)

    def _start(self, node: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, '-m', f'nadrc_ros.nodes.{node}', '--ros-args']
        command += ['-r', f'__ns:=/{self.name}', '--params-file', str(self.parameter_file)]
        with self.log(node).open('wb') as log:
            return start_child(command, stdout=log, stderr=subprocess.STDOUT)

    def log(self, node: str) -> Path:
        """Return the file that holds what a node printed."""
        return self.directory / f'{node}.log'

    def failure(self) -> str:
        """Return which node ended in failure and what it said last, empty if none did."""
        for node, process in self.processes.items():
            if process.poll() not in (None, 0, LOCKED_UP):
                lines = self.log(node).read_text(encoding='utf-8', errors='replace').splitlines()
                said = lines[-1] if lines else 'it printed nothing'
                return f'/{self.name}/{node} ended with exit code {process.returncode}: {said}'
        return ''

    @property
    def running(self) -> bool:
        """Tell whether any node still runs."""
        return any(process.poll() is None for process in self.processes.values())

    def run_folder(self) -> Path:
        """Return the folder that the recorder made."""
        return max((self.directory / 'runs').iterdir(), key=lambda path: path.stat().st_mtime)

    def stop(self) -> None:
        """Interrupt the controller, then the others; kill what does not end."""
        for group in (['controller'], ['plant', 'reference'], ['recorder']):
            nodes = [node for node in group if node in self.processes]
            for node in nodes:
                if self.processes[node].poll() is None:
                    self.processes[node].send_signal(signal.SIGINT)
            end = time.monotonic() + _STOP_TIME
            for node in nodes:
                try:
                    self.processes[node].wait(max(0.0, end - time.monotonic()))
                except subprocess.TimeoutExpired:
                    self.processes[node].kill()
                    self.processes[node].wait()


def check(loops: Sequence[Loop]) -> None:
    """Raise :class:`GraphError` when a node of one of the loops has failed."""
    for loop in loops:
        if failure := loop.failure():
            raise GraphError(failure)


@contextmanager
def running(
    scenario: Scenario, names: Sequence[str], directory: Path, *, lockstep: bool
) -> Iterator[list[Loop]]:
    """Start loops, and stop them however the block is left; any stop signal is like Ctrl-C."""
    loops: list[Loop] = []
    received: list[int] = []
    with stop_signals_go_to(signal.default_int_handler):
        try:
            for name in names:
                loops.append(Loop(scenario, name, directory / name, lockstep))
                # a process that was just made must not go unnoticed
                with stop_signals_go_to(lambda number, _: received.append(number)):
                    loops[-1].start()
                if received:
                    raise KeyboardInterrupt
            yield loops
        finally:
            # A second Ctrl-C must not leave nodes behind.
            with stop_signals_go_to(signal.SIG_IGN):
                for loop in loops:
                    loop.stop()
