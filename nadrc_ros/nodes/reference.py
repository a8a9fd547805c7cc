"""The reference node: a signal generator that also sends the derivatives, unless told not to."""

from __future__ import annotations

from math import nan
from typing import Any

import attrs
from nadrc_ros.adrc.fields import choice, declared, flag, number
from nadrc_ros.adrc.settings import FASTEST_RATE
from nadrc_ros.ros.command_line import About
from nadrc_ros.ros.diagnostics import OK, Report
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.pacing import PacingSettings, SharedTimer, Ticker
from nadrc_ros.ros.parameters import ParameterGroup
from nadrc_ros.ros.runtime import run_command
from nadrc_ros.ros.signal_parameters import FEED_FORWARD, REFERENCE
from nadrc_ros.ros.topics import FEED_FORWARD_TOPIC, REFERENCE_TOPICS
from nadrc_ros.simulation.loop import sample_reference
from nadrc_ros.simulation.plant_run import signal_block
from nadrc_ros.simulation.protocols import Signal
from nadrc_ros.simulation.signals import Nothing


@attrs.frozen(kw_only=True)
class ReferenceSettings:
    """When the signal is sent, and how much of it."""

    start: str = choice(
        'on_command',
        ('on_command', 'at_once'),
        'whether r(0) is held until the first command',
        live=False,
    )
    alone: bool = flag(
        False, 'whether the derivatives are kept back, as by most publishers', live=False
    )
    sample_rate: float = number(
        0.0,
        0.0,
        FASTEST_RATE,
        'Hz',
        'how often a new value is sent; the last one is repeated between; 0 = each period',
        live=False,
    )


class ReferenceNode(LiveNode):
    """Sends r, r', r'', and what is fed forward, at t_k = k / rate; of 0 until a ``command``."""

    default_name = 'reference'

    def set_up(self) -> None:
        """Declare the parameters and join the graph."""
        self._signal = ParameterGroup(
            self, REFERENCE.asked(self) | declared(ReferenceSettings), _make_signal
        )
        self._known = ParameterGroup(self, FEED_FORWARD.asked(self), FEED_FORWARD.make)
        self._started = self.get_parameter('start').value == 'at_once'
        self._alone: bool = self.get_parameter('alone').value
        self._sample_rate: float = self.get_parameter('sample_rate').value
        self.k = 0
        # In lockstep every reader waits for a sample on each of its topics, be it none.
        topics = REFERENCE_TOPICS[: 1 if self._alone and self.lockstep is None else None]
        self._senders = [self.add_output(topic) for topic in topics]
        waited_for = FEED_FORWARD_TOPIC in self.pacing.expected_readers()
        fed = waited_for or not isinstance(self._known.value, Nothing)
        self._feed_forward = self.add_output(FEED_FORWARD_TOPIC) if fed else None
        if self.lockstep is not None:
            self.lockstep.add_input('measurement')
        else:
            self.add_input('command', lambda value, info: self._start())
            self.ticker = Ticker(SharedTimer(self, self.pacing.rate), self.guarded(self.on_timer))

    def begin(self) -> None:
        """Say what is sent."""
        held = not (self._started or self.lockstep)
        waiting = f'; r(0) until {self.resolve_topic_name("command")} comes' if held else ''
        signal = self.get_parameter('signal').value
        self.get_logger().info(f'{signal} at {self.pacing.rate:g} Hz{waiting}')

    def close(self) -> None:
        """Say how much was sent."""
        super().close()
        if not self.failure:
            self.get_logger().info(f'{self.k / self.pacing.rate:.6g} s of the signal were sent')

    def _start(self) -> None:
        self._started = True

    def on_timer(self, elapsed: float, periods: int) -> None:
        """Send the sample of this period."""
        if self._started:
            self.k += periods
        self.send_sample()

    def on_samples(self, values: list[float]) -> None:
        """Send the next sample on the measurement of this one."""
        self.k += 1
        if self.k < self.pacing.steps:
            self.send_sample()

    def send_sample(self) -> None:
        """Send r_k and its derivatives."""
        rate = self.pacing.rate
        samples = sample_reference(self._signal.value, self.k, rate, self._sample_rate)
        if self._alone:
            samples[1:] = [nan] * (len(self._senders) - 1)
        if self._feed_forward is not None:
            self._feed_forward.send(float(signal_block(self._known.value, self.k, 1, rate)[0]))
        # The derivatives first: a controller takes those that came with or before the reference.
        for sender, value in zip(reversed(self._senders), reversed(samples)):
            sender.send(value)

    def report(self) -> Report:
        """Tell whether it has begun."""
        running = self._started or self.lockstep is not None
        values = {'time': self.k / self.pacing.rate}
        return OK, 'running' if running else 'waiting for a command', values


def _make_signal(values: dict[str, Any]) -> Signal:
    own = declared(ReferenceSettings)
    return REFERENCE.make({name: value for name, value in values.items() if name not in own})


def _about() -> About:
    signal = REFERENCE.fields()
    return About(
        purpose='A signal generator: sends a reference and its derivatives.',
        topics={
            'reference': 'out',
            'reference/rate': 'out: its first derivative',
            'reference/acceleration': 'out: its second derivative',
            'command': 'in: time begins with the first one',
        },
        parameters={
            **{name: signal[name] for name in ('signal', 'amplitude', 'frequency')},
            'start': declared(ReferenceSettings)['start'],
            'rate': declared(PacingSettings)['rate'],
        },
        examples=(
            'ros2 run nadrc_ros reference --ros-args -p signal:=cosine -p frequency:=0.5',
            'ros2 run nadrc_ros reference --ros-args -p signal:=step -p start:=at_once',
        ),
    )


def main() -> int:
    """Run the reference node."""
    return run_command(ReferenceNode, _about())


if __name__ == '__main__':
    raise SystemExit(main())
