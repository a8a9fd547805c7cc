"""What a controller does not believe: samples and references that cannot be, limits of no use."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan
from typing import Any

from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.diagnostics import ERROR, WARN
from probe import Probe, Processes

CONTROL: dict[str, Any] = {
    'rate': 100.0,
    'plant_order': 1,
    'command_min': -20.0,
    'command_max': 20.0,
    'safe_command': 1.5,
}


def good(node: Any, count: int) -> Callable[[], bool]:
    return lambda: node.controller.policy.good == count


def test_p08_before_the_good_samples_only_safe_is_sent(make_probe: Callable[..., Probe]) -> None:
    probe = make_probe(parameters={'controller': CONTROL | {'measurement_timeout': 0.0}})
    node = probe.add(ControllerNode())
    commands = probe.listen('command')
    measure, refer = probe.publisher('measurement'), probe.publisher('reference')
    probe.wait_until(lambda: len(commands) > 5 and probe.readers('measurement'))
    refer(9.0)
    for count, y in ((0, nan), (1, 4.0), (2, 4.0), (0, inf), (1, 4.0), (2, 4.0)):
        measure(y)
        probe.wait_until(good(node, count))
        assert (node.controller.mode, node.controller.cause) == (Mode.SAFE, Cause.START)
    n = len(commands)
    probe.wait_until(lambda: len(commands) > n + 5)
    assert set(commands) == {1.5}
    measure(4.0)
    probe.wait_until(lambda: node.controller.mode == Mode.OK)
    assert node.controller.reference[0] == 9.0


def test_a_reference_outside_its_range_is_told_and_not_taken(
    probe: Probe, start: Processes
) -> None:
    controller = start('controller', **CONTROL, reference_max=300.0, measurement_timeout=0.0)
    measure, refer = probe.publisher('measurement'), probe.publisher('reference')
    probe.wait_until(lambda: probe.readers('measurement') and probe.readers('reference'))

    def told() -> bool:
        measure(20.0)
        refer(5000.0)
        return '5000 is not taken: it is outside -1e+15 .. 300' in controller.said

    probe.wait_until(told)
    probe.wait_until(
        lambda: any(
            level == WARN and 'the reference 5000' in text for level, text, _ in probe.said()
        )
    )


def test_a_stuck_sensor_is_told_and_by_choice_ends_the_power(
    probe: Probe, start: Processes
) -> None:
    """The measurement stays at 20 at full power."""
    controller = start('controller', **CONTROL, stall_time=0.5)
    commands = probe.listen('command')
    measure, refer = probe.publisher('measurement'), probe.publisher('reference')
    probe.wait_until(lambda: probe.readers('measurement') and probe.readers('reference'))

    def said(words: str) -> Callable[[], bool]:
        def look() -> bool:
            measure(20.0)
            refer(60.0)
            return words in controller.said

        return look

    probe.wait_until(said('at a limit of the command for'))
    assert commands[-1] == 20.0
    assert probe.set('controller', stall_action='fault') == ['']
    probe.wait_until(said('no nearer to the reference at a limit'))
    probe.wait_until(lambda: commands[-1] == 1.5)
    probe.wait_until(
        lambda: any(
            level == ERROR and values['cause'] == 'stalled' for level, _, values in probe.said()
        )
    )
    probe.enable(False)
    probe.enable(True)
    probe.wait_until(said('in control'))
