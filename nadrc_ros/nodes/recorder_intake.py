"""What a recorder hears in real time: samples with the time at which they left, as rows."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
import copy
from functools import partial
from math import nan
import time
from typing import Any

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.records.recording import JOINED, NEEDED, STAMPED
from nadrc_ros.records.rows import Gap, Row, Rows
from nadrc_ros.ros.diagnostics import OK, WARN
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.stamps import Departures, Losses, Offset
from nadrc_ros.ros.topics import Info, receive, RECORD
from nadrc_ros.ros.wires import make_wire, Wire
from nadrc_ros.ros.wiring_parameters import build_wiring, WiringSettings
from nadrc_ros.wiring.address import Address
from rclpy.qos import QoSProfile, ReliabilityPolicy

# Samples of all topics are there so long after the newest one left [ns], and without any new ones
# after so long.
_SKEW, _SILENCE = 300_000_000, 600_000_000
_SECOND = 1e9
# Estimates that a controller leaves out are no gap.
_REGULAR = ('reference', 'measurement', 'output', 'command')
# What a controller is wired to is there after so many looks at the graph, as a rule.
_PATIENCE = 20
# A header in simulated time may be as old as that when it comes [ns]; an older one is no time.
_LATE = 1_000_000_000


class Intake:
    """
    Has a node hear the topics of signals, and makes rows of what comes, in runs of ``duration``.

    ``period`` is that of an angle, if it is known already. Samples come with the quality of
    service ``qos``, and silence is remarked on if ``watched``. Rows are made as soon as can be if
    ``eager``: when each stream of their rate went on, and not only after what comes rarely, too.

    Times are of the steady clock of this machine, in simulated time of ``/clock``: there a sample
    left when it came, and where that clock goes back, time stands still. ``clock_jumps`` counts
    how often in the run the clock of a publisher turned out to be another one than it was.
    ``commands_before`` is how many commands were sent before the first that came, None until that
    is known. In lockstep the samples come to the node itself, and here is nothing.
    """

    def __init__(
        self,
        node: LiveNode,
        topics: Mapping[str, str],
        duration: float,
        period: float,
        *,
        eager: bool = False,
        qos: QoSProfile = RECORD,
        watched: bool = True,
    ) -> None:
        self.losses = {name: Losses() for name in topics}
        self.simulated: bool = node.get_parameter('use_sim_time').value
        self._node = node
        self._duration = duration
        self._departures: dict[str, Departures] = {}
        self._offset = Offset()
        self._clock = self._stood = 0
        self._period = period
        self.restart(0)
        self.wiring, self._home = WiringSettings(), ''
        self._topics = topics
        self._eager, self._qos, self._watched = eager, qos, watched
        self._stamped: set[str] = set()  # signals whose headers tell the time, also simulated
        self._wired: dict[str, Address | None] = {}
        self._wired |= dict.fromkeys(name for name in (*NEEDED, *JOINED) if name in topics)
        for name, topic in topics.items():
            node.add_input(topic, partial(self.take, name), qos=qos, **self._watch(name))

    def follow(self, node: str, parameters: Mapping[str, Any]) -> None:
        """Take the wiring of a controller for ours, and its period, from its parameters."""
        told = parameters.get('measurement_period')
        if isinstance(told, float) and told > 0.0:
            self._period = self._rows.period = told
        with suppress(UserError):  # a node of that name that is none of ours
            self.wiring, self._home = build_wiring(parameters), node
            self.rewire()

    def rewire(self) -> None:
        """Listen to what the controller is wired to, as soon as that can be."""
        complaint = ''
        for name, before in self._wired.items():
            address = self.wiring.address(name)
            if address == before:
                continue
            try:
                wire = self._wire(name, address) if address else None
            except UserError as error:
                complaint = f'{name} is not recorded: {error}'
                continue
            place = list(self._topics).index(name)
            self._node.destroy_subscription(self._node.inputs[place].subscription)
            self._node.inputs[place] = receive(
                self._node,
                self._topics[name],
                partial(self.take, name),
                self._heard_by(wire.address.topic) if wire else self._qos,
                **self._watch(name),
                fixed=wire is not None,
                wire=wire,
            )
            self._node.inputs[place].skipped = self.losses[name].before
            self._departures.pop(name, None)
            self._stamped.discard(name)
            if wire is not None and wire.by_header:
                self._stamped.add(name)
            self._wired[name] = address
        self._node.remarks.put('wiring', complaint, looks=_PATIENCE)

    def _wire(self, name: str, address: Address) -> Wire:
        """Return the wire of a signal, on the topic that the controller means."""
        topic = address.topic.replace('~', self._home, 1)
        if not topic.startswith('/'):
            topic = f'{self._home.rpartition("/")[0]}/{topic}'
        address = attrs.evolve(address, topic=topic)
        return make_wire(self._node, name, address, self.wiring.stamp, 0.0)

    def restart(self, begin: int) -> None:
        """Begin anew; stamps count from the time ``begin`` of the wall clock [ns]."""
        self.open = True
        self.clock_jumps = 0
        self.commands_before: int | None = None
        self._jumps: list[tuple[int, str, str]] = []
        self._rows = Rows(list(self.losses), self._duration * _SECOND)
        self._rows.period = self._period
        self._begin = begin
        self._looked = self.now()

    @property
    def lost(self) -> dict[str, int]:
        """Return how many samples of the run were lost, by signal."""
        return self._rows.lost

    def lost_by_signal(self) -> dict[str, int] | None:
        """Return what was lost, None where the middleware does not number what it sends."""
        if any(losses.unknown for losses in self.losses.values()):
            return None
        lost = {**self.lost, 'measurement': self.lost['measurement'] + self._rows.late}
        return {name: n for name, n in lost.items() if n}

    def unmatched(self) -> list[str]:
        """Return the signals that no publisher sends to us, whatever the graph says."""
        pairs = zip(self._topics, self._node.inputs)
        return [name for name, each in pairs if not each.subscription.get_publisher_count()]

    def unheard(self) -> list[str]:
        """Return the signals of which nothing came in this run."""
        return [] if self._node.pacing.lockstep else self._rows.unheard()

    def length(self) -> float | None:
        """Return how long the run is so far [s], as far as that is known."""
        return self.since_begin(self._rows.stop)

    def now(self) -> int:
        """Return the present time [ns]."""
        if not self.simulated:
            return time.monotonic_ns()
        before, self._clock = self._clock, self._node.get_clock().now().nanoseconds
        self._stood += max(0, before - self._clock)
        return self._clock + self._stood

    def left(self, source: str, info: Info) -> int:
        """Return when a message of ``source`` left that came just now [ns]."""
        now = self.now()
        if self.simulated:
            stamp: int = info['source_timestamp'] + self._stood
            return stamp if source in self._stamped and 0 <= now - stamp <= _LATE else now
        if source not in self._departures:
            self._departures[source] = Departures(self._offset)
        departures = self._departures[source]
        before = departures.clock_jumps
        moment = departures.of(info, now)
        if departures.clock_jumps > before:
            self.clock_jumps += 1
            text = f'the clock that stamps {source} jumped'
            self._jumps.append((moment, 'clock_jump', text))
        return moment

    def since_begin(self, moment: float) -> float | None:
        """Return the time of a moment in the run [s], None before its first row."""
        begin = self._rows.begin
        return None if begin is None or moment < begin else (moment - begin) / _SECOND

    @property
    def begin(self) -> int | None:
        """Return when the first row begins [ns], None before it."""
        return self._rows.begin

    def begin_without_command(self) -> None:
        """Let rows begin though nobody commands: their command is nan until somebody does."""
        unheard = self.unheard()
        if self.begin is None and 'command' in unheard and 'measurement' not in unheard:
            self._rows.take('command', self._rows.newest, nan)

    def close(self) -> tuple[int, list[Row]]:
        """Return until when [ns] all rows are made, and those that were not returned before."""
        until, now = self._rows.newest - _SKEW, self.now()
        if self._eager:
            until = max(until, self._rows.complete())
        # Who stood still for so long has not taken what came meanwhile.
        if now - self._looked < _SILENCE:
            until = max(until, now - _SILENCE)
        self._looked = now
        return until, self._rows.close(until)

    def happened(self) -> list[tuple[int, str, str]]:
        """Return time [ns], kind and text of gaps and clock jumps since that was asked for."""
        found, self._jumps = self._jumps, []
        for gap in self.gaps():
            cause = f'{gap.lost} samples were lost' if gap.lost else 'nothing was sent'
            text = f'no {gap.signal} for {gap.length / _SECOND:.4g} s: {cause}'
            found.append((gap.time, 'gap', text))
        return found

    def gaps(self) -> list[Gap]:
        """Return the gaps of what should come regularly, since that was asked for."""
        found, self._rows.gaps = self._rows.gaps, []
        return [
            gap
            for gap in found
            if gap.signal in _REGULAR and self.since_begin(gap.time) is not None
        ]

    def end(self) -> list[Row]:
        """Return the rows that are left, and take no more samples."""
        self.open = False
        return self._rows.end()

    def take(self, name: str, value: float, info: Info) -> None:
        """Take a sample of a signal."""
        number = info['publication_sequence_number']
        first = not self.losses[name].newest
        lost = self.losses[name].before(number)
        moment = self.left(name, info)
        if not self.open:
            return
        if name == 'command' and self.commands_before is None and number is not None:
            # What came before a run that was begun anew was not missed, but in the run before.
            self.commands_before = number - 1 if first else 0
            if self.commands_before:
                self._jumps.append((moment, 'late', late(self.commands_before)))
        stamp = nan
        if name in STAMPED and info['source_timestamp']:
            stamp = (info['source_timestamp'] - self._begin) / _SECOND
        self._rows.take(name, moment, value, stamp, lost)

    def _watch(self, name: str) -> dict[str, Any]:
        """Return how an input is looked after."""
        if not self._watched:
            return {'silence': None}
        silence = WARN if name in NEEDED else OK
        return {'silence': silence, 'regular': name == 'measurement'}

    def _heard_by(self, topic: str) -> QoSProfile:
        """Return the best quality of service at which all publishers of a topic are heard."""
        qos = copy.copy(self._qos)
        for info in self._node.get_publishers_info_by_topic(topic):
            if info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
                qos.reliability = ReliabilityPolicy.BEST_EFFORT
        return qos


def late(commands: int) -> str:
    """Return what to say of so many commands that came before the recorder."""
    return f'{commands} commands were sent before the first one that was recorded'
