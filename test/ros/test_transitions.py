"""What is said when the loop leaves its course: every transition once, and what went wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import re
import signal
import time
from typing import Any

from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.diagnostics import ERROR, OK, WARN
from probe import NodeProcess, Probe, Processes

RATE = 100.0
CONTROL: dict[str, Any] = {
    'rate': RATE,
    'plant_order': 1,
    'b0': 1.0,
    'inner_bandwidth': 30.0,  # 0.3 of the rate
    'controller_bandwidth': 12.0,
    'safe_command': 1.5,
    'command_rate_limit': 100.0,
}
# keeps a command of -5 from 0
PLANT: dict[str, Any] = {
    'rate': RATE,
    'plant': 'chain',
    'order': 1,
    'damping': 0.0,
    'disturbance': 'constant',
    'disturbance_offset': 5.0,
}


def lines(process: NodeProcess) -> list[str]:
    """Return what a node logged, without severity, time and name."""
    said = re.findall(r'^\[\w+\] \[[\d.]+\] \[[\w.]+\]: (.*)$', process.said, re.MULTILINE)
    return [line for line in said if not line.startswith('no reference yet')]


@contextmanager
def stopped(process: NodeProcess) -> Iterator[None]:
    """Freeze a process, as a machine that is too busy for it would."""
    process.signal(signal.SIGSTOP)
    yield
    process.signal(signal.SIGCONT)


def more(probe: Probe, heard: list[float], count: int) -> Callable[[], bool]:
    n = len(heard)
    return lambda: len(heard) >= n + count


def test_p05_p14_what_goes_against_the_rate_limit_is_logged_once(
    probe: Probe, start: Processes
) -> None:
    commands = probe.listen('command')
    start('plant', **PLANT)
    controller = start('controller', **CONTROL, measurement_timeout=0.0)
    probe.wait_until(lambda: commands and abs(commands[-1] + 5.0) < 0.2)
    assert probe.set('controller', command_rate_limit=0.5, inner_bandwidth=29.0) == ['', '']
    assert probe.set('controller', command_min=-20.0) == ['']  # wider: nothing to tell
    probe.wait_until(more(probe, commands, 10))
    assert lines(controller)[-1] == 'in control'
    n = len(commands)
    assert probe.set('controller', command_min=-3.0) == ['']
    probe.wait_until(lambda: commands[-1] >= -3.0)
    first = next(i for i in range(n, len(commands)) if commands[i] >= -3.0)
    assert commands[first - 1] < -4.0  # in one step
    probe.wait_until(more(probe, commands, 30))
    controller.signal(signal.SIGTERM)
    assert probe.end_of(controller) == 0
    probe.wait_until(lambda: commands[-1] == 1.5)
    jump, cut = lines(controller)[-3], lines(controller)[-1]
    last = f'{commands[-2]:g}'
    assert jump == (
        f'the command jumps from {commands[first - 1]:g} to -3: '
        'the range from -3 to 100 is entered at once'
    )
    assert lines(controller)[-2] == 'going to the safe command: disabled'
    assert cut == f'the ramp to the safe command is cut short at {last}: 1.5 is sent at once'
    assert commands[-2] < -2.0
    for part in ('jumps', 'cut short'):
        assert controller.said.count(part) == 1


def test_p11_disabled_on_the_way_to_another_safe_command_it_still_gets_there(
    make_probe: Callable[..., Probe],
) -> None:
    probe = make_probe(parameters={'controller': CONTROL | {'command_rate_limit': 0.4}})
    node = probe.add(ControllerNode())
    commands = probe.listen('command')
    assert probe.enable().success
    safe = CONTROL['safe_command']
    probe.wait_until(lambda: len(commands) > 5 and commands[-1] == safe)
    assert probe.set('controller', safe_command=safe + 1.0) == ['']
    probe.wait_until(lambda: commands[-1] > safe)
    assert probe.enable(False).success
    assert commands[-1] < safe + 1.0
    probe.wait_until(lambda: node._silent)
    probe.wait_until(lambda: commands[-1] == safe + 1.0)
    n, periods = len(commands), node.ticker.periods
    probe.wait_until(lambda: node.ticker.periods > periods + 10)
    assert len(commands) == n


def test_p19_of_several_faults_the_most_severe_acts_and_each_transition_is_logged_once(
    probe: Probe, start: Processes
) -> None:
    commands, refer = probe.listen('command'), probe.publisher('reference')
    plant = start('plant', **PLANT, command_timeout=0.0)
    controller = start(
        'controller',
        **CONTROL,
        measurement_timeout=1.0,
        reference_timeout=1.0,
        hold_time=3600.0,
        good_samples=5,
    )

    def shown(mode: str, cause: str) -> bool:
        values = probe.said()[-1][2]
        return (values.get('mode'), values.get('cause')) == (mode, cause)

    def referring(mode: str, cause: str) -> bool:
        refer(0.0)
        return shown(mode, cause)

    probe.wait_until(lambda: 'controller' in probe.readers('reference'))
    probe.wait_until(lambda: commands and probe.said())
    probe.wait_until(lambda: referring('ok', 'none') and abs(commands[-1] + 5.0) < 0.2)
    probe.wait_until(lambda: shown('holding', 'reference_timeout'))
    with stopped(plant):
        probe.wait_until(lambda: shown('holding', 'measurement_timeout'))
        assert probe.said()[-1][0] == ERROR
        assert probe.enable(False).success
        probe.wait_until(lambda: shown('safe', 'disabled') and commands[-1] == 1.5)
        assert probe.said()[-1][0] == WARN
        assert probe.enable().success
        probe.wait_until(lambda: shown('safe', 'measurement_timeout'))
        probe.wait_until(more(probe, commands, 20))
    probe.wait_until(more(probe, commands, 20))  # a fault does not become milder
    assert shown('safe', 'measurement_timeout')
    probe.wait_until(lambda: referring('ok', 'none'))
    assert probe.said()[-1][0] == OK
    assert lines(controller)[-7:] == [
        'in control',
        'holding: no valid reference',
        'holding: no valid measurement',
        'going to the safe command: disabled',
        'at the safe command: disabled',
        'at the safe command: no valid measurement',
        'in control',
    ]


def test_p17_p15_a_frozen_controller_catches_nothing_up_and_the_plant_waits_at_safe(
    probe: Probe, start: Processes
) -> None:
    commands = probe.listen('command')
    plant = start('plant', **PLANT, command_timeout=0.2, safe_command=-4.0)
    controller = start('controller', **CONTROL)
    probe.wait_until(lambda: commands and abs(commands[-1] + 5.0) < 0.2)
    probe.wait_until(lambda: probe.said() and probe.said('plant'))

    def missed() -> int:
        return int(probe.said()[-1][2]['missed_periods'])

    before, measurements = missed(), probe.listen('measurement')
    with stopped(controller):
        probe.wait_until(lambda: 'no command for' in plant.said)
        probe.wait_until(more(probe, measurements, 100))  # the plant keeps the time
        n, begin = len(commands), time.monotonic()
    probe.wait_until(more(probe, commands, 1))
    probe.wait_until(more(probe, measurements, 30))
    # as many commands as periods went by: those that were missed are not made up for
    assert len(commands) - n <= RATE * (time.monotonic() - begin) + 5
    probe.wait_until(lambda: missed() - before >= 90)
    probe.wait_until(lambda: abs(commands[-1] + 5.0) < 0.2 and probe.said()[-1][2]['mode'] == 'ok')
    probe.wait_until(lambda: probe.said('plant')[-1][0] == OK)

    def timeouts() -> int:
        return int(probe.said('plant')[-1][2]['command_timeouts'])

    # one in 5 s is logged, and before it is reported
    probe.wait_until(lambda: 1 <= plant.said.count('no command for') <= timeouts())
    assert timeouts() < 10  # a busy machine makes its own
