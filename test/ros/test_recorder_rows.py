"""The rows that a recorder makes of what a loop sends, and their figures of merit."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate, pairwise
from math import isnan, nan
from pathlib import Path
from statistics import median
import time

from feed import fed_steadily, Feed, INPUTS, PERIOD
from nadrc_ros.nodes.plant import LONGEST_STALL, PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.records.figures import summarise
from nadrc_ros.records.history import read_history
from nadrc_ros.records.recording import read_samples, SAMPLES, STAMPS
from nadrc_ros.ros.diagnostics import WARN
import numpy as np
from probe import Probe
import pytest
from rosgraph_msgs.msg import Clock

RATE = 100.0


def test_a_row_is_an_instant_by_its_stamp_with_the_command_that_acted_from_there_on(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.samples(6)
    rows = feed.rows(6)  # the last one without a next
    assert list(rows) == ['time', *INPUTS.split(), *STAMPS]
    assert rows['measurement'] == [0.1 * k for k in range(1, 7)]
    assert rows['command'] == [0.01 * k for k in range(1, 7)]
    assert rows['output'] == [0.1 * k + 0.5 for k in range(1, 7)]
    begin, *_ = stamps = rows['measurement_stamp']
    assert rows['time'] == pytest.approx([stamp - begin for stamp in stamps], abs=1e-3)
    for one, two in zip(stamps, rows['command_stamp']):
        assert one < two < one + PERIOD


def test_a_run_is_of_the_rate_of_its_stamps(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """Whatever the rate of the recorder, which is that of its parameter or the default one."""
    for rate in (1.0, 200.0):
        feed = fed_steadily(make_probe, tmp_path, 60, rate=rate)
        spans = np.diff(feed.rows(60)['time'])
        summary = feed.summary()
        assert summary['rows'] == 60
        assert summary['rate'] == pytest.approx(1.0 / np.median(spans), rel=0.1)
        spans = np.append(spans, 1.0 / summary['rate'])
        assert summary['metrics']['duration'] == pytest.approx(spans.sum(), rel=0.02)
        # r = 1, y = 0.1 k + 0.5
        errors = np.abs(0.1 * np.arange(1, 61) - 0.5)
        assert summary['metrics']['iae'] == pytest.approx(errors @ spans, rel=0.02)
        feed.probe.close()


def test_a_silent_sensor_leaves_a_gap_with_its_cause_and_the_figures_see_the_truth(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.samples(20)
    for _ in range(30):
        feed.sample(silent=True)
    feed.samples(20)
    folder = feed.recorder.folder.path
    summary = feed.summary()
    rows = read_samples(folder)
    measured = [k for k, y in enumerate(rows['measurement']) if not isnan(y)]
    fed = [*range(1, 21), *range(51, 71)]
    assert [rows['measurement'][k] for k in measured] == [0.1 * k for k in fed]
    assert 55 <= len(rows['time']) <= 70  # a busy machine sends some outputs too near to others
    for output, command in zip(rows['output'], rows['command']):
        assert round(100.0 * command) - round(10.0 * (output - 0.5)) in (0, 1)
    assert summary['gap_time'] == 0.0
    assert summary['metrics']['max_error'] == pytest.approx(6.5)
    (gap,) = read_history(folder).events
    assert gap.time == pytest.approx(rows['time'][measured[19]], abs=1e-3)
    assert gap.kind == 'gap'
    lasted = rows['time'][measured[20]] - rows['time'][measured[19]]
    assert gap.message == f'no measurement for {lasted:.4g} s: nothing was sent'


def test_silence_of_all_is_in_no_figure_and_told(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.samples(20)
    feed.probe.spin(1.0)
    feed.samples(20)
    spans = np.diff(feed.rows(40)['time'])
    usual = float(np.median(spans))
    level, message, values = feed.recorder.report()
    assert level == WARN
    assert message.endswith('s without a measurement or a true output are in no figure')
    assert values['gap_time'] == pytest.approx(spans.max() - usual, abs=0.01)
    assert values['gap_time'] > 0.9
    summary = feed.summary()
    assert summary['gap_time'] == values['gap_time']
    lasted = spans.sum() - spans.max() + 2.0 * usual
    assert summary['metrics']['duration'] == pytest.approx(lasted, rel=0.05)


def test_time_begins_at_the_first_command_even_when_that_came_before_any_measurement(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.send['command'](0.0)
    feed.probe.wait_until(lambda: 'command' not in feed.intake.unheard())
    feed.samples(6)
    assert feed.rows(6)['time'][0] == 0.0
    first = (feed.recorder.folder.path / SAMPLES).read_text().splitlines()[1]
    assert first.startswith('0.0,1.0,0.1,')


def test_an_unknown_value_is_an_empty_column(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    for _ in range(2):
        feed.send['measurement'](3.0)
        feed.send['command'](nan)
        feed.probe.spin(0.01)
    rows = feed.rows(1)
    assert rows['measurement'] == [3.0]
    assert all(isnan(rows[name][0]) for name in ('reference', 'command', 'output'))
    line = (feed.recorder.folder.path / SAMPLES).read_text().splitlines()[1]
    assert line.startswith('0.0,,3.0,,,')
    assert feed.summary()['metrics']['skipped'] == 2


def test_periods_that_the_plant_missed_leave_a_gap_and_are_no_loss(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    plant = {'rate': RATE, 'plant': 'chain', 'order': 1, 'damping': 0.0, 'command_timeout': 0.0}
    recorder = {'directory': str(tmp_path)}
    probe = make_probe(parameters={'recorder': recorder, 'plant': plant})
    node, command = probe.add(RecorderNode()), probe.publisher('command')
    probe.add(PlantNode())
    probe.wait_until(lambda: len(probe.readers('command')) == 2)
    command(1.0)
    probe.wait_until(lambda: node.figures.rows > 20)
    rows = node.figures.rows
    time.sleep(0.255)  # a stall
    probe.wait_until(lambda: node.figures.rows > rows + 60)
    samples = read_samples(node.folder.path)
    gaps = [b - a for a, b in pairwise(samples['time'])]
    assert max(gaps) >= 0.2
    # y' = u = 1: the output tells the time of the plant
    passed = accumulate((min(gap, LONGEST_STALL) for gap in gaps), initial=0.0)
    late = [y - t for t, y in zip(passed, samples['output'])]
    stall = 1 + gaps.index(max(gaps))
    # a busy machine may send single samples late
    assert abs(median(late[stall:]) - median(late[:stall])) <= 2.0 / RATE
    assert sum(node.intake.lost.values()) == 0


def test_a_restarted_plant_goes_on_in_time(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.samples(3)
    old = feed.send['measurement']
    feed.send['measurement'] = feed.probe.publisher('measurement')  # its numbers begin anew
    feed.samples(3)
    assert old is not feed.send['measurement']
    rows = feed.rows(6)
    begin, *_ = stamps = rows['measurement_stamp']
    assert rows['time'] == pytest.approx([stamp - begin for stamp in stamps], abs=1e-3)
    assert sum(feed.intake.lost.values()) == 0


def test_a_second_publisher_is_no_loss_and_shifts_no_time(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    intruder = feed.probe.publisher('measurement')
    feed.samples(20)
    losses = feed.intake.losses['measurement']
    for k in (1, 2):
        intruder(-7.0)
        feed.probe.wait_until(lambda: losses.newest == k)  # noqa: B023
        feed.sample()
    rows = feed.rows(24)
    assert feed.intake.lost['measurement'] == 0
    own = [(t, y) for t, y in zip(rows['time'], rows['measurement']) if y > 0.0]
    assert [y for _, y in own] == [0.1 * k for k in range(1, 23)]
    assert own[-1][0] == pytest.approx(21 * PERIOD, rel=0.3)


def test_in_simulated_time_rows_are_of_that_clock_and_time_stands_still_where_it_goes_back(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    probe = make_probe(parameters={'recorder': {'directory': str(tmp_path), 'use_sim_time': True}})
    recorder = probe.add(RecorderNode())
    clock = probe.node.create_publisher(Clock, '/clock', 10)
    send = {name: probe.publisher(name) for name in ('reference', 'measurement', 'command')}
    probe.wait_until(lambda: clock.get_subscription_count() and probe.readers('command'))
    losses = recorder.intake.losses

    def go_to(seconds: float) -> None:
        now = Clock()
        now.clock.sec, now.clock.nanosec = divmod(round(seconds * 1e9), 10**9)
        clock.publish(now)
        probe.wait_until(lambda: recorder.get_clock().now().nanoseconds == round(seconds * 1e9))
        for name, value in (('reference', 1.0), ('measurement', 0.0), ('command', 2.0)):
            heard = losses[name].newest
            send[name](value)
            probe.wait_until(lambda: losses[name].newest > heard)  # noqa: B023

    for k in range(40):
        go_to(1000.0 + 0.5 * k)
    for k in range(40):
        go_to(3.0 + 0.5 * k)
    folder = recorder.folder.path
    assert probe.trigger('recorder/reset').success
    rows, found = read_samples(folder), summarise(folder)
    assert list(rows)[-1] == 'level_2'  # stamps would be those of another clock
    assert len(rows['time']) == 80
    steps = [b - a for a, b in pairwise(rows['time'])]
    assert steps[39] == pytest.approx(0.0, abs=1e-6)
    assert min(steps) > 0.0 and [*steps[:39], *steps[40:]] == pytest.approx([0.5] * 78)
    assert found['metrics']['iae'] == pytest.approx(39.5, abs=0.1)
    assert found['rate'] == pytest.approx(2.0)
