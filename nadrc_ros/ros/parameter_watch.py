"""The parameters of other nodes, asked for and then followed, without ever waiting for anybody."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from math import inf
import time
from typing import Any

from nadrc_ros.ros.graph import node_of
from nadrc_ros.ros.topics import Info
from nadrc_ros.ros.versions import with_info
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events
from rclpy.task import Future

# Fast DDS drops the answer to a client that a busy machine has not made known in time.
ASK_AGAIN = 2.0
# What the middleware calls a node that it does not know yet.
_UNKNOWN = '_UNKNOWN_'
_TYPES = {kind.value for kind in Parameter.Type}

Values = dict[str, Any]
Tell = Callable[[str, Values, Info | None], None]


class ParameterWatch:
    """
    Tells the parameters of the nodes that publish some topics, and every change of them.

    ``tell`` is called with the full name of a node and values: all of them first, then those that
    changed, with the info of the message that told so. A node that was started anew is told in
    full again, and one without parameter services, or that does not answer, never. Nobody waits:
    :meth:`look` has to be called now and then.
    """

    def __init__(self, node: Node, topics: Iterable[str], tell: Tell) -> None:
        self.known: dict[str, Values] = {}
        self._node = node
        self._topics = tuple(node.resolve_topic_name(topic) for topic in topics)
        self._tell = tell
        self._sources: dict[str, _Source] = {}
        node.create_subscription(
            ParameterEvent,
            '/parameter_events',
            with_info(self._on_event),
            qos_profile_parameter_events,
        )

    def look(self) -> None:
        """Look for publishers, forget who is gone, and ask those that have not answered."""
        there = self._publishers()
        for name in self._sources.keys() - there.keys():
            self._sources.pop(name).end()
            self.known.pop(name, None)
        for name, publishers in there.items():
            self._meet(name, publishers)
        now = time.monotonic()
        for source in self._sources.values():
            source.look(now)

    def _publishers(self) -> dict[str, set[bytes]]:
        """Return the publishers that are there, by the full name of their node."""
        there: dict[str, set[bytes]] = {}
        for topic in self._topics:
            for info in self._node.get_publishers_info_by_topic(topic):
                if _UNKNOWN not in (name := node_of(info)):
                    there.setdefault(name, set()).add(bytes(info.endpoint_gid))
        return there

    def _meet(self, name: str, publishers: set[bytes]) -> None:
        if name not in self._sources:
            self._sources[name] = _Source(self._node, name, partial(self._learn, name))
        source = self._sources[name]
        if publishers - source.publishers:  # what a node says at its start is hardly heard
            source.ask_anew()
        source.publishers = publishers

    def _learn(self, name: str, values: Values, info: Info | None = None) -> None:
        self.known[name] = self.known.get(name, {}) | values
        self._tell(name, values, info)

    def _on_event(self, event: ParameterEvent, info: Info) -> None:
        source = self._sources.get(event.node)
        if source is None:
            return
        if not source.answered:
            source.ask_anew()  # an answer that is on its way may be older than the change
        elif event.changed_parameters:
            self._learn(event.node, _values(event.changed_parameters), info)


class _Source:
    """One node that is asked for its parameters until it answers."""

    def __init__(self, node: Node, name: str, learn: Callable[[Values], None]) -> None:
        self.answered = False
        self.publishers: set[bytes] = set()
        self._node = node
        self._list = node.create_client(ListParameters, f'{name}/list_parameters')
        self._get = node.create_client(GetParameters, f'{name}/get_parameters')
        self._learn = learn
        self._asked = -inf
        self._pending: tuple[Any, Future] | None = None

    def end(self) -> None:
        """Give up what was made to ask."""
        self._drop()
        for client in (self._list, self._get):
            self._node.destroy_client(client)

    def ask_anew(self) -> None:
        """Forget what was answered, and what will be."""
        self.answered = False
        self._asked = -inf
        self._drop()

    def look(self, now: float) -> None:
        """Ask, unless there is an answer or it may still come."""
        if self.answered or now - self._asked < ASK_AGAIN:
            return
        if self._list.service_is_ready() and self._get.service_is_ready():
            self._asked = now
            self._drop()
            self._call(self._list, ListParameters.Request(), self._on_names)

    def _call(self, client: Any, request: Any, take: Callable[[Any], None]) -> None:
        future = client.call_async(request)
        self._pending = client, future

        def done(future: Future) -> None:
            if self._pending is not None and self._pending[1] is future:
                self._pending = None
                take(future.result())

        future.add_done_callback(done)

    def _drop(self) -> None:
        """Let the answer to the last question pass unheard."""
        if self._pending is not None:
            client, future = self._pending
            self._pending = None
            client.remove_pending_request(future)

    def _on_names(self, answer: ListParameters.Response) -> None:
        names = list(answer.result.names)
        self._call(self._get, GetParameters.Request(names=names), partial(self._on_values, names))

    def _on_values(self, names: list[str], answer: GetParameters.Response) -> None:
        self.answered = True
        self._learn({name: _python(value) for name, value in zip(names, answer.values)})


def _values(parameters: Iterable[Any]) -> Values:
    return {p.name: _python(p.value) for p in parameters}


def _python(value: Any) -> Any:
    """Return the value as JSON has it: arrays and bytes as lists; None for a type that is none."""
    if value.type not in _TYPES:  # rclpy raises for a message that anyone may send
        return None
    plain = parameter_value_to_python(value)
    if isinstance(plain, (str, bool, int, float)) or plain is None:
        return plain
    return [each[0] if isinstance(each, bytes) else each for each in plain]
