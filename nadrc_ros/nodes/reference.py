"""The reference node: a signal generator that also sends the derivatives."""

from __future__ import annotations

from collections.abc import Mapping
import sys
from typing import Any

import attrs
from nadrc_ros.adrc.fields import choice, declared
from nadrc_ros.ros.command_line import NodeParser
from nadrc_ros.ros.diagnostics import Diagnostics, OK
from nadrc_ros.ros.lockstep import Lockstep
from nadrc_ros.ros.pacing import Beat, Ticker
from nadrc_ros.ros.parameters import ParameterGroup, refuse_unknown
from nadrc_ros.ros.runtime import LiveNode, run
from nadrc_ros.ros.signals import REFERENCE
from nadrc_ros.ros.topics import receive, REFERENCE_TOPICS, Sender
from nadrc_ros.simulation.loop import sample_reference
from nadrc_ros.simulation.protocols import Signal

DESCRIPTION = 'A signal generator: reference out, with its derivatives.'
EXAMPLE = '  ros2 run nadrc_ros reference --ros-args -p signal:=cosine -p frequency:=0.5'


@attrs.frozen(kw_only=True)
class ReferenceSettings:
    """From when on the signal is sent."""

    start: str = choice(
        'on_command',
        ('on_command', 'at_once'),
        'whether r(0) is held until the first command',
        live=False,
    )


class ReferenceNode(LiveNode):
    """Sends r, r', r'' at t_k = k / rate; r(0) until the first ``command``."""

    default_name = 'reference'

    def set_up(self) -> None:
        """Declare the parameters and join the graph."""
        self._signal = ParameterGroup(
            self, REFERENCE.asked(self) | declared(ReferenceSettings), _make_signal
        )
        self._started = self.get_parameter('start').value == 'at_once'
        self.k = 0
        self.lockstep: Lockstep | None = None
        if self.pacing.lockstep:
            self.lockstep = Lockstep(
                self, self.pacing, self.guarded(self._fire), self._send_sample
            )
            self.lockstep.add_input('measurement')
            self._senders: list[Sender] = [self.lockstep.add_output(t) for t in REFERENCE_TOPICS]
        else:
            self._senders = [Sender(self, topic) for topic in REFERENCE_TOPICS]
            self.inputs = [receive(self, 'command', lambda value, info: self._start())]
            on_timer = self.guarded(self._on_timer)
            self.ticker = Ticker(Beat(self, self.pacing.rate), self.pacing.rate, on_timer)
        refuse_unknown(self)
        self.diagnostics = Diagnostics(self, self._report)

    def _start(self) -> None:
        self._started = True

    def _on_timer(self, _: float) -> None:
        if self._started:
            self.k += self.ticker.due
        self._send_sample()

    def _fire(self, _: list[float]) -> None:
        """Send the next sample on the measurement of this one."""
        self.k += 1
        if self.k < self.pacing.steps:
            self._send_sample()

    def _send_sample(self) -> None:
        values = sample_reference(self._signal.value, self.k, self.pacing.rate)
        # The derivatives first: a controller takes those that came with or before the reference.
        for sender, value in zip(reversed(self._senders), reversed(values)):
            sender.send(value)

    def _report(self) -> tuple[bytes, str, Mapping[str, object]]:
        values: dict[str, object] = {'time': self.k / self.pacing.rate}
        if self.lockstep is None:
            values |= {'periods': self.ticker.periods, 'missed_periods': self.ticker.missed}
        return OK, 'running' if self._started or self.lockstep else 'waiting for a command', values

    def close(self) -> None:
        """Let readers take what was sent."""
        if self.lockstep is not None:
            self.lockstep.flush()


def _make_signal(values: dict[str, Any]) -> Signal:
    values.pop('start')
    return REFERENCE.make(values)


def main() -> int:
    """Run the reference node."""
    NodeParser('reference', DESCRIPTION, EXAMPLE).parse(sys.argv)
    return run(lambda: ReferenceNode(arguments=sys.argv))


if __name__ == '__main__':
    raise SystemExit(main())
