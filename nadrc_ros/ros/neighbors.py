"""How many participants of DDS a node sees, and whether it can see those that it does not."""

from __future__ import annotations

from collections.abc import Callable
import os

from nadrc_ros.ros.diagnostics import Remarks
from rclpy.node import Node

# So many participants on one machine are warned of: of 113 processes the last saw 62 and the
# rest did not agree; with LOCALHOST, from the 34th on each saw 34 (Fast DDS 2.14).
CROWD, CROWD_LOCALHOST = 80, 26
# Every node has a publisher of it.
_TOPIC = '/parameter_events'
# Of the bytes of a GUID, those of the participant; of these the first are of the machine.
_PARTICIPANT, _MACHINE = 12, 4
_ROUTES = '/proc/net/route'


def networks() -> frozenset[str]:
    """Return the network interfaces that have an address and are up, but for loopback."""
    try:
        with open(_ROUTES, encoding='ascii') as file:
            return frozenset(line.split()[0] for line in file.readlines()[1:])
    except OSError:  # not Linux
        return frozenset()


class Neighbors:
    """
    Counts the participants on this machine, and says that there are nearly too many.

    A participant is a process with ROS, as a rule. Beyond some number the later ones are not
    discovered by all, and nothing says so.
    """

    def __init__(
        self, node: Node, remarks: Remarks, there: Callable[[], frozenset[str]] = networks
    ) -> None:
        self._node = node
        self._remarks = remarks
        self._networks = there
        self._at_start = there()
        self._met = False
        local = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_LOCALHOST_ONLY': '1'}
        self._local = any(os.environ.get(name) == value for name, value in local.items())
        self.crowd = CROWD_LOCALHOST if self._local else CROWD

    def look(self) -> None:
        """Look who is there; to be called once per second."""
        many = self._node.count_publishers(_TOPIC) >= self.crowd
        if self._met and not many:
            self._remarks.put('crowd', '')
            return
        ours, all_of_them = self._participants()
        self._met = self._met or len(all_of_them) > 1
        here = [each for each in all_of_them if each[:_MACHINE] == ours[:_MACHINE]]
        limit = '33 with LOCALHOST' if self._local else 'about 100'
        text = (
            f'{len(here)} processes with ROS are on this machine in this domain; beyond {limit} '
            'some are not discovered, and nothing says so: put loops into one process (--axes), '
            'or into another ROS_DOMAIN_ID'
        )
        self._remarks.put('crowd', text if len(here) >= self.crowd else '')

    def unseen(self) -> str:
        """Return why a node that is there may not be seen, empty where nothing speaks for it."""
        if not self._local and (late := self._networks() - self._at_start):
            names = ' and '.join(sorted(late))
            return f'; {names} came up after this node, which does not use it: start it again'
        if not self._met:
            return '; no other process with ROS was ever discovered'
        return ''

    def _participants(self) -> tuple[bytes, set[bytes]]:
        """Return which participant is ours, and all of them."""
        infos = self._node.get_publishers_info_by_topic(_TOPIC)
        name, space = self._node.get_name(), self._node.get_namespace()
        ours, found = b'', set()
        for info in infos:
            participant = bytes(info.endpoint_gid[:_PARTICIPANT])
            found.add(participant)
            if (info.node_name, info.node_namespace) == (name, space):
                ours = participant
        return ours, found
