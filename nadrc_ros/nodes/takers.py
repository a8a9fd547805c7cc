"""Whether anybody takes the command of a controller in control, and who may be meant to."""

from __future__ import annotations

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.supervisor import Mode
from nadrc_ros.ros.inputs import meant, node_of
from nadrc_ros.ros.remarks import Remarks
from nadrc_ros.ros.topics import FLOAT64, Sender
from rclpy.node import Node

# So many looks, one per second, without a reader until it is said, and between two searches.
LOOKS, SEARCH_AGAIN = 5, 30


class Takers:
    """
    Warns while a controller is in control and nobody subscribes to its commands.

    Parameters
    ----------
    node
        The controller.
    controller
        Its loop.
    sender
        Of its commands.
    remarks
        Where it is said.

    """

    def __init__(
        self, node: Node, controller: Controller, sender: Sender, remarks: Remarks
    ) -> None:
        self._node = node
        self._controller = controller
        self._topic = sender.topic
        self._remarks = remarks
        self._untaken = 0
        self._like = ''

    def look(self) -> None:
        """Look who subscribes; to be called once per second."""
        untaken = self._controller.mode == Mode.OK and not self._readers(self._topic)
        self._untaken = self._untaken + 1 if untaken else 0
        if self._untaken % SEARCH_AGAIN == LOOKS:
            self._like = self._search()
        text = f'nobody subscribes to {self._topic}, so the commands move nothing{self._like}'
        self._remarks.put('takers', text if self._untaken >= LOOKS else '')

    def _readers(self, topic: str) -> list[str]:
        """Return who subscribes, but for us, who listen for others that command."""
        there = self._node.get_subscriptions_info_by_topic(topic)
        return sorted({node_of(p) for p in there} - {self._node.get_fully_qualified_name()})

    def _search(self) -> str:
        """Return which topic may be meant: one that is read, and that nobody publishes."""
        node = self._node
        free = [
            name
            for name, types in node.get_topic_names_and_types()
            if FLOAT64 in types and not node.count_publishers(name) and self._readers(name)
        ]
        if name := meant(self._topic, free):
            readers = ', '.join(self._readers(name))
            return f', but {readers} subscribes to {name}: did you mean to remap?'
        return ''
