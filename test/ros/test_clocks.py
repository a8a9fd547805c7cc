"""Samples out of order and clocks that jump, on the real graph: counted, and no harm done."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import json
from math import isfinite
from pathlib import Path
import random
import signal
from typing import Any

from nadrc_ros.adrc.status import Status
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.topics import Info
from probe import Probe, Processes
import pytest
from rosgraph_msgs.msg import Clock

RATE = 100.0
HOUR = 3600 * 10**9
CONTROL: dict[str, Any] = {'rate': RATE, 'plant_order': 1, 'controller_bandwidth': 10.0}
# never at rest, so that an old sample is a wrong one
PLANT: dict[str, Any] = {
    'rate': RATE,
    'plant': 'chain',
    'order': 1,
    'disturbance': 'sine',
    'disturbance_amplitude': 60.0,
    'disturbance_frequency': 5.0,
    'initial_state': [1.0],
}


class Disordered(ControllerNode):
    """A controller whose transport repeats, overtakes and delays samples, and shifts stamps."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.late: list[tuple[int, float, Info]] = []
        self.given = dict.fromkeys(('repeated', 'late', 'future'), 0)
        self.active = False
        self.stamps: list[int] = []
        super().__init__()

    def _on_measurement(self, value: float, info: Info) -> None:
        number = info['publication_sequence_number']
        self.stamps.append(info['source_timestamp'])
        kind = 'good'
        if self.active:
            kind = self.random.choice(('repeated', 'late', 'future', *5 * ('good',)))
        if kind == 'good':
            super()._on_measurement(value, info)
        elif kind == 'late':  # by up to 20 periods, while the fresh ones go on
            self.late.append((number + self.random.randint(1, 20), value, info))
            return
        elif kind == 'repeated':
            self.given['repeated'] += 1
            super()._on_measurement(value, info)
            super()._on_measurement(value, dict(info))
        else:
            self.given['future'] += 1
            stamp = info['source_timestamp'] + HOUR
            super()._on_measurement(value, {**info, 'source_timestamp': stamp})
        # right after a newer one: two old ones in a row are what a restarted publisher sends
        if due := [entry for entry in self.late if entry[0] <= number]:
            self.late.remove(due[0])
            self.given['late'] += 1
            super()._on_measurement(*due[0][1:])


@pytest.mark.parametrize('trigger', ['timer', 'measurement'])
def test_p09_late_repeated_and_reordered_samples_are_counted_and_do_not_corrupt_the_estimate(
    trigger: str, make_probe: Callable[..., Probe], start: Processes, tmp_path: Path
) -> None:
    # 'measurement': each of them is used, whereas a timer takes the last that came
    trace = tmp_path / 'trace.jsonl'
    own = {'trigger': trigger, 'trace': str(trace)}
    probe = make_probe(parameters={'controller': CONTROL | own})
    node = probe.add(Disordered(seed=9))
    outputs, estimates = probe.listen('plant/output'), probe.listen('controller/output_estimate')
    start('plant', **PLANT)
    probe.wait_until(lambda: len(outputs) > 100)
    node.active = True
    m, k = len(estimates), len(outputs)
    probe.wait_until(lambda: len(outputs) >= k + 150 and min(node.given.values()) > 5)
    lowest, highest = min(outputs[k - 1 :]), max(outputs[k - 1 :])
    assert highest - lowest > 0.5
    assert all(lowest - 0.2 < estimate < highest + 0.2 for estimate in estimates[m + 2 : -2])
    node.diagnostics.publish()
    periods = str(node.ticker.periods)
    given, total = dict(node.given), (node.stamps[-1] - node.stamps[0]) * 1e-9

    def published() -> list[dict[str, str]]:
        return [report[2] for report in probe.said() if report[2]['periods'] == periods]

    values = probe.wait_until(published)[-1]
    counted = {key: int(value) for key, value in values.items() if value.isdigit()}
    if trigger == 'measurement':
        disordered = given['repeated'] + given['late']
        assert counted['measurements_out_of_order'] == disordered
        assert counted['steps_bad_time_step'] == disordered
        assert counted['stamps_from_future'] == given['future']
    else:
        assert 0 < counted['stamps_from_future'] <= given['future']
        assert 0 < counted['measurements_out_of_order'] <= given['repeated'] + given['late']
        assert counted['measurements_overwritten'] >= given['repeated']
    # the time that the estimate was moved on by is the time that went by
    node.trace.flush()
    spans = [tick['dt'] for tick in ticks_of(trace) if tick['dt'] > 0.0]
    assert abs(sum(spans) - total) < 0.2


def ticks_of(trace: Path) -> list[dict[str, Any]]:
    lines = trace.read_text(encoding='utf-8').splitlines(keepends=True)
    return [json.loads(line) for line in lines if '"u"' in line and line.endswith('\n')]


class SimulatedTime:
    """Publishes /clock by half periods, and what a plant y' = u + 5 measures meanwhile."""

    def __init__(self, probe: Probe) -> None:
        self.probe = probe
        self.clock = probe.node.create_publisher(Clock, '/clock', 10)
        self.measure = probe.publisher('measurement')
        self.commands = probe.listen('command')
        self.output = 1.0
        self.steps = self.heard = 0
        probe.wait_until(self.clock.get_subscription_count)
        probe.wait_until(lambda: probe.readers('measurement') and probe.readers('command'))

    def run(self, begin: float, count: int) -> None:
        """Let time go on from ``begin`` [s] until ``count`` more commands came."""
        self.heard, k, came = len(self.commands), 0, 0
        target = self.heard + count
        while len(self.commands) < target:
            assert k < 20 * count, 'simulated time goes on and no command comes'
            now = Clock()
            now.clock.sec, now.clock.nanosec = divmod(round((begin + 0.5 * k / RATE) * 1e9), 10**9)
            self.measure(self.output)
            self.clock.publish(now)
            self.probe.spin(0.002)
            k += 1
            if k - came > 2:  # a busy machine takes its time, and this clock waits for it
                with suppress(TimeoutError):
                    self.probe.wait_until(lambda: len(self.commands) > self.heard, 0.5)
            if len(self.commands) > self.heard:
                self.heard, came = len(self.commands), k
            if self.commands:
                self.output += 0.5 / RATE * (self.commands[-1] + 5.0)
        self.steps += k


def test_p10_simulated_time_that_jumps_is_no_update_and_no_bump(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    trace = tmp_path / 'trace.jsonl'
    own = {'use_sim_time': True, 'trace': str(trace), 'max_dt': 0.5, 'measurement_timeout': 0.0}
    controller = start('controller', **CONTROL | own)
    time = SimulatedTime(probe)
    time.run(1000.0, 100)
    jumps = (1100.0, 5000.0, 4000.0, 10.0, 11.0)
    for begin in jumps:
        time.run(begin, 50)
    # one command per period: those of the time that was jumped over are not made up for
    assert len(time.commands) <= 0.5 * time.steps + 3 * len(jumps)
    assert all(map(isfinite, time.commands))
    controller.signal(signal.SIGINT)
    assert probe.end_of(controller) == 0
    assert 'Traceback' not in controller.said
    counts, used = dict.fromkeys(Status, 0), 0
    for tick in ticks_of(trace):
        status = Status(tick['status'])
        counts[status] += 1
        idle = status in (Status.NO_MEASUREMENT, Status.BAD_TIME_STEP)
        assert (tick['dt'] <= 0.0) == idle
        assert (tick['dt'] > 0.5) == (status == Status.RESTARTED)
        if tick['enabled'] and (idle or status == Status.RESTARTED):
            assert tick['u'] == tick['applied']
        used += 0.0 < tick['dt'] <= 0.5
    assert counts[Status.RESTARTED] >= 2
    assert used > 0.8 * sum(counts.values())
    assert all(-8.0 < command < -2.0 for command in time.commands[100:-1])
