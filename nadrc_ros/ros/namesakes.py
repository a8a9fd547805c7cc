"""Whether another node has the name of ours: what is asked of it then reaches either of them."""

from __future__ import annotations

from collections.abc import Callable
import time

from nadrc_ros.ros.diagnostics import ERROR, OK, WARN
from nadrc_ros.ros.remarks import Remarks
from rclpy.node import Node

# A node that was killed is listed for 20 s: what is there for longer lives [s].
LISTED = 22.0
# One that is being stopped and started anew may be listed twice for so many looks.
LOOKS = 2


class Namesakes:
    """
    Says that another node has our full name: a WARN, and an ERROR once it cannot be a dead one.

    Nothing is refused, as a node that is started anew after a kill must run at once.

    Parameters
    ----------
    node
        Ours.
    remarks
        Where it is said.
    now
        The time [s].

    """

    def __init__(
        self, node: Node, remarks: Remarks, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._node = node
        self._remarks = remarks
        self._now = now
        self._name = node.get_fully_qualified_name()
        self._looks = 0
        self._since = 0.0

    def look(self) -> None:
        """Look who is there; to be called once per second."""
        # asked of one service, as the list of all nodes is long where there are many
        if self._node.count_services(f'{self._name}/get_parameters') < 2:
            self._tell_end()
            return
        self._looks += 1
        if self._looks == 1:
            self._since = self._now()
        alive = self._now() - self._since > LISTED
        known = '' if alive else ', unless it was killed less than 20 s ago'
        text = (
            f'another node is called {self._name} too{known}: services and parameters reach '
            'either of them; rename one with -r __node:=...'
        )
        if self._looks >= LOOKS:
            self._remarks.put('namesake', text, ERROR if alive else WARN)

    def _tell_end(self) -> None:
        self._remarks.put('namesake', '')
        if self._looks >= LOOKS and self._remarks.due('namesake gone'):
            self._remarks.log(f'no other node is called {self._name} any more', OK)
        self._looks = 0
