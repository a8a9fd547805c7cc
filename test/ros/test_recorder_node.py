"""The recorder: a folder per run, rows as they come, and what is left when it ends badly."""

from __future__ import annotations

from collections.abc import Callable
import json
from pathlib import Path
import resource
import signal
import subprocess
import sys
from typing import Any

from feed import Feed, INPUTS, PERIOD
from nadrc_ros.records.figures import summarise
from nadrc_ros.records.history import read_history
from nadrc_ros.records.read_run import read_runs
from nadrc_ros.records.recording import read_samples, RunFolder, RunSettings, SAMPLES, SUMMARY
from nadrc_ros.report.summary import summary_of
from nadrc_ros.ros.diagnostics import OK, WARN
from nadrc_ros.ros.stamps import Losses
from probe import Probe, Processes
import pytest
from rclpy.qos import qos_profile_sensor_data, ReliabilityPolicy
from std_msgs.msg import Float64

RATE = 100.0


def test_rows_are_in_the_file_while_the_run_goes_on(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    folder = feed.recorder.folder.path
    for _ in range(100):
        feed.sample()
        if len(read_samples(folder)['time']) > 1:
            break
    assert feed.k < 1.0 / PERIOD + 10  # of a killed recorder the last second is lost, no more


def test_a_lost_measurement_leaves_a_gap_and_is_counted(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.samples(2)
    losses = feed.intake.losses
    losses['measurement']._last = [losses['measurement'].newest - 1]  # as if one had not come
    losses['command']._last = [losses['command'].newest - 2]
    feed.sample()
    lost = feed.intake.lost
    assert lost == {'reference': 0, 'measurement': 1, 'command': 2, 'output': 0}
    assert feed.recorder.report()[0] == WARN
    assert feed.probe.trigger('recorder/save').success
    summary = json.loads((feed.recorder.folder.path / SUMMARY).read_text())
    assert summary['samples_lost'] == 3
    assert summary['samples_lost_by_signal'] == {'measurement': 1, 'command': 2}
    assert not summary['complete']
    feed.probe.trigger('recorder/reset')
    assert sum(feed.intake.lost.values()) == 0


def test_commands_that_were_sent_before_a_late_recorder_are_counted(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.samples(2)
    assert feed.recorder._summary()['commands_before'] == 0  # the run was begun anew
    sent = feed.intake.losses['command'].newest
    feed.intake.losses['command'] = Losses()  # as if it had just been started
    feed.probe.trigger('recorder/reset')
    folder = feed.recorder.folder.path
    feed.samples(5)
    feed.probe.trigger('recorder/reset')
    assert json.loads((folder / SUMMARY).read_text())['commands_before'] == sent
    said = f'{sent} commands were sent before the first'
    (event,) = read_history(folder).events
    assert event.kind == 'late' and event.time == pytest.approx(0.0, abs=0.1)
    assert event.message.startswith(said)
    runs = read_runs([folder])
    assert f'The run begins late: {said}' in summary_of(runs, [])


def test_what_hears_nothing_warns(make_probe: Callable[..., Probe], tmp_path: Path) -> None:
    feed = Feed(make_probe, tmp_path)

    def told() -> tuple[bytes, str]:
        reports = feed.probe.said('recorder')
        return reports[-1][:2] if reports else (b'', '')

    feed.probe.wait_until(lambda: told() == (WARN, 'waiting for measurement and command'))
    feed.sample()
    feed.probe.wait_until(lambda: told() == (OK, 'recording'))


def test_a_best_effort_publisher_is_told_and_heard_when_asked_for(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    topic = f'{start.namespace}/measurement'
    name = f'qos_overrides.{topic}.subscription.reliability'
    values: dict[str, Any] = {'inputs': INPUTS, 'directory': str(tmp_path)}
    sensor = probe.node.create_publisher(Float64, 'measurement', qos_profile_sensor_data)
    command = probe.publisher('command')
    deaf = start('recorder', **values)
    told = f'as best effort, heard only with -p {name}:=best_effort'
    probe.wait_until(lambda: any(told in said[1] for said in probe.said('recorder')))
    assert f'nothing comes on {topic}: ' in deaf.said and told in deaf.said
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
    assert feed.recorder.report()[2]['samples_lost'] == 0
    stamps = {'source_timestamp': 0, 'received_timestamp': 0}
    feed.intake.take('output', 1.0, {**stamps, 'publication_sequence_number': None})
    assert feed.recorder.report()[2]['samples_lost'] == 'unknown'
    assert feed.recorder._summary()['samples_lost'] is None
    assert feed.recorder._summary()['samples_lost_by_signal'] is None


def test_a_jump_of_a_publishers_clock_is_told(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path)
    feed.samples(5)
    assert feed.recorder.report()[2]['clock_jumps'] == 0
    stamp = feed.recorder.get_clock().now().nanoseconds - 3600 * 10**9
    number = feed.intake.losses['output'].newest + 1
    info = {'source_timestamp': stamp, 'received_timestamp': stamp}
    feed.intake.take('output', 0.5, {**info, 'publication_sequence_number': number})
    assert feed.recorder.report()[2]['clock_jumps'] == 1
    folder = feed.recorder.folder.path
    assert feed.summary()['rows'] == 5
    (event,) = read_history(folder).events
    assert event.kind == 'clock_jump'
    assert event.message == 'the clock that stamps output jumped'
    assert 0.0 < (event.time or 0.0) < 1.0
    assert feed.recorder.report()[2]['clock_jumps'] == 0


def test_reset_opens_a_new_run_and_touches_no_old_one(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path / 'runs')
    itae = feed.probe.listen('recorder/itae')
    feed.samples(4)
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
    feed.samples(2)
    assert feed.rows(1)['time'] == [0.0]
    assert (first / SAMPLES).read_bytes()[: len(kept)] == kept
    assert len(read_samples(first)['time']) == 4
    assert feed.summary()['rows'] == 2


def test_a_run_ends_after_its_duration(make_probe: Callable[..., Probe], tmp_path: Path) -> None:
    feed = Feed(make_probe, tmp_path, duration=0.5)
    while feed.recorder.recording:
        feed.sample()
    folder = feed.recorder.folder.path
    summary = json.loads((folder / SUMMARY).read_text())
    rows = read_samples(folder)
    assert summary['rows'] == len(rows['time']) <= 25
    assert summary['complete']
    assert 0.4 < rows['time'][-1] < 0.5
    assert summary['metrics']['peak_error'] is not None  # from a tenth of the duration on
    assert not feed.recorder.finished


@pytest.mark.parametrize('truth', [True, False])
def test_a_run_ends_after_its_duration_though_the_sensor_is_dead(
    make_probe: Callable[..., Probe], tmp_path: Path, truth: bool
) -> None:
    """And what comes after its end, or is lost there, is not of this run."""
    feed = Feed(make_probe, tmp_path, duration=2.0)
    if not truth:
        feed.send['plant/output'] = lambda _: None
    feed.samples(30)
    losses, tell = feed.intake.losses['command'], feed.recorder._on_event
    ends = feed.recorder.get_clock().now().nanoseconds * 1e-9 + 2.0
    while feed.recorder.recording:
        feed.sample(silent=True)
        stamp = feed.recorder.get_clock().now().nanoseconds
        tell(
            '/someone',
            'said',
            'something',
            {'source_timestamp': stamp, 'publication_sequence_number': None},
        )
        if stamp * 1e-9 > ends:
            losses._last = [losses.newest - 5]  # as if five had not come
    folder = feed.recorder.folder.path
    found = json.loads((folder / SUMMARY).read_text())
    assert (found['complete'], found['stop'], found['samples_lost']) == (True, 2.0, 0)
    events = read_history(folder).events
    (gap,) = [event for event in events if event.kind == 'gap']
    lasted = 2.0 - (gap.time or 0.0)
    assert gap.message == f'no measurement for {lasted:.4g} s: nothing was sent'
    assert len(events) > 5 and all((event.time or 0.0) <= 2.0 for event in events)
    summed = summarise(folder)
    same = ('metrics', 'rows', 'periods', 'rate', 'gap_time', 'stop')
    assert {key: summed[key] for key in same} == {key: found[key] for key in same}
    (subject,) = read_runs([folder]).values()
    assert subject.gap_time == found['gap_time']
    assert subject.gaps > 40
    assert (found['gap_time'] > 1.0) != truth
    assert found['gap_time'] + found['metrics']['duration'] == pytest.approx(2.0, abs=0.1)


def test_a_reset_that_cannot_open_a_run_is_answered(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    feed = Feed(make_probe, tmp_path / 'runs')
    feed.recorder.settings = type(feed.recorder.settings)(directory=str(Path('/proc/runs')))
    answer = feed.probe.trigger('recorder/reset')
    assert not answer.success
    assert answer.message.startswith("directory = '/proc/runs': must be a folder")
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
    assert f'{summary["stop"]:.4g} s are recorded' in recorder.said


def test_a_run_without_a_row_has_no_figures_and_is_told(probe: Probe, start: Processes) -> None:
    directory = start.directory / 'runs'
    recorder = start('recorder', directory=str(directory))
    (folder,) = probe.wait_until(lambda: list(directory.glob('*/')))
    probe.wait_until(lambda: 'recording to' in recorder.said)
    recorder.signal(signal.SIGINT)
    assert recorder.end() == 0
    found = json.loads((folder / SUMMARY).read_text())
    assert found['rows'] == 0 and found['metrics']['itae'] is None is found['metrics']['rmse']
    assert 'no row was recorded: nothing came of reference, measurement, command' in recorder.said


@pytest.mark.parametrize('room', [0, 150, 200])
def test_a_recorder_that_finds_the_disk_full_leaves_no_folder(room: int, tmp_path: Path) -> None:
    code = (
        'import resource, signal, sys; from nadrc_ros.nodes.recorder import main; '
        'signal.signal(signal.SIGXFSZ, signal.SIG_IGN); '
        f'resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room})); sys.exit(main())'
    )
    arguments = ['--ros-args', '-p', f'directory:={tmp_path}', '--disable-external-lib-logs']
    done = subprocess.run(
        [sys.executable, '-c', code, *arguments],
        capture_output=True,
        text=True,
        timeout=20.0,
        check=False,
    )
    assert done.returncode == 1 and 'cannot start: ' in done.stderr
    assert 'File too large' in done.stderr
    assert not list(tmp_path.iterdir())


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
