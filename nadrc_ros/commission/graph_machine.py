"""A machine as its operator's program reaches it: through the controller node that moves it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from math import nan
from threading import Event, Thread
import time
from typing import Any

import attrs
from diagnostic_msgs.msg import DiagnosticArray
from nadrc_ros.adrc.commission.experiment import Outcome
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.commission.search import find_controller
from nadrc_ros.live.peer import ask
from nadrc_ros.nodes.commission import LATER, START, STOP
from nadrc_ros.nodes.lease import STOPPED
from nadrc_ros.ros.arguments import overrides
from nadrc_ros.ros.experiment_rows import COLUMNS, RowsReader, STAGES
from nadrc_ros.ros.graph import publishers
from nadrc_ros.ros.runtime import init_ros
from nadrc_ros.ros.topics import Info, receive, Sender
from nadrc_ros.ros.versions import make_executor, spin_until_over
from nadrc_ros.ros.wires import make_wire, PREFIX, Wire
from nadrc_ros.tuning.commission.machine import Samples
from nadrc_ros.wiring.address import parse_address
import numpy as np
from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
import rclpy
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_srvs.srv import SetBool, Trigger

# A lease of so long [s] is renewed so often, while the program goes on within so long.
LEASE, _BEAT, _HEALTHY = 0.2, 0.05, 0.2
# Samples and services are looked for so long, an answer may take so long before it is asked again,
# and in all; a controller that is to be asked again may say so for so long [s].
_SEARCH, _AGAIN, _ANSWER, _BUSY = 4.0, 1.0, 10.0, 4.0
# No rows for so long are the end of the node, or of the network [s].
_SILENT = 3.0
_LOOK = 0.01
# No measurement that is listened to is missed; while nobody listens only the last ones are kept.
_KEPT = 2000
_HEAR = QoSProfile(depth=_KEPT, reliability=ReliabilityPolicy.BEST_EFFORT)
_BUSY_HERE = ', which this program keeps up: this computer was too busy. Begin again'


@contextmanager
def reached(
    controller: str = '',
    remark: Callable[[str], object] = lambda text: None,
    started: bool = False,
) -> Iterator[GraphMachine]:
    """
    Give the machine behind a controller node, by default the only one there is.

    ``remark`` is called with whom this waits for, later where it was ``started`` just now.

    Raises
    ------
    UserError
        When there is none, or more than one.

    """
    init_ros()
    node = Node('commission')
    over = Event()
    executor = make_executor()
    executor.add_node(node)
    thread = Thread(target=spin_until_over, args=(executor, node, over.is_set), daemon=True)
    thread.start()
    machine: GraphMachine | None = None
    try:
        machine = GraphMachine(node, find_controller(node, controller, remark, started))
        yield machine
    finally:
        if machine is not None:
            machine.leave()
        over.set()
        thread.join(2.0)
        executor.shutdown(timeout_sec=0.0)
        node.destroy_node()
        rclpy.try_shutdown()


class GraphMachine:
    """
    The machine behind a controller node, as the steps of commissioning need it.

    While an experiment runs, a thread renews the lease on ``~/keep``, but only as long as the
    program itself goes on: one that hangs lets the lease run out, and the node ends what it does.

    Attributes
    ----------
    name
        Full name of the controller node.
    values
        Its parameters, by name.
    topics
        Where its measurement and its command are.
    rate, present
        Periods per second [Hz], and the settings by now.
    progress
        Called with the time since an experiment began [s].

    """

    def __init__(self, node: Node, name: str) -> None:
        self.name = name
        self._node = node
        self._start = node.create_client(SetParametersAtomically, START.replace('~', name))
        self._stop = node.create_client(Trigger, STOP.replace('~', name))
        self._enable = node.create_client(SetBool, f'{name}/enable')
        self._set = node.create_client(
            SetParametersAtomically, f'{name}/set_parameters_atomically'
        )
        self._keep = Sender(node, f'{name}/keep')
        self._rows = RowsReader(node, name)
        self._told: dict[str, str] = {}
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_report, 10)
        self.progress: Callable[[float], None] = lambda seconds: None
        self._alive = 0.0
        self._over = Event()
        self._beating = False
        self.read()
        self._await(lambda: 'measurement_topic' in self._told, f'{name} says nothing of itself')
        self.topics = {
            signal: self._told[f'{signal}_topic'] for signal in ('measurement', 'command')
        }
        self._stops = self._stops_asked()
        self._heard: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)
        receive(node, self.topics['measurement'], self._hear, _HEAR, wire=self._wire())
        self._heart = Thread(target=self._beat, daemon=True)
        self._heart.start()

    def read(self) -> None:
        """
        Read the parameters of the controller.

        Raises
        ------
        UserError
            When it does not answer.

        """
        listing = self._node.create_client(ListParameters, f'{self.name}/list_parameters')
        getting = self._node.create_client(GetParameters, f'{self.name}/get_parameters')
        names = list(self._call(listing, ListParameters.Request()).result.names)
        values = self._call(getting, GetParameters.Request(names=names)).values
        self.values: dict[str, Any] = {
            name: parameter_value_to_python(value) for name, value in zip(names, values)
        }
        for client in (listing, getting):
            self._node.destroy_client(client)
        known = {k: v for k, v in self.values.items() if k in declared(ControllerSettings)}
        self.present = build(ControllerSettings, known)
        self.rate = float(self.values['rate'])

    @property
    def enabled(self) -> bool:
        """Tell whether the loop was closed by the last report."""
        return self._told.get('enabled') == 'True'

    @property
    def writers(self) -> list[str]:
        """Return who else could command."""
        there = publishers(self._node, self.topics['command'])
        return sorted(set(there) - {self.name})

    @property
    def sensors(self) -> list[str]:
        """Return who publishes the measurement."""
        return publishers(self._node, self.topics['measurement'])

    def listen(self, seconds: float) -> Samples:
        """Watch the measurement for so long [s] from when it is heard, and send nothing."""
        latest = time.monotonic() + _SEARCH
        while not self._heard and time.monotonic() < latest:
            time.sleep(_LOOK)
        begin = time.monotonic()
        self._heard = deque()
        while time.monotonic() - begin < seconds:
            time.sleep(_LOOK)
        rows, self._heard = self._heard, deque(maxlen=_KEPT)
        heard = np.array([row for row in list(rows) if row[0] >= begin]).reshape(-1, 3)
        time_, measurement, stamp = heard.T
        # as the stamps are of the wall clock, so is the time that their age counts to
        wall = time_ + (time.time() - time.monotonic())
        nothing = np.full(len(heard), np.nan)
        return Samples(
            time=wall,
            measurement=measurement,
            stamp=stamp,
            command=nothing,
            excitation=nothing,
            stage=np.full(len(heard), '', dtype=object),
        )

    def run(
        self, settings: ExperimentSettings, controller: ControllerSettings | None = None
    ) -> Samples:
        """
        Run an experiment until it is over, and the command at its safe value again.

        Raises
        ------
        UserError
            Where the controller refuses it, or is not heard any more, or somebody stopped it.

        """
        self._refuse_stopped()
        values = _plain(attrs.asdict(settings))
        if controller is not None:
            present = attrs.asdict(self.present)
            changed = {k: v for k, v in attrs.asdict(controller).items() if v != present[k]}
            values |= {f'controller.{name}': v for name, v in _plain(changed).items()}
        request = _request(values)
        self._rows.begin()
        self._alive, self._beating = time.monotonic(), True
        try:
            self._begin(request)
            self._follow()
        except BaseException:
            self.stop()
            raise
        finally:
            self._beating = False
            self._keep.send(0.0)
        self._rows.refuse_lost()
        said = self._rows.said or ''
        if said.startswith(f'{Outcome.STOPPED.value}: '):
            raise UserError(f'the experiment was {said}{_BUSY_HERE if STOPPED in said else ""}')
        return _samples(self._rows.rows, said)

    def stop(self) -> None:
        """End what runs, and wait for that, but not for long."""
        asked = ask(self._stop, Trigger.Request())
        end = time.monotonic() + 2.0
        while time.monotonic() < end and not (asked.done() and self._rows.said):
            self._alive = time.monotonic()
            time.sleep(_LOOK)

    def set_all(self, values: Mapping[str, Any]) -> str:
        """Set parameters of the controller, all or none; return why they are refused."""
        result = self._call(self._set, _request(_plain(values))).result
        self.read()
        return '' if result.successful else result.reason

    def enable(self) -> tuple[bool, str]:
        """Close the loop; return whether that was done, and what the node said."""
        self._refuse_stopped()
        answer = self._call(self._enable, SetBool.Request(data=True))
        return answer.success, answer.message

    def leave(self) -> None:
        """Let the heart stop."""
        self._beating = False
        self._over.set()

    def _stops_asked(self) -> int:
        return int(self._told.get('disable_requests', 0))

    def _refuse_stopped(self) -> None:
        """Begin nothing after a stop, though no experiment ran just then."""
        if self._stops_asked() > self._stops:
            raise UserError('somebody asked for a stop: nothing more is sent')

    def _begin(self, request: Any) -> None:
        end = time.monotonic() + _BUSY
        while True:
            result = self._call(self._start, request).result
            if result.successful:
                return
            if not result.reason.endswith(LATER) or time.monotonic() > end:
                raise UserError(f'{self.name} refuses the experiment: {result.reason}')
            self._pause(0.1)

    def _follow(self) -> None:
        """Wait for the end of an experiment."""
        count, changed = 0, time.monotonic()
        while self._rows.said is None:
            self._pause(_LOOK)
            if len(self._rows.rows) != count:
                count, changed = len(self._rows.rows), time.monotonic()
                self.progress(self._rows.rows[count - 1][0] if count else 0.0)
            elif time.monotonic() - changed > _SILENT + 2.0 / self.rate:
                raise UserError(
                    f'{self.name} is not heard any more: it went to its safe command, unless it '
                    'has died; then your actuator needs a timeout of its own'
                )

    def _pause(self, seconds: float) -> None:
        """Wait, and let the heart know that this program goes on."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._alive = time.monotonic()
            time.sleep(min(_LOOK, seconds))
        self._alive = time.monotonic()

    def _beat(self) -> None:
        while not self._over.wait(_BEAT):
            if self._beating and time.monotonic() - self._alive < _HEALTHY:
                with suppress(RuntimeError):  # of a context that is gone
                    self._keep.send(LEASE)

    def _call(self, client: Any, request: Any) -> Any:
        """
        Ask for an answer, again where none comes: Fast DDS drops some on a busy machine.

        Raises
        ------
        UserError
            When there is none.

        """
        end = time.monotonic() + _ANSWER
        while not client.service_is_ready() and time.monotonic() < end:
            self._pause(_LOOK)
        while time.monotonic() < end:
            asked = ask(client, request)
            again = time.monotonic() + _AGAIN
            while not asked.done() and time.monotonic() < again:
                self._pause(0.002)
            if asked.done():
                return asked.result()
        raise UserError(f'{client.srv_name} does not answer')

    def _await(self, there: Callable[[], object], complaint: str) -> None:
        end = time.monotonic() + _ANSWER
        while not there():
            if time.monotonic() > end:
                raise UserError(complaint)
            time.sleep(_LOOK)

    def _wire(self) -> Wire | None:
        given = self.values.get(f'{PREFIX}measurement', '')
        if not given:
            return None
        stamp = self.values[f'{PREFIX}stamp']
        return make_wire(self._node, 'measurement', parse_address(given), stamp, _ANSWER)

    def _hear(self, value: float, info: Info) -> None:
        stamp = info['source_timestamp'] * 1e-9 or nan
        self._heard.append((time.monotonic(), value, stamp))

    def _on_report(self, array: DiagnosticArray) -> None:
        for status in array.status:
            if status.name == self.name:
                self._told = {pair.key: pair.value for pair in status.values}


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values as parameters have them."""
    return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}


def _request(values: Mapping[str, Any]) -> Any:
    parameters = [parameter.to_parameter_msg() for parameter in overrides(values)]
    return SetParametersAtomically.Request(parameters=parameters)


def _samples(rows: list[list[float]], said: str) -> Samples:
    """Return the rows of an experiment, without its way back to the safe command."""
    table = np.array(rows).reshape(-1, len(COLUMNS))
    columns = dict(zip(COLUMNS, table.T))
    stage = np.array([STAGES[int(i)] for i in columns['stage']], dtype=object)
    over = np.flatnonzero(stage == 'over')
    length = int(over[0]) + 1 if over.size else len(stage)
    outcome, _, reason = said.partition(': ')
    kept = {name: columns[name][:length] for name in COLUMNS if name != 'stage'}
    return Samples(**kept, stage=stage[:length], outcome=outcome, reason=reason)
