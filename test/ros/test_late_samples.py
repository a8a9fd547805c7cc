"""What a controller makes of samples that come late, and of those that come too rarely."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.diagnostics import WARN
from probe import Probe

Make = Callable[..., Probe]
CONTROL: dict[str, Any] = {'rate': 100.0, 'controller_bandwidth': 3.0}


def test_p07_a_sensor_that_died_while_the_controller_stood_still_is_missed_at_once(
    make_probe: Make,
) -> None:
    timeouts = {'measurement_timeout': 0.5, 'max_dt': 3600.0}
    probe = make_probe(parameters={'controller': CONTROL | timeouts})
    controller: Any = probe.add(ControllerNode()).controller
    measure = probe.publisher('measurement')

    def in_control() -> bool:
        measure(1.0)
        return bool(controller.mode == Mode.OK)

    probe.wait_until(in_control)
    measure(1.0)
    time.sleep(1.2)  # nothing is taken; the last sample is that old then
    probe.wait_until(lambda: controller.cause == Cause.MEASUREMENT_TIMEOUT)
    assert controller.policy.measurement_age > 1.0
    probe.wait_until(in_control)


def test_a_sensor_slower_than_max_dt_is_told(make_probe: Make) -> None:
    slow = {'max_dt': 0.05, 'measurement_timeout': 0.0}
    probe = make_probe(parameters={'controller': CONTROL | slow})
    probe.add(ControllerNode())
    measure, last = probe.publisher('measurement'), [0.0]

    def told() -> bool:
        now = time.monotonic()
        if now - last[0] > 0.2:
            measure(now)
            last[0] = now
        level, message, _ = probe.said()[-1] if probe.said() else (b'', '', {})
        return level == WARN and '; the last sample only restarted the observers' in message

    probe.wait_until(told)
