"""A rehearsal of commissioning: a plant and a controller of our own, with the truth hidden."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import inf
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.demo.loop_parameters import command_timeout, node_parameters
from nadrc_ros.ros.children import start_child
from nadrc_ros.scenario import Scenario
from nadrc_ros.scenario.parameter_files import ANY_CONTROLLER, parameter_text, Parameters
from nadrc_ros.simulation.integrate import Integrator, jacobian, substeps_for
from nadrc_ros.simulation.signals import Nothing
from nadrc_ros.tuning.commission.machine import Array
import numpy as np

NAMESPACE = '/rehearsal'
# Faster than that no rehearsal need be: the machine that does it has other things to do [Hz].
_FASTEST = 500.0
# A node has so long to end before it is killed [s].
_STOP_TIME = 3.0
# Bounds: of the range of the reference and of the command, and of the scenario's time.
_SHARE, _PATIENCE, _SAMPLES = 0.5, 0.25, 200
# The truth is that of a plant which the largest command has moved for so long [s].
_MOVED = 0.2
# What a controller node may know of a plant that nobody knows yet.
_KNOWN = (
    *('command_min', 'command_max', 'command_rate_limit', 'safe_command'),
    'measurement_period',
)


@attrs.frozen(kw_only=True)
class Truth:
    """What the plant of a rehearsal really is: its order, b0, dead time [s], noise and poles."""

    order: int
    b0: float
    delay: float
    noise: float
    poles: tuple[complex, ...]
    gain: float

    def b0_of(self, order: int) -> float:
        """
        Return b0 of the model of an order whose other poles, the fastest, are left out.

        With y = gain / prod(s - p_i) u it is gain / prod(-p_i) of those.
        """
        fast = np.prod([-pole for pole in sorted(self.poles, key=abs)[order:]])
        return float(np.real(self.gain / fast)) if fast else inf


def truth_of(scenario: Scenario, command: float) -> Truth:
    """Return the truth about the plant of a scenario, linear about a motion by a command."""
    plant = scenario.plant.make()
    state = list(scenario.initial_state)
    integrator = Integrator(plant, Nothing(), substeps_for(plant, 1.0 / scenario.rate))
    for k in range(int(_MOVED * scenario.rate)):
        following = list(state)
        integrator.advance(k / scenario.rate, state, command, 1.0 / scenario.rate, following)
        state = following

    def slope(u: float) -> Array:
        change = [0.0] * len(state)
        plant.derivative(0.0, state, u, 0.0, change)
        return np.array(change)

    step = 1e-6
    matrix = jacobian(plant, state, command)
    push = (slope(command + step) - slope(command - step)) / (2.0 * step)
    # y is the first state, and what drives it the last: there are no zeros
    gain = (np.linalg.matrix_power(matrix, len(state) - 1) @ push)[0]
    return Truth(
        order=plant.order,
        b0=plant.b0,
        delay=scenario.input_delay,
        noise=scenario.noise.variance**0.5,
        poles=tuple(np.linalg.eigvals(matrix)),
        gain=float(gain),
    )


def owners_bounds(scenario: Scenario, present: ControllerSettings) -> dict[str, float]:
    """Return the bounds that the owner of a scenario's plant would give."""
    plant, out = scenario.plant.make(), [0.0]
    reference, wanted = scenario.reference.make(), []
    for t in np.linspace(0.0, scenario.duration, _SAMPLES):
        reference.derivatives(float(t), out)
        wanted.append(out[0])
    travel = _SHARE * (max(wanted) - min(wanted)) or 1.0
    most = _SHARE * (present.command_max - present.safe_command)
    push = abs(plant.b0) * most
    speed = 2.0 * push if plant.order == 1 else (2.0 * push * travel) ** 0.5
    longest = max(20.0, _PATIENCE * scenario.duration)
    return {'max_command': most, 'travel': travel, 'speed': speed, 'longest': longest}


class Nodes:
    """Node processes, stopped in order: the controller before what it commands."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        folder.mkdir(parents=True, exist_ok=True)

    def start(self, node: str, *arguments: str) -> None:
        """Start a node with these ROS arguments; what it prints goes to a file of the folder."""
        command = [sys.executable, '-m', f'nadrc_ros.nodes.{node}', '--ros-args', *arguments]
        with (self._folder / f'{node}.log').open('ab') as log:
            self._running[node] = start_child(command, stdout=log, stderr=subprocess.STDOUT)

    def stop(self, names: Sequence[str] = ('controller', 'plant')) -> None:
        """Interrupt nodes in turn, and kill those that do not end."""
        for name in names:
            process = self._running.pop(name, None)
            if process is None:
                continue
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(_STOP_TIME)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def refuse_dead(self) -> None:
        """
        Refuse to go on without a node that ended.

        Raises
        ------
        UserError
            Says what it printed last.

        """
        for name, process in self._running.items():
            if process.poll() is not None:
                log = self._folder / f'{name}.log'
                lines = log.read_text(encoding='utf-8', errors='replace').splitlines()
                raise UserError(f'the {name} node ended: {lines[-1] if lines else "silently"}')


@contextmanager
def controller_of(file: Path, folder: Path) -> Iterator[Nodes]:
    """Run a controller node with a parameter file, disabled at first."""
    nodes = Nodes(folder)
    try:
        nodes.start('controller', '--params-file', str(file), '-p', 'enabled_at_start:=false')
        time.sleep(1.0)
        nodes.refuse_dead()
        yield nodes
    finally:
        nodes.stop()


class Rehearsal:
    """
    The plant of a scenario behind a controller that knows nothing but its limits.

    There is no disturbance but what is the plant's own, such as gravity, and the scenario's noise.

    Attributes
    ----------
    rate
        Periods per second [Hz].
    bounds
        Those that its owner would give: options of the command, by name.
    truth
        What it is.
    actuator_timeout
        After so long [s] without commands the plant takes its safe one.

    """

    def __init__(self, scenario: Scenario, folder: Path) -> None:
        name, known = next(iter(scenario.controllers.items()))
        self.rate = min(scenario.rate, _FASTEST)
        self._folder = folder
        self.nodes = Nodes(folder)
        self.actuator_timeout = command_timeout(self.rate)
        plant = node_parameters(scenario, name, folder, lockstep=False)['plant']
        plant = {k: v for k, v in plant.items() if not k.startswith('disturbance')}
        plant |= {
            'rate': self.rate,
            'start': 'at_once',
            'command_timeout': self.actuator_timeout,
            'noise_sample_time': 1.0 / self.rate,
        }
        kept = {field: getattr(known, field) for field in _KNOWN}
        present = ControllerSettings(**kept)
        self.bounds = owners_bounds(scenario, present)
        self.truth = truth_of(scenario, present.safe_command + self.bounds['max_command'])
        blank = attrs.asdict(present)
        controller: Parameters = {key: blank[key] for key in _KNOWN}
        controller |= {'rate': self.rate, 'enabled_at_start': False}
        slowest = max(controller_timeout(self.rate), ControllerSettings().measurement_timeout)
        controller |= {'measurement_timeout': slowest, 'max_dt': slowest}
        self._files = {
            node: self._written(node, {f'{NAMESPACE}/{node}': values})
            for node, values in (('plant', plant), ('controller', controller))
        }

    def _written(self, name: str, parameters: Mapping[str, Any]) -> Path:
        path = self._folder / f'{name}.yaml'
        path.write_text(parameter_text(dict(parameters)), encoding='utf-8')
        return path

    def start(self) -> None:
        """Start both nodes."""
        for node, file in self._files.items():
            self._start(node, file)

    def restart(self, values: Mapping[str, Any]) -> None:
        """Start the controller anew with other parameters, as its file has them."""
        self.nodes.stop(['controller'])
        self._start('controller', self._written('accepted', {ANY_CONTROLLER: dict(values)}))

    def _start(self, node: str, file: Path) -> None:
        self.nodes.start(node, '-r', f'__ns:={NAMESPACE}', '--params-file', str(file))


def controller_timeout(rate: float) -> float:
    """Return how long [s] a controller waits for measurements that come at ``rate`` [Hz]."""
    return 5.0 / rate
