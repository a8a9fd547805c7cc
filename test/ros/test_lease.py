"""Hold to run: a loop under a lease ends with the heartbeat of who gave it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import inf, nan
import signal
import time
from typing import Any

from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.lease import LONGEST, SHORTEST, STOPPED
from nadrc_ros.ros.diagnostics import receive_events, WARN
from nadrc_ros.ros.versions import make_executor
from probe import Probe, Processes
import pytest
from rclpy.executors import Executor, SingleThreadedExecutor
from test_cascades import joined, Slide

Make = Callable[..., Probe]
RATE = 50.0
CONTROL: dict[str, Any] = {
    'rate': RATE,
    'plant_order': 1,
    'b0': 1.0,
    'good_samples': 1,
    'command_min': -5.0,
    'command_rate_limit': 20.0,
    'safe_command': 1.5,
    'share_command': True,
}
KEEP = 'controller/keep'
LEASE = 0.3
# A machine that has other things to do may be late by so much [s].
SLACK = 0.3
SENDER = """
import sys, time
from nadrc_ros.ros.runtime import init_ros
init_ros([])
import rclpy
from std_msgs.msg import Float64
publisher = rclpy.create_node('operator').create_publisher(Float64, sys.argv[1], 1)
while True:
    publisher.publish(Float64(data=0.3))
    time.sleep(0.1)
"""


class Loop:
    """A controller, in control of a plant that stays where it is, and what it says."""

    def __init__(self, probe: Probe, **more: Any) -> None:
        self.probe = probe
        self.events: list[str] = []
        self.commands = probe.listen('command')
        receive_events(probe.node, 'controller', self._note)
        self.node: ControllerNode = probe.add(ControllerNode(parameters=CONTROL | more))
        self.lease = self.node._lease
        self.beat = probe.publisher(KEEP)
        measure, refer = probe.publisher('measurement'), probe.publisher('reference')

        def feed() -> None:
            measure(0.0)
            refer(-3.0)

        self.sensor = probe.node.create_timer(1.0 / RATE, feed)
        probe.wait_until(lambda: probe.readers(KEEP))
        if self.controller.enabled:
            probe.wait_until(lambda: self.controller.mode == Mode.OK)

    @property
    def controller(self) -> Any:
        return self.node.controller

    def _note(self, _: str, kind: str, text: str, __: Any) -> None:
        if kind == 'enable':
            self.events.append(text)

    def keep(self, seconds: float) -> None:
        """Send one message, and wait until it was taken."""
        count = self.lease.heard.count
        self.beat(seconds)
        self.probe.wait_until(lambda: self.lease.heard.count > count)

    def keep_on(self, seconds: float, lease: float) -> None:
        """Let the heart beat for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.keep(lease)
            self.probe.spin(0.1)

    def wait_for_the_end(self) -> float:
        """Wait until the loop is open, and return how long that took."""
        begin = time.monotonic()
        self.probe.wait_until(lambda: not self.controller.enabled)
        return time.monotonic() - begin


@pytest.mark.parametrize(
    ('executor', 'trigger'),
    [(make_executor, 'timer'), (SingleThreadedExecutor, 'timer'), (make_executor, 'measurement')],
)
def test_p21_a_loop_ends_with_the_heart_of_who_holds_it(
    executor: Callable[[], Executor], trigger: str, make_probe: Make, start: Processes
) -> None:
    """However the sender dies, and if no sample comes any more that could start a step."""
    probe = make_probe(executor=executor)
    loop = Loop(probe, trigger=trigger, measurement_timeout=0.0)
    sender = start.run('sender', '-c', SENDER, f'{start.namespace}/{KEEP}')
    probe.wait_until(lambda: loop.lease.left)
    probe.spin(0.5)
    assert loop.controller.enabled and loop.controller.mode == Mode.OK
    loop.sensor.cancel()
    probe.spin(0.1)
    killed = sender.signal(signal.SIGKILL)
    seconds = loop.wait_for_the_end()
    n = len(loop.commands)
    print(f'disabled {seconds:.3f} s after the kill')
    assert loop.lease._lost is not None and loop.lease._lost * 1e-9 - killed <= LEASE
    assert seconds < LEASE + 1.0 / RATE + SLACK
    probe.wait_until(lambda: loop.commands[-1] == CONTROL['safe_command'])
    ramp = loop.commands[max(0, n - 1) :]
    longest = CONTROL['command_rate_limit'] * (1.0 / RATE + SLACK)
    assert all(0.0 <= b - a <= longest for a, b in pairwise(ramp)) and len(ramp) > 3


def test_p21_why_it_ended_is_told_in_the_log_as_an_event_and_in_diagnostics(
    make_probe: Make, capfd: pytest.CaptureFixture[str]
) -> None:
    probe = make_probe()
    loop = Loop(probe)
    loop.keep(LONGEST)
    probe.wait_until(lambda: probe.said() and float(probe.said()[-1][2]['lease_left']) > 0.0)
    loop.keep(LEASE)
    loop.wait_for_the_end()
    probe.wait_until(lambda: loop.events)
    assert loop.events == [f'disabled: {STOPPED}']
    probe.wait_until(lambda: STOPPED in probe.said()[-1][1])
    level, _, values = probe.said()[-1]
    assert level == WARN and values['lease_left'] == '0'
    assert STOPPED in capfd.readouterr().err
    probe.wait_until(lambda: loop.controller.cause == Cause.DISABLED)
    # at a terminal it is closed again as ever
    answer = probe.enable()
    assert answer.success
    assert answer.message.startswith('enabled, without a lease: the last one on ~/keep ran out')
    probe.spin(2.0 * LEASE)
    assert loop.controller.enabled
    assert STOPPED not in probe.said()[-1][1]
    assert probe.enable().message == 'already enabled'


def test_p21_a_message_while_disabled_enables_nothing_and_a_lease_covers_what_follows(
    make_probe: Make,
) -> None:
    probe = make_probe()
    loop, lease = Loop(probe, enabled_at_start=False), 5.0 * LEASE
    loop.keep_on(0.3, lease)
    assert not loop.controller.enabled
    answer = probe.enable()
    assert (answer.success, answer.message) == (True, 'enabled for as long as ~/keep goes on')
    loop.keep_on(1.2 * lease, lease)
    assert loop.controller.enabled
    loop.keep(LEASE)
    assert loop.wait_for_the_end() < LEASE + SLACK
    loop.keep_on(0.3, lease)
    assert not loop.controller.enabled


def test_p21_no_lease_comes_of_a_message_that_waited_for_longer(make_probe: Make) -> None:
    probe = make_probe()
    loop = Loop(probe)
    loop.beat(LEASE)
    time.sleep(1.5 * LEASE)  # this process stands still
    probe.wait_until(lambda: loop.lease.heard.count)
    probe.spin(0.1)
    assert loop.controller.enabled and not loop.lease.left
    loop.keep(LEASE)
    assert loop.lease.left
    time.sleep(1.5 * LEASE)
    loop.beat(LEASE)
    loop.wait_for_the_end()  # the one before ran out first
    probe.spin(0.1)
    assert not loop.controller.enabled


def test_p21_a_lease_is_of_some_seconds_at_most_and_can_be_given_back(make_probe: Make) -> None:
    probe = make_probe()
    loop = Loop(probe)
    loop.keep(nan)
    assert not loop.lease.left
    loop.keep(inf)
    assert LONGEST - SLACK < loop.lease.left <= LONGEST
    loop.keep(nan)
    assert loop.lease.left > SHORTEST
    loop.keep(0.0)
    assert not loop.lease.left
    probe.spin(LONGEST + 0.2)
    assert loop.controller.enabled and not loop.events
    loop.keep(-1.0)
    assert loop.lease.left <= SHORTEST
    loop.wait_for_the_end()


def test_p21_each_loop_of_a_process_has_a_lease_of_its_own(make_probe: Make) -> None:
    """The end of an outer loop's lease leaves the inner one at what is safe for that."""
    probe = make_probe()
    nodes = joined(probe)
    slide, outer, inner = Slide(probe), nodes['position'], nodes['velocity']
    probe.publisher('position/reference')(1.0)
    beats = {name: probe.publisher(f'{name}/{KEEP}') for name in nodes}
    probe.wait_until(lambda: probe.readers(f'position/{KEEP}'))
    probe.wait_until(lambda: outer.controller.mode == Mode.OK and abs(slide.x[0] - 1.0) < 0.1)
    beats['position'](LEASE)
    probe.wait_until(lambda: not outer.controller.enabled)
    assert inner.controller.enabled and inner.controller.mode == Mode.OK
    probe.wait_until(lambda: inner.controller.reference[0] == 0.0 and abs(slide.x[1]) < 0.05)
    assert outer.enable()[0]
    probe.wait_until(lambda: outer.controller.mode == Mode.OK)
    beats['velocity'](LEASE)
    probe.wait_until(lambda: not inner.controller.enabled)
    probe.wait_until(lambda: slide.pushes[-1] == inner.controller.settings.safe_command)
    probe.wait_until(lambda: outer.controller.cause == Cause.NOT_FOLLOWED)
    assert outer.controller.enabled
