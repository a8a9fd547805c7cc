"""The recorder: a folder per run, rows as they come, and what is left when it ends badly."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate, pairwise
import json
from math import isnan, nan
from pathlib import Path
import resource
import signal
import time
from typing import Any

from nadrc_ros.nodes.diagnostics import OK, WARN
from nadrc_ros.nodes.plant import LONGEST_STALL, PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.records.recording import (
    read_samples,
    RunFolder,
    RunSettings,
    SAMPLES,
    STAMPS,
    SUMMARY,
)
from probe import Probe, Processes
import pytest
from rclpy.qos import qos_profile_sensor_data, ReliabilityPolicy
from std_msgs.msg import Float64

RATE = 100.0
# Of a feed: so slow that samples as they come never look like missed periods.
SLOW = 1.0
INPUTS = 'reference measurement command output'
TOPICS = ('reference', 'measurement', 'command', 'plant/output')


class Feed:
    """Publishes what a loop would, sample by sample, to a recorder beside the probe."""

    def __init__(self, make: Callable[..., Probe], directory: Path, **settings: Any) -> None:
        values = {'rate': SLOW, 'inputs': INPUTS, 'directory': str(directory), **settings}
        self.probe = make(parameters={'recorder': values})
        self.recorder = self.probe.add(RecorderNode())
        self.send = {topic: self.probe.publisher(topic) for topic in TOPICS}
        self.probe.wait_until(lambda: all(self.probe.readers(topic) for topic in TOPICS))
        self.k = 0

    def sample(self) -> None:
        """Send the next sample; the row before is then complete."""
        k = self.k = self.k + 1
        values = {'reference': 1.0, 'measurement': 0.1 * k, 'command': 0.01 * k}
        values['plant/output'] = 0.1 * k + 0.5
        for topic, value in values.items():
            self.send[topic](value)
        losses = self.recorder._losses
        self.probe.wait_until(lambda: losses['output'].newest == k)
        self.probe.wait_until(lambda: all(heard.newest for heard in losses.values()))

    def rows(self) -> dict[str, list[float]]:
        self.recorder.folder.flush()
        return read_samples(self.recorder.folder.path)


def test_a_row_is_one_period_with_the_command_that_acted_in_it(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    for _ in range(6):
        feed.sample()
    rows = feed.rows()
    assert list(rows) == ['time', *INPUTS.split(), *STAMPS]
    assert rows['time'] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert rows['measurement'] == [0.1 * k for k in range(1, 6)]
    assert rows['command'] == [0.01 * k for k in range(1, 6)]
    assert rows['output'] == [0.1 * k + 0.5 for k in range(1, 6)]


def test_rows_are_in_the_file_while_the_run_goes_on(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    for _ in range(3):
        feed.sample()
    folder = feed.recorder.folder.path
    feed.probe.wait_until(lambda: read_samples(folder)['time'] == [0.0, 1.0])


def test_time_begins_at_the_first_command_even_when_that_came_before_any_measurement(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.send['command'](0.0)
    feed.probe.wait_until(lambda: feed.recorder._started)
    for _ in range(3):
        feed.sample()
    assert feed.rows()['time'] == [0.0, 1.0]
    # what never came is left empty
    first = (feed.recorder.folder.path / SAMPLES).read_text().splitlines()[1]
    assert first.startswith('0.0,1.0,0.1,')


def test_an_unknown_value_is_an_empty_column(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    for _ in range(2):
        feed.send['measurement'](3.0)
        feed.send['command'](nan)
        feed.probe.wait_until(lambda: feed.recorder._started)
    feed.probe.wait_until(lambda: feed.recorder._rows == 1)
    rows = feed.rows()
    assert rows['measurement'] == [3.0]
    assert all(isnan(rows[name][0]) for name in ('reference', 'command', 'output'))
    line = (feed.recorder.folder.path / SAMPLES).read_text().splitlines()[1]
    assert line.startswith('0.0,,3.0,,,')
    assert feed.recorder.metrics.values().skipped == 1


def test_a_lost_measurement_leaves_a_gap_and_is_counted(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.sample()
    feed.sample()
    feed.recorder._losses['measurement']._last = [1]  # as if number 2 had not come ...
    feed.recorder._losses['command']._last = [0]
    feed.sample()
    assert feed.recorder.lost == {'reference': 0, 'measurement': 1, 'command': 2, 'output': 0}
    assert feed.recorder._report()[0] == WARN
    assert feed.probe.trigger('recorder/save').success
    summary = json.loads((feed.recorder.folder.path / SUMMARY).read_text())
    assert summary['samples_lost'] == 3
    assert summary['samples_lost_by_signal'] == {'measurement': 1, 'command': 2}
    assert not summary['complete']
    feed.probe.trigger('recorder/reset')
    assert sum(feed.recorder.lost.values()) == 0


def test_what_hears_nothing_warns(make_probe: Callable[..., Probe], tmp_path: Path) -> None:
    feed = Feed(make_probe, tmp_path)

    def told() -> tuple[bytes, str]:
        reports = feed.probe.said('recorder')
        return reports[-1][:2] if reports else (b'', '')

    feed.probe.wait_until(lambda: told() == (WARN, 'waiting for measurement and command'))
    feed.sample()
    feed.probe.wait_until(lambda: told() == (OK, 'recording'))


def test_measurements_of_another_rate_are_told(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)  # of one a second
    for _ in range(30):
        feed.sample()
    level, message, values = feed.recorder._report()
    assert level == WARN
    assert message.endswith('Hz and the rate is 1 Hz: the figures of this run are wrong')
    assert values['measured_rate'] > 2.0


def test_a_best_effort_publisher_is_told_and_heard_when_asked_for(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    topic = f'{start.namespace}/measurement'
    name = f'qos_overrides.{topic}.subscription.reliability'
    values: dict[str, Any] = {'inputs': INPUTS, 'directory': str(tmp_path)}
    sensor = probe.node.create_publisher(Float64, 'measurement', qos_profile_sensor_data)
    command = probe.publisher('command')
    deaf = start('recorder', **values)
    told = f'waiting for measurement and command: {topic} is published as best effort'
    probe.wait_until(lambda: any(said[1].startswith(told) for said in probe.said('recorder')))
    assert f'start with {name} best_effort' in probe.said('recorder')[-1][1]
    deaf.signal(signal.SIGINT)
    assert probe.end_of(deaf) == 0
    start('recorder', **values | {name: 'best_effort'})

    def recorded() -> bool:
        sensor.publish(Float64(data=1.0))
        command(2.0)
        return int(probe.said('recorder')[-1][2]['rows']) > 0

    probe.wait_until(recorded)
    (reader,) = probe.node.get_subscriptions_info_by_topic(f'{start.namespace}/command')
    assert reader.qos_profile.reliability == ReliabilityPolicy.RELIABLE


def test_without_publication_numbers_losses_are_unknown(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.sample()
    assert feed.recorder._report()[2]['samples_lost'] == 0
    stamps = {'source_timestamp': 0, 'received_timestamp': 0}
    feed.recorder._taker('output')(1.0, {**stamps, 'publication_sequence_number': None})
    assert feed.recorder._report()[2]['samples_lost'] == 'unknown'
    assert feed.recorder._summary()['samples_lost'] is None
    assert feed.recorder._summary()['samples_lost_by_signal'] is None


def test_periods_that_the_plant_missed_leave_a_gap_and_are_no_loss(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    plant = {'rate': RATE, 'plant': 'chain', 'order': 1, 'damping': 0.0, 'command_timeout': 0.0}
    recorder = {'rate': RATE, 'directory': str(tmp_path)}
    probe = make_probe(parameters={'recorder': recorder, 'plant': plant})
    node, command = probe.add(RecorderNode()), probe.publisher('command')
    probe.add(PlantNode())
    probe.wait_until(lambda: len(probe.readers('command')) == 2)
    command(1.0)
    probe.wait_until(lambda: node._rows > 5)
    rows = node._rows
    time.sleep(0.255)  # a stall
    probe.wait_until(lambda: node._rows > rows + 20)
    node.folder.flush()
    samples = read_samples(node.folder.path)
    periods = [round(t * RATE) for t in samples['time']]
    gaps = [b - a for a, b in pairwise(periods)]
    assert max(gaps) >= 20
    # y' = u = 1: the output tells the time of the plant
    passed = accumulate((min(gap, LONGEST_STALL * RATE) for gap in gaps), initial=0)
    late = [y * RATE - k for k, y in zip(passed, samples['output'])]
    assert max(late) - min(late) <= 2.0
    assert sum(node.lost.values()) == 0


def test_a_restarted_plant_goes_on_in_time(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    for _ in range(3):
        feed.sample()
    old = feed.send['measurement']
    feed.send['measurement'] = feed.probe.publisher('measurement')  # its numbers begin anew
    for _ in range(3):
        feed.sample()
    assert old is not feed.send['measurement']
    assert feed.rows()['time'] == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])
    assert sum(feed.recorder.lost.values()) == 0


def test_a_second_publisher_is_no_loss_and_shifts_no_time(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    intruder = feed.probe.publisher('measurement')
    for _ in range(20):
        feed.sample()
    intruder(7.0)
    feed.probe.wait_until(lambda: feed.recorder._losses['measurement'].newest == 1)
    feed.sample()
    intruder(8.0)
    feed.probe.wait_until(lambda: feed.recorder._losses['measurement'].newest == 2)
    feed.sample()
    assert feed.recorder.lost['measurement'] == 0
    assert feed.rows()['time'] == [k / SLOW for k in range(23)]


def test_reset_opens_a_new_run_and_touches_no_old_one(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path / 'runs')
    itae = feed.probe.listen('recorder/itae')
    for _ in range(4):
        feed.sample()
    feed.probe.wait_until(lambda: itae and itae[-1] > 0.0)
    first = feed.recorder.folder.path
    kept = (first / SAMPLES).read_bytes()
    answer = feed.probe.trigger('recorder/reset')
    assert answer.success
    second = feed.recorder.folder.path
    assert str(second) in answer.message
    assert second != first
    summary = json.loads((first / SUMMARY).read_text())
    assert summary['complete']
    assert summary['rows'] == 4
    feed.sample()
    feed.sample()
    assert feed.rows()['time'] == [0.0]
    assert (first / SAMPLES).read_bytes()[: len(kept)] == kept
    assert len(read_samples(first)['time']) == 4
    assert feed.recorder.metrics.values().samples == 1


def test_a_run_ends_after_its_duration(make_probe: Callable[..., Probe], tmp_path: Path) -> None:
    feed = Feed(make_probe, tmp_path, duration=5.0)
    for _ in range(10):
        feed.sample()
    summary = json.loads((feed.recorder.folder.path / SUMMARY).read_text())
    assert summary['rows'] == summary['periods'] == 5
    assert summary['complete']
    assert read_samples(feed.recorder.folder.path)['time'] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert not feed.recorder.finished


def test_a_reset_that_cannot_open_a_run_is_answered(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path / 'runs')
    feed.recorder.settings = type(feed.recorder.settings)(directory=str(Path('/proc/runs')))
    answer = feed.probe.trigger('recorder/reset')
    assert not answer.success
    assert 'cannot write' in answer.message
    feed.send['measurement'](1.0)
    feed.probe.spin(0.3)
    assert not feed.recorder.recording


def test_folders_of_one_second_do_not_meet(tmp_path: Path) -> None:
    folders = [RunFolder(tmp_path, ['time'], RunSettings()) for _ in range(5)]
    assert len({folder.path for folder in folders}) == 5
    for folder in folders:
        folder.close()


def loop(start: Processes, **settings: Any) -> tuple[Any, Path]:
    """Run plant, controller and recorder as processes; return the recorder and its runs."""
    directory = start.directory / 'runs'
    start('plant', rate=RATE, plant='chain', order=1)
    recorder = start('recorder', rate=RATE, directory=str(directory), **settings)
    start('controller', rate=RATE, plant_order=1)
    return recorder, directory


def wait_for_rows(probe: Probe, directory: Path, count: int) -> Path:
    def found() -> Path | None:
        folders = list(directory.glob('*'))
        if folders and (folders[0] / SAMPLES).exists():
            lines = (folders[0] / SAMPLES).read_bytes().count(b'\n')
            return folders[0] if lines > count else None
        return None

    folder: Path = probe.wait_until(found)
    return folder


def test_interrupted_it_leaves_a_summary(probe: Probe, start: Processes) -> None:
    recorder, directory = loop(start)
    folder = wait_for_rows(probe, directory, 20)
    recorder.signal(signal.SIGINT)
    assert recorder.end() == 0
    summary = json.loads((folder / SUMMARY).read_text())
    assert summary['complete']
    assert summary['rows'] == len(read_samples(folder)['time'])
    assert summary['metrics']['samples'] + summary['metrics']['skipped'] == summary['rows']
    assert not list(folder.glob('*.part'))


def test_a_full_disk_is_reported_and_ends_only_the_recorder(
    probe: Probe, start: Processes
) -> None:
    recorder, directory = loop(start)
    folder = wait_for_rows(probe, directory, 20)
    size = (folder / SAMPLES).stat().st_size + 500
    resource.prlimit(recorder.popen.pid, resource.RLIMIT_FSIZE, (size, size))
    assert recorder.end() == 1
    assert 'cannot write: File too large' in recorder.said
    assert recorder.said.count('cannot write') == 1
    assert 'Traceback' not in recorder.said
    assert len(read_samples(folder)['time']) >= 20
    commands = probe.listen('command')
    probe.wait_until(lambda: len(commands) > 5)
