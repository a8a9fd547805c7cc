"""The loop in real time: what is sent when, and what happens when something stays away."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from math import inf, isfinite, nan
import signal
import time
from typing import Any

from nadrc_ros.adrc.status import Cause, Mode, Status
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.reference import ReferenceNode
from nadrc_ros.ros.diagnostics import ERROR, WARN
from nadrc_ros.ros.versions import make_executor
from probe import Probe, Processes
import pytest
from rclpy.executors import SingleThreadedExecutor

Make = Callable[..., Probe]
RATE = 100.0
PLANT: dict[str, Any] = {'rate': RATE, 'plant': 'chain', 'order': 1}
# in the steady state the command is -5
DISTURBED: dict[str, Any] = {
    **PLANT,
    'disturbance': 'constant',
    'disturbance_offset': 5.0,
    'damping': 0.0,
}
CONTROL: dict[str, Any] = {
    'rate': RATE,
    'plant_order': 1,
    'b0': 1.0,
    'inner_bandwidth': 30.0,  # 0.3 of the rate
    'command_max': 20.0,
    'command_min': -20.0,
}


def loop(make: Make, plant: dict[str, Any], **settings: Any) -> tuple[Probe, Any, Any]:
    """Run plant and controller beside the probe."""
    probe = make(parameters={'controller': {**CONTROL, **settings}, 'plant': plant})
    return probe, probe.add(ControllerNode()), probe.add(PlantNode())


def passes(count: Callable[[], int], last: int) -> Callable[[], bool]:
    return lambda: count() > last


def used(node: Any) -> int:
    """Return how many steps took a sample, also those that came so late that they saturate."""
    counts = node.controller.counts
    return sum(n for status, n in counts.items() if status < Status.NO_MEASUREMENT)


def estimates(node: Any) -> list[Any]:
    state = node.controller.state
    return [state.levels, state.profile, state.offset]


@pytest.mark.parametrize('kind', ['events', 'single'])
def test_p17_periods_and_missed_ones_add_up_to_the_time(kind: str, make_probe: Make) -> None:
    executors = {'single': {'executor': SingleThreadedExecutor}, 'events': {}}
    probe = make_probe(parameters={'controller': CONTROL}, **executors[kind])
    ticker = probe.add(ControllerNode()).ticker
    probe.wait_until(lambda: ticker.periods > 2)
    begin, counted = ticker._last, ticker.periods + ticker.missed
    probe.wait_until(lambda: ticker.periods > 50)
    time.sleep(0.255)  # a stall
    probe.wait_until(lambda: ticker.periods > 100)
    elapsed = (ticker._last - begin) * 1e-9 * RATE
    assert ticker.periods + ticker.missed - counted == pytest.approx(elapsed, rel=0.01, abs=2.0)
    assert ticker.missed >= 20


def test_time_goes_on_for_plant_and_reference_while_their_process_stands_still(
    make_probe: Make,
) -> None:
    own = {'rate': RATE, 'start': 'at_once'}
    probe = make_probe(parameters={'plant': PLANT | own, 'reference': own})
    plant, reference = probe.add(PlantNode()), probe.add(ReferenceNode())
    probe.wait_until(lambda: plant.process.k > 2 and reference.k > 2)
    times: list[tuple[Any, Callable[[], int]]] = [
        (plant, lambda: plant.process.k),
        (reference, lambda: reference.k),
    ]
    for node, k in times:
        for _ in range(3):
            first, begin = k(), node.ticker._last
            time.sleep(0.255)  # a stall
            probe.wait_until(passes(k, first + 60))
            elapsed = (node.ticker._last - begin) * 1e-9 * RATE
            if elapsed < 100.0:  # a busy machine may make it longer than time goes on in
                break
        assert k() - first == pytest.approx(elapsed, abs=2.0)
        assert node.ticker.missed >= 20


def test_a_tick_without_a_measurement_holds_everything(make_probe: Make) -> None:
    patient = {'measurement_timeout': 0.0, 'max_dt': 3600.0}
    probe = make_probe(parameters={'controller': CONTROL | patient})
    node = probe.add(ControllerNode())
    commands = probe.listen('command')
    measure, refer = probe.publisher('measurement'), probe.publisher('reference')
    probe.wait_until(lambda: probe.readers('measurement') and probe.readers('reference'))
    for value in (0.5, 0.4, 0.2, 0.3, 0.1):
        last = used(node)
        refer(2.0)
        measure(value)
        probe.wait_until(passes(lambda: used(node), last))
    state = deepcopy(estimates(node))
    idle, n, command = node._idle, len(commands), node.controller.command
    probe.wait_until(lambda: node._idle > idle + 10 and len(commands) > n + 10)
    assert estimates(node) == state
    assert command != 0.0
    assert set(commands[n + 1 :]) == {command}


def test_p08_plant_and_controller_alone_are_a_working_loop(make_probe: Make) -> None:
    disturbed = DISTURBED | {'initial_state': [3.0]}
    probe, node, plant = loop(make_probe, disturbed, safe_command=1.5, controller_bandwidth=8.0)
    commands, outputs = probe.listen('command'), probe.listen('plant/output')
    probe.wait_until(lambda: node.controller.mode == Mode.OK)
    held, rate = node.controller.reference
    assert held in outputs and rate == 0.0
    probe.wait_until(lambda: plant.process.k > 150 and abs(plant.process.output - held) < 0.01)
    probe.wait_until(lambda: abs(commands[-1] + 5.0) < 0.1)
    assert commands[0] == 1.5
    assert max(outputs) < 5.0 or plant.ticker.missed >= 10


def test_each_measurement_triggers_one_command_and_the_watch_goes_on_in_silence(
    make_probe: Make,
) -> None:
    slow = {'rate': 2.0, 'measurement_timeout': 0.0, 'max_dt': 3.0, 'trigger': 'measurement'}
    probe = make_probe(parameters={'controller': CONTROL | slow})
    node = probe.add(ControllerNode())
    commands, measure = probe.listen('command'), probe.publisher('measurement')
    probe.wait_until(lambda: probe.readers('measurement') and probe.readers('command'))
    for i in range(20):
        measure(0.1 * i)
        probe.wait_until(lambda: len(commands) == i + 1 + node._idle)  # noqa: B023
    assert sum(node.controller.counts.values()) == 20 + node._idle
    n, idle, periods = len(commands), node._idle, node.ticker.periods
    probe.wait_until(lambda: len(commands) >= n + 3)
    assert node._idle >= idle + 3
    # in silence every period has its tick, so that a timeout is noticed in time
    assert node.ticker.periods - periods <= 3 + 2


def test_p07_silence_of_measurements_ends_at_safe_and_p04_good_ones_end_that(
    probe: Probe, start: Processes
) -> None:
    commands = probe.listen('command')
    plant = start('plant', **DISTURBED)
    controller = start(
        'controller',
        **CONTROL,
        safe_command=-2.0,
        command_rate_limit=20.0,
        measurement_timeout=1.0,
        good_samples=5,
    )
    probe.wait_until(lambda: commands and abs(commands[-1] + 5.0) < 0.5)
    probe.wait_until(lambda: probe.said() and probe.said()[-1][2]['mode'] == 'ok')
    plant.signal(signal.SIGSTOP)
    probe.wait_until(lambda: commands[-1] == -2.0)
    fault = [v['cause'] for level, _, v in probe.said() if level == ERROR]
    assert set(fault) == {'measurement_timeout'}
    n = len(commands)
    probe.wait_until(lambda: len(commands) > n + 5)
    assert set(commands[n:]) == {-2.0}  # it goes on sending
    plant.signal(signal.SIGCONT)
    probe.wait_until(lambda: abs(commands[-1] + 5.0) < 0.5 and probe.said()[-1][2]['mode'] == 'ok')
    modes = [f'{v["mode"]} {v["cause"]}' for _, _, v in probe.said()]
    changes = [mode for i, mode in enumerate(modes) if i == 0 or modes[i - 1] != mode]
    lost = 'measurement_timeout'
    expected = ['ok none', f'holding {lost}', f'ramping {lost}', f'safe {lost}', 'ok none']
    assert changes[-5:] == expected
    for line, times in {
        'holding: no valid measurement': 1,
        'going to the safe command: no valid measurement': 1,
        'at the safe command: no valid measurement\n': 1,
        'in control': 2,
    }.items():
        assert controller.said.count(line) == times, controller.said


def test_p07_silence_of_the_reference_is_a_fault_too(make_probe: Make) -> None:
    probe, node, _ = loop(make_probe, PLANT, reference_timeout=0.3, good_samples=4)
    refer = probe.publisher('reference')
    probe.wait_until(lambda: node.controller.mode == Mode.OK and probe.readers('reference'))
    refer(nan)  # never a reference: the one that was taken from the plant holds
    probe.wait_until(lambda: node.controller.counts[Status.BAD_REFERENCE] == 1)
    refer(1.0)
    probe.wait_until(lambda: node.controller.cause == Cause.REFERENCE_TIMEOUT)
    probe.wait_until(lambda: node.controller.mode == Mode.SAFE)
    assert (ERROR, 'reference_timeout') in [(level, v['cause']) for level, _, v in probe.said()]

    def again() -> bool:
        refer(1.0)
        return bool(node.controller.mode == Mode.OK)

    probe.wait_until(again)


def test_p01_measurements_that_are_no_numbers_touch_nothing(make_probe: Make) -> None:
    own = CONTROL | {'measurement_timeout': 0.0, 'good_samples': 1}
    probe = make_probe(parameters={'controller': own})
    node = probe.add(ControllerNode())
    commands, measure = probe.listen('command'), probe.publisher('measurement')
    probe.wait_until(lambda: probe.readers('measurement'))
    measure(1.0)
    probe.wait_until(lambda: node.controller.mode == Mode.OK)
    state = deepcopy(estimates(node))
    for value in (nan, inf, -inf, 1e308):
        last = len(node.latencies._values)
        measure(value)
        probe.wait_until(passes(lambda: len(node.latencies._values), last))
    assert estimates(node) == state
    assert all(map(isfinite, commands))


def test_p11_disabling_ends_in_silence_at_safe_and_enabling_goes_on_from_there(
    make_probe: Make,
) -> None:
    patient = DISTURBED | {'command_timeout': 0.0}
    probe, node, plant = loop(make_probe, patient, safe_command=-2.0, command_rate_limit=50.0)
    commands = probe.listen('command')
    assert probe.enable().message == 'already enabled'
    probe.wait_until(lambda: commands and abs(commands[-1] + 5.0) < 0.2)
    assert probe.enable(False).message == 'disabled'
    probe.wait_until(lambda: node.controller.quiet)
    probe.wait_until(lambda: commands[-1] == -2.0)
    n, k = len(commands), plant.process.k
    probe.wait_until(lambda: plant.process.k > k + 20)
    assert len(commands) == n
    assert probe.enable().message == 'enabled'
    probe.wait_until(lambda: len(commands) > n + 20)
    assert abs(commands[n] + 2.0) < 1e-9
    assert max(abs(b - a) for a, b in zip(commands[n:], commands[n + 1 :])) < 50.0 * 0.2
    probe.wait_until(lambda: abs(commands[-1] + 5.0) < 0.2)


def test_a_reset_restarts_the_observers_without_a_bump(make_probe: Make) -> None:
    probe, node, _ = loop(make_probe, DISTURBED)
    commands = probe.listen('command')
    for _ in range(5):
        probe.wait_until(lambda: commands and abs(commands[-1] + 5.0) < 0.05)
        n, missed = len(commands), node.ticker.missed
        assert probe.trigger('controller/reset').success
        probe.wait_until(passes(lambda: len(commands), n + 50))
        probe.wait_until(lambda: node.controller.mode == Mode.OK)
        if node.ticker.missed == missed:  # a busy machine makes bumps of its own
            break
    assert all(abs(command + 5.0) < 2.0 for command in commands[n:])  # a bump would be 5


def test_time_begins_with_the_first_command(make_probe: Make) -> None:
    cosine = {'rate': RATE, 'signal': 'cosine', 'amplitude': 3.0, 'frequency': 2.0}
    noisy = DISTURBED | {'initial_state': [2.5], 'noise_variance': 0.01}
    probe = make_probe(
        parameters={
            'controller': CONTROL | {'enabled_at_start': False},
            'plant': noisy,
            'reference': cosine,
        }
    )
    reference = probe.add(ReferenceNode())
    plant, node = probe.add(PlantNode()), probe.add(ControllerNode())
    outputs, references = probe.listen('plant/output'), probe.listen('reference')
    commands = probe.listen('command')
    probe.wait_until(lambda: len(outputs) > 20 and len(references) > 20)
    assert set(outputs) == {2.5}
    assert set(references) == {3.0}
    assert (plant.process.k, reference.k, node.controller.enabled) == (0, 0, False)
    assert commands == []
    probe.enable()
    probe.wait_until(lambda: plant.process.k > 20 and reference.k > 20)
    assert references[-1] != 3.0
    assert outputs[-1] != 2.5
    assert abs(plant.process.k - reference.k) <= 3


def test_p15_a_command_that_is_no_number_neither_acts_nor_counts_as_one(
    make_probe: Make,
) -> None:
    probe = make_probe(parameters={'plant': DISTURBED | {'command_timeout': 0.2}})
    plant = probe.add(PlantNode())
    command = probe.publisher('command')
    probe.wait_until(lambda: probe.readers('command'))
    command(-5.0)
    probe.wait_until(lambda: plant.process.k > 0)

    def timed_out() -> bool:
        command(nan)
        command(-inf)
        return bool(plant._timed_out)

    probe.wait_until(timed_out)
    assert isfinite(plant.process.output)
    probe.wait_until(lambda: probe.said('plant') and probe.said('plant')[-1][0] == WARN)
    assert int(probe.said('plant')[-1][2]['commands_not_finite']) > 0


def test_p15_killed_the_controller_leaves_the_plant_at_its_safe_command(
    make_probe: Make, start: Processes
) -> None:
    decaying = PLANT | {'initial_state': [3.0], 'damping': 5.0, 'command_timeout': 1.0}
    probe = make_probe(parameters={'plant': decaying})
    plant = probe.add(PlantNode())
    controller = start('controller', **CONTROL, controller_bandwidth=10.0)
    # The safe command may reach the plant before the controller hears of it, and let it decay.
    reference = probe.publisher('reference')
    probe.wait_until(lambda: probe.readers('reference'))
    reference(3.0)
    probe.wait_until(lambda: plant.process.k > 100 and abs(plant.process.output - 3.0) < 0.5)
    controller.signal(signal.SIGKILL)
    assert controller.end() == -signal.SIGKILL
    probe.wait_until(lambda: abs(plant.process.output) < 0.01)
    assert plant._timed_out and plant._timeouts > 0
    probe.wait_until(lambda: probe.said('plant') and probe.said('plant')[-1][0] == WARN)
    assert probe.said('plant')[-1][2]['command_timeouts'] == str(plant._timeouts)
    again = start('controller', **CONTROL)
    probe.wait_until(lambda: not plant._timed_out)
    assert again.running


def test_two_publishers_of_the_measurement_are_told_also_under_another_name(
    probe: Probe, start: Processes
) -> None:
    controller = start('controller', '-r', 'measurement:=state', **CONTROL)
    first, second = probe.publisher('state'), probe.publisher('state')
    probe.wait_until(lambda: probe.readers('state'))
    first(0.0)
    second(0.1)
    probe.wait_until(lambda: probe.said() and 'several publishers' in probe.said()[-1][1])
    assert probe.said()[-1][2]['measurement_publishers'] == '2'
    assert controller.running


@pytest.mark.parametrize('share', (1.01, 0.5))
def test_p17_with_measurements_as_trigger_only_what_was_missed_is_counted(
    share: float, make_probe: Make
) -> None:
    """Neither a source a little fast hides a stall, nor is a slow one taken for many."""
    trigger = {'trigger': 'measurement', 'rate': 50.0, 'measurement_timeout': 0.0}
    probe = make_probe(parameters={'controller': CONTROL | trigger})
    ticker = probe.add(ControllerNode()).ticker
    measure = probe.publisher('measurement')
    probe.wait_until(lambda: probe.readers('measurement'))
    probe.node.create_timer(1.0 / (50.0 * share), lambda: measure(0.0))
    probe.wait_until(lambda: ticker.periods > 10)
    missed = []
    for _ in range(3):
        before, begin = ticker.missed, ticker.periods
        probe.wait_until(passes(lambda: ticker.periods, begin + 40))
        missed.append(ticker.missed - before)
    assert min(missed) <= 20  # on a busy machine; a wrong count would be 40
    before = ticker.missed
    time.sleep(0.4)  # a stall
    probe.wait_until(lambda: ticker.missed >= before + 15)


@pytest.mark.parametrize('executor', [make_executor, SingleThreadedExecutor])
def test_p17_measurements_that_a_stall_lost_are_missed_once(
    executor: Callable[[], Any], make_probe: Make, start: Processes
) -> None:
    """The one executor runs timers first when a stall ends, the other one what was received."""
    trigger = {'trigger': 'measurement', 'measurement_timeout': 0.0}
    probe = make_probe(executor=executor, parameters={'controller': CONTROL | trigger})
    ticker = probe.add(ControllerNode()).ticker
    start('plant', **PLANT, start='at_once')
    numbers = ticker._losses
    probe.wait_until(lambda: numbers.newest > 10)
    begin, counted = ticker._last, ticker.periods + ticker.missed
    for _ in range(4):
        k = numbers.newest
        time.sleep(0.255)  # a stall
        probe.wait_until(passes(lambda: numbers.newest, k + 30))
    counted = ticker.periods + ticker.missed - counted
    elapsed = (ticker._last - begin) * 1e-9 * RATE
    assert counted == pytest.approx(elapsed, abs=30.0)  # twice would be 100 more
    assert ticker.missed >= 80
