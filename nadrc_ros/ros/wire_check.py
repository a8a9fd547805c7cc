"""What is on the graph now: the numbers in a topic's messages, and what a wiring would hear."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import nan
import time
from typing import Any

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import refuse_unknown_keys
from nadrc_ros.ros.arguments import overrides
from nadrc_ros.ros.graph import publishers, readers
from nadrc_ros.ros.runtime import init_ros
from nadrc_ros.ros.topics import Info, Input, LATEST, receive
from nadrc_ros.ros.versions import make_executor, spin_for, with_info
from nadrc_ros.ros.wires import (
    FLOAT64,
    make_wire,
    members_of,
    message_class,
    missing_type,
    PREFIX,
    type_on_graph,
)
from nadrc_ros.ros.wiring_parameters import build_wiring, SIGNALS, wiring_fields, WiringSettings
from nadrc_ros.wiring.address import Address, parse_path
from nadrc_ros.wiring.layout import Malformed
from nadrc_ros.wiring.listing import numbers_in
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.node import Node

# Others are discovered within so long, as a rule [s].
_DISCOVERY, _LATE_DISCOVERY = 1.0, 3.0
_LISTENER = 'nadrc_wire'


@attrs.define(eq=False)
class Heard:
    """
    What was heard of a signal.

    Attributes
    ----------
    signal, address
        What, and where it is.
    value
        The last number, nan where there was none.
    times
        When samples came [s].
    age
        Of the last one by its stamp [s].
    who
        The nodes that publish it; of a command that nobody publishes yet, those that take it.
    taken
        Whether it is those that take it.
    wrong
        What is not as it should be, empty where all is well.
    source
        What hears it, None where nothing can.

    """

    signal: str
    address: str
    value: float = nan
    times: list[float] = attrs.field(factory=list)
    age: float = nan
    who: list[str] = attrs.field(factory=list)
    taken: bool = False
    wrong: str = ''
    source: Input | None = None

    @property
    def rate(self) -> float:
        """Return how many samples came per second, 0 for less than two."""
        if len(self.times) < 2:
            return 0.0
        return (len(self.times) - 1) / (self.times[-1] - self.times[0])

    def take(self, value: float, info: Info, now: int) -> None:
        """Take a sample; the time is that on the clock of stamps [ns]."""
        self.value = value
        self.times.append(time.monotonic())
        self.age = (now - info['source_timestamp']) * 1e-9


def fields_now(topic: str, wait: float) -> tuple[str, list[tuple[str, float]]]:
    """
    Return the type of a topic, and every number in one of its messages with its field.

    Raises
    ------
    UserError
        When nothing comes within ``wait`` [s], or it is not of its type.

    """
    with _node('nadrc_fields') as (node, executor):
        kind = type_on_graph(node, topic, topic, wait)
        try:
            message = message_class(kind)
        except LookupError:
            raise UserError(f'{topic}: {missing_type(kind)}') from None
        came: list[bytes] = []
        take = with_info(lambda data, _: came.append(data))
        node.create_subscription(message, topic, take, LATEST, raw=True)
        end = time.monotonic() + wait
        while not came and time.monotonic() < end:
            spin_for(executor, 0.05)
        if not came:
            who = ', '.join(publishers(node, topic)) or 'nobody'
            raise UserError(f'{topic}: nothing came in {wait:g} s; {who} publishes it')
    try:
        return kind, list(numbers_in(came[0], kind, members_of))
    except Malformed:
        raise UserError(f'{topic}: the message is no {kind}') from None


def check_wiring(parameters: Mapping[str, Any], namespace: str, seconds: float) -> list[Heard]:
    """
    Listen for so long [s] to what a controller with these ``parameters`` would hear.

    Raises
    ------
    SettingError
        For an address that is none, or a key of a wiring that there is not.

    """
    wiring = {name: value for name, value in parameters.items() if name.startswith(PREFIX)}
    refuse_unknown_keys(wiring, wiring_fields())
    settings = build_wiring(parameters)
    simulated = {'use_sim_time': parameters.get('use_sim_time', False)}
    with _node(_LISTENER, namespace, simulated) as (node, executor):
        spin_for(executor, _DISCOVERY)
        found = [_listen(node, settings, *signal) for signal in SIGNALS.items()]
        spin_for(executor, seconds)
        for each, (topic, name) in zip(found, SIGNALS.items()):
            address = settings.address(name)
            _judge(node, each, address.topic if address else topic, bool(address))
        return [each for each in found if each.who or each.wrong]


def _listen(node: Node, settings: WiringSettings, topic: str, name: str) -> Heard:
    address = settings.address(name)
    if address is None:
        heard = Heard(name, f'{node.resolve_topic_name(topic)} {FLOAT64} data')
        address = Address(topic, FLOAT64, parse_path('data'))
    else:
        heard = Heard(name, str(address))
    try:
        wire = make_wire(node, name, address, settings.stamp, _LATE_DISCOVERY)
    except UserError as error:
        heard.wrong = str(error)
        return heard
    heard.address = str(wire.address)

    now = wire.now if wire.now and wire.by_header else time.time_ns

    def take(value: float, info: Info) -> None:
        heard.take(value, info, now())

    heard.source = receive(node, topic, take, fixed=True, wire=wire)
    return heard


def _judge(node: Node, heard: Heard, topic: str, wired: bool) -> None:
    """Say who publishes a signal, and what is wrong with it."""
    full = node.resolve_topic_name(topic)
    heard.who = publishers(node, full)
    if heard.times:
        heard.wrong = '' if heard.value == heard.value else 'it is NaN'
    elif heard.wrong:
        return
    elif heard.source is not None and heard.source.absent:
        heard.wrong = str(heard.source.absent)
    elif heard.signal == 'command':
        if not heard.who:
            # A listener of ours for another controller may still be listed.
            others = [each for each in readers(node, full) if not each.endswith(f'/{_LISTENER}')]
            heard.who, heard.taken = others, True
            heard.wrong = '' if heard.who else 'nobody takes it'
    elif heard.who:
        heard.wrong = 'nothing comes'
    elif wired or heard.signal == 'measurement':
        heard.wrong = 'nobody publishes it'


@contextmanager
def _node(
    name: str, namespace: str = '', parameters: Mapping[str, Any] | None = None
) -> Iterator[tuple[Node, Executor]]:
    context = Context()
    init_ros([], context)
    executor = make_executor(context)
    try:
        node = Node(
            name,
            context=context,
            namespace=namespace,
            parameter_overrides=overrides(parameters or {}),
        )
        executor.add_node(node)
        yield node, executor
    finally:
        executor.shutdown(timeout_sec=0.0)
        context.try_shutdown()
