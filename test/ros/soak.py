"""The four nodes of a loop, and at random what goes wrong with them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from math import inf, nan
from pathlib import Path
from random import Random
import signal
import time
from typing import Any

from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.nodes.plant_settings import fault_fields
from probe import NodeProcess, parameter_messages, Probe, Processes
from rcl_interfaces.srv import SetParameters
from resources import Held, held
from std_srvs.srv import Trigger

RATE = 500.0
LIMIT = 30.0
NODES: dict[str, dict[str, Any]] = {
    'plant': {
        'rate': RATE,
        'plant': 'chain',
        'order': 1,
        'damping': 1.0,
        'disturbance': 'sine',
        'disturbance_amplitude': 3.0,
        'disturbance_frequency': 0.5,
        'noise_variance': 1e-6,
    },
    'reference': {'rate': RATE, 'signal': 'sine', 'amplitude': 1.0, 'frequency': 0.2},
    'recorder': {'rate': RATE},
    'controller': {
        'rate': RATE,
        'plant_order': 1,
        'controller_bandwidth': 8.0,
        'command_min': -LIMIT,
        'command_max': LIMIT,
        'reference_timeout': 0.5,
    },
}
# What the range of a parameter does not say: where the loop goes on as a loop.
RANGES = {
    'command_min': (-LIMIT, -5.0),
    'command_max': (5.0, LIMIT),
    'command_rate_limit': (50.0, 5000.0),
    'safe_command': (-1.0, 1.0),
    'reference_timeout': (0.1, 1.0),
    'startup_time': (0.0, 1.0),
    'tracking_acceleration': (0.0, 100.0),
    'good_samples': (1, 50),
    'measurement_min': (-1e3, -50.0),
    'measurement_max': (50.0, 1e3),
}
# No parameter may be any of these.
BAD = (nan, inf, -inf, 1e300, 'nonsense', '', [nan], [1e300])
LIVE = {name: f for name, f in declared(ControllerSettings).items() if f.live}
FAULTS = fault_fields()
FAULTLESS = {name: 'none' for name in FAULTS if name.endswith('.kind')}
GARBAGE = (nan, inf, -inf, 1e308, 5e-324, -1e6, 0.0)
# Nodes come and go, and a stranger publishes on their topics, in the first part of the duration;
# what is recorded and what is held is judged after it, where a topic has its node's numbers only.
UNTIL_CALM = 0.4
BAND = 0.1


def default(name: str) -> Any:
    """Return the value of a parameter of the controller at the start."""
    value = NODES['controller'].get(name, LIVE[name].default)
    return list(value) if isinstance(value, tuple) else value


def valid(rng: Random, name: str) -> Any:
    """Return a random value of a live parameter of the controller that must be accepted."""
    field, now = LIVE[name], default(name)
    if field.kind == 'choice':
        return rng.choice(field.choices)
    if field.kind == 'flag':
        return rng.random() < 0.5
    low, high = RANGES.get(name, (field.low or 0, field.high or 0))
    if field.kind == 'integer':
        return rng.randint(int(low), int(high))
    if field.kind == 'numbers':
        return [now[0] * rng.uniform(0.5, 1.0)]
    if name in RANGES:
        return rng.uniform(low, high)
    return min(max(now * rng.uniform(0.5, 2.0), low), high)


class Soak:
    """
    A loop at 500 Hz under random faults.

    Parameters
    ----------
    duration
        How long faults happen [s].
    seed
        The same gives the same faults in the same order; when they come is up to the machine.

    """

    def __init__(
        self, probe: Probe, start: Processes, directory: Path, duration: float, seed: int
    ) -> None:
        self.runs = directory / 'runs'
        self.duration = duration
        self.held: dict[str, list[Held]] = {name: [] for name in NODES}
        self.happened: Counter[str] = Counter()
        self.processes: dict[str, NodeProcess] = {}
        self.started: list[tuple[str, NodeProcess]] = []
        self.commands = probe.listen('command')
        self.measurements = probe.listen('measurement')
        self.references = probe.listen('reference')
        self.calm = 0  # so many measurements were heard before
        self._probe, self._start, self._rng = probe, start, Random(seed)
        self._strangers = [probe.publisher(topic) for topic in ('measurement', 'reference')]
        self._clients: dict[str, Any] = {}
        self._calm: dict[str, Callable[[], object]] = {
            'parameter changed': self._change,
            'parameter refused': self._be_refused,
            'disabled or enabled': lambda: probe.enable(self._rng.random() < 0.6),
            'controller reset': lambda: probe.trigger('controller/reset'),
            'reference changed': self._change_reference,
            'plant fault': self._fail_plant,
            'plant frozen': lambda: self._freeze('plant'),
            'controller frozen': lambda: self._freeze('controller'),
        }
        self._wild: dict[str, Callable[[], object]] = {
            'samples of a stranger': self._send_garbage,
            'recorder reset': self._reset_recorder,
            'plant restarted': lambda: self._restart('plant'),
            'reference restarted': lambda: self._restart('reference'),
            'recorder restarted': lambda: self._restart('recorder'),
        }

    # ---- the run ----

    def run(self) -> None:
        """Let things go wrong, then see the loop recover and end."""
        for name in NODES:
            self._begin(name)
        self._recover()
        self._go_wrong(UNTIL_CALM * self.duration, self._calm | self._wild)
        self._meet_plant()
        self._recover()
        self._begin_record()
        self.calm = len(self.measurements)
        self._go_wrong((1.0 - UNTIL_CALM) * self.duration, self._calm)
        self._recover()
        for name in ('controller', 'recorder', 'plant', 'reference'):
            self.processes[name].signal(signal.SIGINT)
            assert self._probe.end_of(self.processes[name]) == 0, self.processes[name].said

    def _go_wrong(self, seconds: float, faults: Mapping[str, Callable[[], object]]) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            fault = self._rng.choice(list(faults))
            self.happened[fault] += 1
            faults[fault]()
            self._wait(self._rng.uniform(0.1, 0.6))

    def _begin(self, name: str) -> None:
        more: dict[str, Any] = {'directory': str(self.runs)} if name == 'recorder' else {}
        self.processes[name] = self._start(name, **NODES[name], **more)
        self.started.append((name, self.processes[name]))
        self.held[name].clear()

    def _wait(self, seconds: float) -> None:
        """Let some time pass; all must live, and what they hold is noted."""
        self._probe.spin(seconds)
        for name, process in self.processes.items():
            assert process.running, process.said
            self.held[name].append(held(process.popen.pid, time.monotonic()))

    def _recover(self) -> None:
        """Undo all changes, and wait until the loop is in its band and stays there."""
        assert not any(self._probe.set('plant', **FAULTLESS))
        values = {name: default(name) for name in LIVE}
        assert self._probe.set_together('controller', **values) == ''
        self._probe.enable()
        good = 0

        def settled() -> bool:
            nonlocal good
            there = self.measurements and self.references
            near = there and abs(self.measurements[-1] - self.references[-1]) < BAND
            good = good + 1 if near else 0
            return good > 100

        self._probe.wait_until(settled)

    def _meet_plant(self) -> None:
        """Start the plant again until it answers and is heard; a busy DDS may leave it alone."""
        for _ in range(3):
            client = self._probe.client(SetParameters, 'plant/set_parameters')
            future = client.call_async(
                SetParameters.Request(parameters=parameter_messages(FAULTLESS))
            )
            if self._within(10.0, future.done) and self._within(10.0, self._measures):
                return
            self._restart('plant')
        raise AssertionError('no plant answers and is heard by the controller')

    def _measures(self) -> bool:
        return float(self._probe.said()[-1][2]['measurement_age']) < 0.5

    def _within(self, seconds: float, condition: Callable[[], bool]) -> bool:
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            self._probe.spin(0.1)
        return condition()

    def _begin_record(self) -> None:
        """Start another recorder, and whom it does not hear: a busy DDS may leave one deaf."""
        sources = {'measurement': 'plant', 'command': 'controller'}
        for _ in range(4):
            self._restart('recorder')
            reports = self._probe.said('recorder')
            known = len(reports) + 1
            if self._within(10.0, lambda: self._hears(reports[known:])):  # noqa: B023
                return
            told = reports[-1][1]
            for topic, name in sources.items():
                if topic in told:
                    self._restart(name)
        raise AssertionError(f'the recorder says: {told}')

    def _hears(self, reports: list[Any]) -> bool:
        return any(not message.startswith('waiting for') for _, message, _ in reports)

    # ---- faults ----

    def _change(self) -> None:
        name = self._rng.choice(sorted(LIVE))
        value = valid(self._rng, name)
        assert self._probe.set('controller', **{name: value}) == [''], (name, value)

    def _be_refused(self) -> None:
        name = self._rng.choice([*sorted(LIVE), 'rate', 'no_such_parameter'])
        value = self._rng.choice(BAD)
        (reason,) = self._probe.set('controller', **{name: value})
        assert name in reason, (name, value, reason)

    def _change_reference(self) -> None:
        signal_name = self._rng.choice(('constant', 'sine', 'square', 'trapezoid'))
        self._tell('reference', signal=signal_name, offset=self._rng.uniform(-1.0, 1.0))

    def _fail_plant(self) -> None:
        values = {
            kind: self._rng.choice(('none', *FAULTS[kind].choices))
            for kind in ('fault.measurement.kind', 'fault.command.kind')
        }
        self._tell('plant', **values, **{'fault.measurement.probability': self._rng.random()})

    def _send_garbage(self) -> None:
        send = self._rng.choice(self._strangers)
        for _ in range(self._rng.randrange(1, 30)):
            send(self._rng.choice(GARBAGE))

    def _reset_recorder(self) -> None:
        self._ask(Trigger, 'recorder/reset', Trigger.Request())

    def _freeze(self, name: str) -> None:
        self.processes[name].signal(signal.SIGSTOP)
        self._probe.spin(self._rng.uniform(0.1, 1.0))
        self.processes[name].signal(signal.SIGCONT)

    def _restart(self, name: str) -> None:
        """End a node, and start it again: Fast DDS may hang for good in what a killed one left."""
        self.processes[name].signal(signal.SIGTERM)
        self.processes[name].end()
        self._begin(name)

    def _tell(self, node: str, **values: Any) -> None:
        request = SetParameters.Request(parameters=parameter_messages(values))
        self._ask(SetParameters, f'{node}/set_parameters', request)

    def _ask(self, kind: Any, service: str, request: Any) -> None:
        """Ask without waiting for an answer: a node that was just ended may never give it."""
        if service not in self._clients:
            self._clients[service] = self._probe.node.create_client(kind, service)
        self._clients[service].call_async(request)
