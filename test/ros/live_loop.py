"""A loop in this process, the server of its live page in another, and pages without a browser."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPConnection
from itertools import count
import json
from pathlib import Path
import re
from threading import Event, Thread
import time
from typing import Any

from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.live.blocks import unpack
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.nodes.reference import ReferenceNode
from nadrc_ros.ros.topics import receive, RECORD
from nadrc_ros.ros.versions import spin_for
import numpy as np
from numpy.typing import NDArray
from probe import NodeProcess, Probe, Processes
from rcl_interfaces.msg import ParameterEvent
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

RATE = 100.0
PERIOD = 1.0 / RATE
# Two processes that start one after the other take 20 s where ten others do so.
PATIENCE = 60.0
# A plant that does not run away while nobody controls it, however long a busy machine takes.
STAYS: dict[str, Any] = {'plant': 'lags', 'poles': [-1.0, -2.0], 'gain': 1.0}
LIMITS = {'command_min': -20.0, 'command_max': 20.0}

Message = dict[str, Any]
Array = NDArray[np.float64]


def until(condition: Callable[[], Any], seconds: float = PATIENCE) -> Any:
    """Wait until a condition holds, which other threads bring about, and return it."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, 'it did not come about'
        time.sleep(0.002)
    return found


def quickest(stop: Callable[[], float], promised: float, tries: int = 4) -> float:
    """Return the shortest time that it took, one within the promise if there is any."""
    taken: list[float] = []
    while not taken or (min(taken) > promised and len(taken) < tries):
        taken.append(stop())
    return min(taken)


@contextmanager
def spinning(executor: Any) -> Iterator[None]:
    """Let a thread of its own spin an executor."""
    over = Event()

    def spin() -> None:
        while not over.is_set():
            spin_for(executor, 0.05)

    thread = Thread(target=spin, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def address_in(process: NodeProcess) -> str:
    """Return the address of a page that a process said, '' if it has not yet."""
    assert process.running, process.said
    found = re.search(r'http://\S+token=\S+\n', process.said)
    return found[0].strip() if found else ''


class Served:
    """
    The loop, which a thread of its own runs, and the server of its page.

    Attributes
    ----------
    commands
        When each came here [s of the steady clock], and what it was.
    told
        The changes of parameters that the controller told.

    """

    def __init__(self, probe: Probe, processes: Processes, directory: Path) -> None:
        self.probe = probe
        self.processes = processes
        self.commands: list[tuple[float, float]] = []
        self.told: list[dict[str, Any]] = []
        # The command is never 0 but when it is the safe one, as there is a disturbance.
        plant: dict[str, Any] = STAYS | {
            'disturbance': 'constant',
            'disturbance_offset': 3.0,
            'noise_variance': 1e-6,
        }
        parts: dict[Any, dict[str, Any]] = {
            PlantNode: plant,
            ReferenceNode: {'signal': 'sine', 'frequency': 1.0},
            ControllerNode: {'enabled_at_start': False, 'controller_bandwidth': 4.0} | LIMITS,
            RecorderNode: {'directory': str(directory / 'runs')},
        }
        made = [
            probe.add(kind(namespace=probe.namespace, parameters={'rate': RATE} | parameters))
            for kind, parameters in parts.items()
        ]
        self.plant, _, self.controller, self.recorder = made
        receive(probe.node, 'command', self._on_command, RECORD)
        probe.node.create_subscription(ParameterEvent, '/parameter_events', self._on_event, 100)
        self._names = count(1)
        self._turning = spinning(probe.executor)
        self._turning.__enter__()
        self.server, self.address = self.serve()

    def serve(self, *options: str) -> tuple[NodeProcess, str]:
        """Start a server, and return it with its address."""
        words = ('-m', 'nadrc_ros.cli', 'live', f'{self.probe.namespace}/controller')
        name = f'live_{next(self._names)}'
        process = self.processes.run(name, *words, '--port', '0', *options)

        return process, until(lambda: address_in(process))

    @property
    def enabled(self) -> bool:
        return bool(self.controller.controller.enabled)

    @property
    def staged(self) -> ControllerSettings:
        """Return what the controller was told: it takes over at the end of its next tick."""
        staged: ControllerSettings = self.controller.controller.staged
        return staged

    def enable(self, on: bool = True) -> None:
        """Close the loop as another node would."""
        self.controller.enable(on)
        until(lambda: self.enabled == on)

    def safe_since(self, begin: float) -> float:
        """Return how long after ``begin`` [s] the safe command came, which is 0."""

        def found() -> float:
            since = [t for t, value in list(self.commands) if t >= begin and value == 0.0]
            return since[0] if since else 0.0

        return float(until(found)) - begin

    def close(self) -> None:
        self._turning.__exit__(None, None, None)

    def _on_command(self, value: float, _: object) -> None:
        self.commands.append((time.monotonic(), value))

    def _on_event(self, event: ParameterEvent) -> None:
        if event.node == self.controller.get_fully_qualified_name():
            self.told.append({p.name: p.value for p in event.changed_parameters})


class Page:
    """
    A page without a browser: what it was told, and what it asks for.

    Attributes
    ----------
    messages, blocks
        What came: messages of JSON, and sequence, flags and rows (with their times) of blocks.

    """

    def __init__(self, address: str) -> None:
        self.base, _, self.token = address.partition('/?token=')
        self.host = self.base.removeprefix('http://')
        self.cookie = self.get(f'/?token={self.token}').headers['Set-Cookie'].partition(';')[0]
        self.messages: list[Message] = []
        self.blocks: list[tuple[int, int, Array]] = []
        self.closed = False
        self._ids = count(1)
        self._loop = asyncio.new_event_loop()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()
        self._socket: Any = self._do(self._connect())
        self._do(self._listen(), wait=False)
        self.hello = until(lambda: next((h for h in self.of('hello') if h['node']), None))

    def get(self, path: str, method: str = 'GET', **headers: str) -> Any:
        """Return the answer to a request."""
        connection = HTTPConnection(self.host, timeout=PATIENCE)
        connection.putrequest(method, path, skip_host='Host' in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        answer.read()
        connection.close()
        return answer

    def of(self, kind: str) -> list[Message]:
        """Return the messages of a type."""
        return [message for message in list(self.messages) if message['type'] == kind]

    def send(self, message: str | bytes) -> None:
        """Send anything."""
        self._do(self._send(message), wait=False)

    def tell(self, do: str, **more: Any) -> int:
        """Send a request, and return its id."""
        number = next(self._ids)
        self.send(json.dumps({'id': number, 'do': do} | more))
        return number

    def ask(self, do: str, **more: Any) -> Message:
        """Send a request, and return the answer."""
        number = self.tell(do, **more)
        kinds = ('answer', 'prediction')

        def answer() -> Message | None:
            told = [m for m in list(self.messages) if m['type'] in kinds and m['id'] == number]
            return told[0] if told else None

        found: Message = until(answer)
        return found

    @contextmanager
    def beating(self) -> Iterator[Event]:
        """Beat as a page does on which the button is held, until the event is set."""
        over = Event()

        def beat() -> None:
            while not over.is_set():
                self.tell('beat', n=next(self._ids), time=1e3 * time.monotonic())
                over.wait(0.1)

        thread = Thread(target=beat, daemon=True)
        thread.start()
        try:
            yield over
        finally:
            over.set()
            thread.join()

    def close(self) -> None:
        """Close the socket."""
        with suppress(RuntimeError):
            self._do(self._close())
        self._loop.call_soon_threadsafe(self._loop.stop)

    def _run(self) -> None:
        self._loop.run_forever()

    def _do(self, work: Any, wait: bool = True) -> Any:
        done = asyncio.run_coroutine_threadsafe(work, self._loop)
        return done.result(PATIENCE) if wait else None

    async def _connect(self) -> Any:
        headers = {'Origin': self.base, 'Cookie': self.cookie}
        return await websocket_connect(HTTPRequest(f'ws://{self.host}/ws', headers=headers))

    async def _send(self, message: str | bytes) -> None:
        with suppress(Exception):  # it may be closed
            await self._socket.write_message(message, binary=isinstance(message, bytes))

    async def _close(self) -> None:
        self._socket.close()

    async def _listen(self) -> None:
        while (message := await self._socket.read_message()) is not None:
            if isinstance(message, bytes):
                sequence, flags, t0, rows = unpack(message)
                rows[:, 0] += t0
                self.blocks.append((sequence, flags, rows))
            else:
                self.messages.append(json.loads(message))
        self.closed = True
