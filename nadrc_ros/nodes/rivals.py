"""Whether somebody else commands: heard before the first command, and from then on."""

from __future__ import annotations

from collections import deque
from math import inf
import time

from nadrc_ros.ros.diagnostics import ERROR
from nadrc_ros.ros.graph import publishers
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.topics import Info, Input, receive, Sender
from rclpy.qos import QoSProfile, ReliabilityPolicy

# Before the first command it is listened for so long [s], in which most others are discovered.
# This and the two times below are longer in slow loops, where a rival's commands are rare too.
LISTEN, _LISTEN_PERIODS = 0.3, 1.5
# Fast DDS may discover another only with its next announcement, which it sends every 3 s. Who
# started so short ago [s] gives way, unless the other has sent fewer commands than we.
PROBATION, _PROBATION_PERIODS = 5.0, 3.0
# A command is followed by the next after so many of their intervals, or after so long [s].
_INTERVALS, _SHORTEST, LONGEST, _LONGEST_PERIODS = 3.0, 0.1, 3.0, 3.0
# So many of our own commands can be on their way.
_OWN = 64
_HEAR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class Rivals:
    """
    Listens for commands that are not ours on the topic of our commands.

    Only what is published counts, not who could: a controller that is disabled stays on the graph
    to take over later, and one that was killed for 20 s. It is listened while there is another
    publisher or we are silent, so that a controller that is alone does not hear itself. Where the
    command is ``shared`` nothing is listened to, and nobody gives way.

    Attributes
    ----------
    listening
        Whether it is too early for the first command.
    gave_way
        Whether nothing may be sent until somebody enables us.
    shared
        Whether nothing is listened to.

    """

    def __init__(self, node: LiveNode, sender: Sender, *, shared: bool) -> None:
        self.listening = not shared
        self.gave_way = False
        self._hearing = False
        self._node = node
        self._sender = sender
        self._remarks = node.remarks
        self.shared = shared
        period = node.pacing.period
        self._listen = max(LISTEN, _LISTEN_PERIODS * period)
        self._probation = max(PROBATION, _PROBATION_PERIODS * period)
        self._longest = max(LONGEST, _LONGEST_PERIODS * period)
        self._began = time.monotonic()
        self._input: Input | None = None
        self._own: deque[tuple[int, float]] = deque(maxlen=_OWN)
        self._last, self._interval = -inf, inf
        self._theirs: float = inf
        if not shared:
            self._hear(True)

    def look(self, idle: bool) -> bool:
        """
        Return whether we have to give way now; to be called some times per second.

        ``idle`` tells whether we are disabled and silent.
        """
        age = time.monotonic() - self._began
        if self.shared or age < self._listen:
            return False
        self.listening = False
        self._hear(idle or self._node.count_publishers(self._sender.topic) > 1)
        topic, text = self._sender.topic, ''
        if self.commanding and not idle and not self.gave_way:
            if age <= self._probation + self._listen and self._theirs >= self._sender.count:
                self.gave_way = True
                text = (
                    f'{self._who()} commands on {topic}: this controller is disabled and silent; '
                    'to take over, disable the other one and call ~/enable, or start with '
                    'share_command'
                )
                self._remarks.put('gave way', text, ERROR, event='rival')
                return True
            text = f'{self._who()} commands on {topic} too: one of the two has to be disabled'
        over = f'one alone commands on {topic} again'
        self._remarks.put('rivals', text, ERROR, over=over, event='rival')
        return False

    @property
    def mute(self) -> bool:
        """Tell whether nothing is sent because of others."""
        return self.listening or self.gave_way

    @property
    def commanding(self) -> bool:
        """Tell whether somebody else commands."""
        silence = time.monotonic() - self._last
        return silence < min(self._longest, max(_SHORTEST, _INTERVALS * self._interval))

    def ignore(self) -> None:
        """Listen no longer: another loop of this process takes the command, and nobody else."""
        self.shared, self.listening = True, False
        self._hear(False)

    def refusal(self) -> str:
        """Return why we cannot take over, empty if we can."""
        if not self.commanding:
            return ''
        return f'{self._who()} commands on {self._sender.topic}: disable it first, and ask again'

    def missed(self) -> str:
        """Return who commands and would have had to be disabled by the same request, if any."""
        if not self.commanding or self._node.get_fully_qualified_name() not in self._others():
            return ''
        return f'{self._who()} commands on {self._sender.topic}: ask again, or end one of the two'

    def settle(self, enabled: bool) -> None:
        """Note that somebody decided whether we command."""
        self.gave_way = self.gave_way and not enabled
        self._remarks.put('gave way', '')

    def _hear(self, wanted: bool) -> None:
        if wanted == self._hearing:
            return
        self._hearing = wanted
        self._sender.told = self._note_own if wanted else None
        if wanted:
            wire = self._sender.wire
            self._input = receive(self._node, 'command', self._take, _HEAR, fixed=True, wire=wire)
        elif self._input is not None:
            self._node.destroy_subscription(self._input.subscription)

    def _note_own(self, number: int, value: float) -> None:
        self._own.append((number, value))

    def _take(self, value: float, info: Info) -> None:
        if not self._hearing:  # the executor still had that one
            return
        number = info['publication_sequence_number']
        if number is None:  # this middleware does not number
            ours = any(value == own for _, own in self._own)
        else:
            ours = (number, value) in self._own
        if not ours:
            now = time.monotonic()
            self._interval, self._last = now - self._last, now
            self._theirs = inf if number is None else number

    def _who(self) -> str:
        own = self._sender.owner
        names = ['another node called ' + own if name == own else name for name in self._others()]
        return ' or '.join(names) or 'somebody unknown'

    def _others(self) -> list[str]:
        own = self._sender.owner
        names = publishers(self._node, self._sender.topic)
        if own in names:
            names.remove(own)
        return names
