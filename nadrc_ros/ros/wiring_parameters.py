"""The wiring of a node: which fields of which messages its signals are, by its parameters."""

from __future__ import annotations

from collections.abc import Mapping
import time
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build, choice, Declared, declared, number, text
from nadrc_ros.adrc.settings import HIGHEST, LOWEST
from nadrc_ros.ros.diagnostics import OK
from nadrc_ros.ros.exchange import Exchange
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.pacing import SharedTimer
from nadrc_ros.ros.parameters import ParameterGroup
from nadrc_ros.ros.stamps import SampleTimes
from nadrc_ros.ros.topics import (
    APPLIED_TOPIC,
    FEED_FORWARD_TOPIC,
    GAIN_TOPIC,
    Info,
    Receive,
    REFERENCE_TOPICS,
    Sender,
)
from nadrc_ros.ros.wires import make_wire, PREFIX, Wire
from nadrc_ros.wiring.address import Address, AddressError, GRAMMAR, parse_address
from rclpy.qos import QoSProfile, ReliabilityPolicy

# Signals by the topics that they have without a wiring.
_OPTIONAL = (GAIN_TOPIC, APPLIED_TOPIC, FEED_FORWARD_TOPIC)
_TOPICS = ('measurement', *REFERENCE_TOPICS, *_OPTIONAL, 'command')
SIGNALS = {topic: topic.replace('/', '_') for topic in _TOPICS}


# Where several publishers tell parts of a machine, none may replace the last message of another.
_PARTS = QoSProfile(depth=4, reliability=ReliabilityPolicy.BEST_EFFORT)

# Headers are from the future for so many seconds until it is said.
_LOOKS = 3


def _address(signal: str) -> Any:
    described = f'address of the {signal}: {GRAMMAR}; empty = the Float64 of its topic'
    return text('', described, live=False)


@attrs.frozen(kw_only=True)
class WiringSettings:
    """Which fields of which messages the signals are, behind ``wiring.``; fixed at start."""

    measurement: str = _address('measurement')
    reference: str = _address('reference')
    reference_rate: str = _address('derivative of the reference')
    reference_acceleration: str = _address('second derivative of the reference')
    b0_variable: str = _address('variable of b0_table')
    applied: str = _address('command that really acts')
    feed_forward: str = _address('feed-forward')
    command: str = _address('command')
    stamp: str = choice(
        'header',
        ('header', 'source', 'receipt'),
        'when a wired measurement was taken: as its header says, where it has one that is set, '
        'else when it was sent; when it was sent; when it came',
        live=False,
    )
    frame_id: str = text('', 'frame_id in the header of a wired command', live=False)
    fill: float = number(
        0.0,
        LOWEST,
        HIGHEST,
        'message unit',
        'elements of the array of a wired command that no axis of the process has',
        live=False,
    )

    def __attrs_post_init__(self) -> None:
        """Refuse what is no address."""
        for name in SIGNALS.values():
            self.address(name)

    def address(self, name: str) -> Address | None:
        """
        Return the address of a signal, None where it is a Float64 of its own.

        Raises
        ------
        SettingError
            When it is none.

        """
        given = getattr(self, name)
        try:
            return parse_address(given) if given else None
        except AddressError as error:
            raise SettingError(name, given, f'an address; {error.why}') from None


def wiring_fields() -> dict[str, Declared]:
    """Return the declarations of :class:`WiringSettings` by the names of their parameters."""
    return {PREFIX + name: field for name, field in declared(WiringSettings).items()}


def build_wiring(values: Mapping[str, Any]) -> WiringSettings:
    """
    Make the settings of the parameters among ``values`` that are theirs.

    Raises
    ------
    SettingError
        For a value that is refused, by the name of its parameter.

    """
    known = declared(WiringSettings)
    given = {name.removeprefix(PREFIX): value for name, value in values.items()}
    own = {name: given[name] for name in known if PREFIX + name in values}
    return build(WiringSettings, own, PREFIX.rstrip('.'))


class Wiring:
    """
    The signals of a controller, those that are fields of messages and those that are Float64.

    Parameters
    ----------
    node
        Declares the parameters.
    first
        That of the first axis of the process, whose subscriptions and messages this one shares.

    Attributes
    ----------
    wires
        By topic, of signals that are fields of messages.
    exchange
        What the axes of the process share.
    stamp
        The time of the sample that is being answered, on the clock of headers [ns].

    Raises
    ------
    UserError
        For an address that leads to no number.

    """

    def __init__(self, node: LiveNode, first: Wiring | None = None) -> None:
        self.exchange: Exchange = first.exchange if first else Exchange()
        self.wires: dict[str, Wire] = {}
        self.stamp = 0
        self._taken: set[str] = set()
        self._node = node
        self._times, self._from_future = SampleTimes(0.0), 0
        self._settings = ParameterGroup(node, wiring_fields(), build_wiring).value
        self._simulated = bool(node.get_parameter('use_sim_time').value)
        for topic, name in SIGNALS.items():
            address = self._settings.address(name)
            if address is None:
                continue
            if first is not None:
                node.shared.add(f'{node.resolve_topic_name(address.topic)}.')
            if node.pacing.lockstep:
                allowed = 'left out with pacing: lockstep, which joins the nodes by Float64 topics'
                raise SettingError(PREFIX + name, str(address), allowed)
            wait = node.pacing.start_timeout
            self.wires[topic] = make_wire(node, name, address, self._settings.stamp, wait)
        node.checks.append(self._look)

    def add_input(self, topic: str, take: Receive, **more: Any) -> None:
        """Have ``take`` called with each sample of a signal, of one publisher."""
        self._taken.add(topic)
        if wire := self.wires.get(topic):
            more |= {'wire': wire, 'join': self.exchange.join}
            if wire.keyed:
                more['qos'] = _PARTS
        self._node.add_input(topic, take, sole=True, **more)

    def add_output(self, topic: str, value: float) -> Sender:
        """
        Return what sends a signal; until it does, that is ``value`` in messages of other axes.

        Raises
        ------
        UserError
            When a message has no place for it, or another axis has that.

        """
        self._taken.add(topic)
        wire, settings = self.wires.get(topic), self._settings
        if wire is None:
            if settings.frame_id:
                allowed = 'left out: the command is a Float64, which has no header'
                raise SettingError(f'{PREFIX}frame_id', settings.frame_id, allowed)
            return self._node.add_output(topic)
        return self.exchange.sender(self._node, wire, settings.fill, settings.frame_id, value)

    def refuse_unused(self, why: Mapping[str, str]) -> None:
        """
        Refuse the address of a signal that nothing was made for, ``why`` by its topic.

        Raises
        ------
        SettingError
            Names it.

        """
        for topic, wire in self.wires.items():
            if topic not in self._taken:
                raise SettingError(wire.name, str(wire.address), f'left out: {why[topic]}')

    def flush_after(self, timer: SharedTimer) -> None:
        """Let what several axes send go out when a timer has called all of them."""
        if 'command' not in self.wires:
            return
        flush = self.exchange.flush
        if flush in timer.listeners:
            timer.listeners.remove(flush)
        timer.listeners.append(flush)

    def sample_times(self, period: float) -> SampleTimes:
        """Return what tells the times of measurements, by their headers where these count."""
        self._times = self._times_of('measurement', period)
        return self._times

    def reference_times(self, period: float) -> SampleTimes:
        """Return what tells the times of references, likewise."""
        return self._times_of('reference', period)

    def _times_of(self, name: str, period: float) -> SampleTimes:
        wire = self.wires.get(name)
        by_header = wire is not None and wire.by_header
        return SampleTimes(
            period,
            stamped=by_header or not self._simulated,
            wall=self.now if by_header else time.time_ns,
            numbered=not by_header,
        )

    def answer(self, info: Info | None, held: bool = False) -> None:
        """Note which sample is answered next, none unless the command of the last is ``held``."""
        if info is not None and (self._by_header or not self._simulated):
            self.stamp = info['source_timestamp']
        elif not held:
            self.stamp = self.now()

    def now(self) -> int:
        """Return the time on the clock of headers [ns]."""
        now: int = self._node.get_clock().now().nanoseconds
        return now if self._simulated else time.time_ns()

    @property
    def _by_header(self) -> bool:
        wire = self.wires.get('measurement')
        return wire is not None and wire.by_header

    def _look(self) -> None:
        """Remark what the headers of a measurement are like."""
        wire = self.wires.get('measurement')
        if wire is None or not wire.by_header:
            return
        who = f'{wire.name}: the header of {wire.address.topic}'
        text = f'{who} has no stamp, and the time at which the message was sent is taken'
        self._node.remarks.put('unstamped', text if wire.unstamped else '', OK)
        before, self._from_future = self._from_future, self._times.from_future
        text = (
            f'{who} is stamped by a clock that is ahead of ours, and the time at which the '
            'message came is taken: set the clocks, or wiring.stamp: source'
        )
        ahead = self._from_future > before
        self._node.remarks.put('ahead', text if ahead else '', looks=_LOOKS)

    def report(self) -> dict[str, object]:
        """Return what /diagnostics has of the wired signals."""
        said: dict[str, object] = {wire.name: wire.address for wire in self.wires.values()}
        if 'measurement' in self.wires:
            said['measurements_without_the_field'] = self._node.inputs[0].absences
        return said
