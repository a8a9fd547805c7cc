"""What the recorder keeps besides the signals: when samples left, parameters, versions."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
import json
from math import isfinite
from pathlib import Path
import signal
import time
from typing import Any

from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.records.figures import summarise
from nadrc_ros.records.history import ABOUT, History, PARAMETERS, read_history
from nadrc_ros.records.read_run import read_runs
from nadrc_ros.records.recording import read_samples, SAMPLES, SUMMARY
from probe import Probe, Processes
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent, ParameterValue
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Float64

RATE = 100.0
BIG = 2**53 + 1


def the_run(directory: Path, number: int = -1) -> Path:
    return sorted(directory.glob('*'))[number]


def test_parameters_and_their_changes_survive_a_kill(probe: Probe, start: Processes) -> None:
    directory = start.directory / 'runs'
    start('plant', rate=RATE, plant='chain', order=1, seed=BIG)
    start('controller', rate=RATE, plant_order=1)
    recorder = start('recorder', rate=RATE, directory=str(directory))
    controller, plant = (f'{start.namespace}/{node}' for node in ('controller', 'plant'))

    def told() -> History | None:
        folders = list(directory.glob('*'))
        history = read_history(folders[0]) if folders else History()
        return history if {controller, plant} <= history.parameters.keys() else None

    history = probe.wait_until(told)
    assert history.parameters[plant]['seed'] == BIG
    assert history.parameters[controller]['inner_bandwidth'] == 40.0
    assert history.parameters[controller]['pole_ratios'] == [1.0]
    assert not history.changes
    probe.wait_until(lambda: (the_run(directory) / SAMPLES).read_bytes().count(b'\n') > 50)
    assert probe.set('controller', inner_bandwidth=61.5) == ['']
    assert probe.set('controller', inner_bandwidth=-1.0) != ['']
    assert probe.set('plant', disturbance='sine') == ['']
    probe.wait_until(lambda: len(read_history(the_run(directory)).changes) == 2)
    recorder.signal(signal.SIGKILL)
    recorder.end()
    first, second = read_history(the_run(directory)).changes
    found = (first.node, first.name, first.before, first.after)
    assert found == (controller, 'inner_bandwidth', 40.0, 61.5)
    assert (second.node, second.before, second.after) == (plant, 'none', 'sine')
    assert 0.4 < first.time <= second.time < read_samples(the_run(directory))['time'][-1] + 1.0


def test_a_controller_that_is_started_anew_is_asked_anew(probe: Probe, start: Processes) -> None:
    directory = start.directory / 'runs'
    start('recorder', rate=RATE, directory=str(directory))
    first = start('controller', rate=RATE, plant_order=1)
    name = f'{start.namespace}/controller'

    def known() -> dict[str, Any]:
        folders = list(directory.glob('*'))
        return read_history(folders[0]).parameters.get(name, {}) if folders else {}

    probe.wait_until(known)
    first.signal(signal.SIGINT)
    probe.end_of(first)
    start('controller', rate=RATE, plant_order=1, outer_bandwidth=7.5)
    probe.wait_until(lambda: known()['outer_bandwidth'] == 7.5)


def test_stamps_versions_and_parameters_go_into_every_run(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    directory = tmp_path / 'runs'
    values = {'inputs': 'reference measurement command', 'directory': str(directory)}
    probe = make_probe(parameters={'recorder': values})
    probe.node.declare_parameter('gain', 1.0)
    begin = time.time()
    recorder = probe.add(RecorderNode())
    source = f'{probe.namespace}/probe'
    mute = Node('mute', start_parameter_services=False)  # as a driver of another kind might be
    reference = mute.create_publisher(Float64, 'reference', 1)
    measure, command = probe.publisher('measurement'), probe.publisher('command')
    probe.wait_until(lambda: probe.readers('measurement') and probe.readers('command'))
    probe.wait_until(lambda: source in recorder._watch.known)
    probe.wait_until(lambda: f'{probe.namespace}/mute' in recorder._watch._sources)
    losses = recorder.intake.losses
    for k in range(5):
        measure(float(k))
        probe.wait_until(lambda: losses['measurement'].newest == k + 1)  # noqa: B023
        command(-float(k))
        probe.wait_until(lambda: losses['command'].newest == k + 1)  # noqa: B023
    probe.node.set_parameters([Parameter('gain', value=2.0)])
    probe.wait_until(lambda: recorder._watch.known[source]['gain'] == 2.0)
    assert probe.trigger('recorder/reset').success
    mute.destroy_publisher(reference)
    mute.destroy_node()
    probe.wait_until(
        lambda: [source] == list(recorder._watch._sources)
    )  # who is gone is forgotten

    first, second = the_run(directory, 0), the_run(directory, 1)
    rows = read_samples(first)
    assert rows['measurement'] == [0.0, 1.0, 2.0, 3.0, 4.0]
    about = json.loads((first / ABOUT).read_text())
    started = datetime.fromisoformat(about['started']).timestamp()
    assert begin - 1.0 <= started <= time.time()
    stamps = [t for pair in zip(rows['measurement_stamp'], rows['command_stamp']) for t in pair]
    assert stamps == sorted(set(stamps))
    assert begin <= started + stamps[0] and started + stamps[-1] <= time.time()
    assert about['namespace'] == probe.namespace
    assert about['versions']['python'].startswith('3.')

    history = read_history(first)
    assert history.parameters[source]['gain'] == 1.0
    assert [(c.name, c.before, c.after) for c in history.changes] == [('gain', 1.0, 2.0)]
    assert rows['time'][-1] <= history.changes[0].time < time.time() - begin
    assert read_history(second).parameters[source]['gain'] == 2.0
    assert not read_history(second).changes
    assert len((second / PARAMETERS).read_text().splitlines()) == 1


def test_without_limits_of_its_own_a_recorder_takes_those_that_the_controller_tells(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    """Live, in the summary, from the files: at a limit for two of four rows, then for nobody."""
    values = {'inputs': 'reference measurement command', 'directory': str(tmp_path)}
    probe = make_probe(parameters={'recorder': values})
    for name, value in (('structure', 'nested'), ('inner_bandwidth', 40.0)):
        probe.node.declare_parameter(name, value)
    for name, value in (('command_min', -2.0), ('command_max', 2.0)):
        probe.node.declare_parameter(name, value)
    recorder = probe.add(RecorderNode())
    live = probe.listen('recorder/saturated_fraction')
    refer, measure, command = (
        probe.publisher(topic) for topic in ('reference', 'measurement', 'command')
    )
    losses = recorder.intake.losses

    def period(u: float) -> None:
        for name, send in (('reference', refer), ('measurement', measure), ('command', command)):
            n = losses[name].newest or 0
            send(u if name == 'command' else 0.0)
            probe.wait_until(lambda: (losses[name].newest or 0) > n)  # noqa: B023

    source = f'{probe.namespace}/probe'
    probe.wait_until(lambda: source in recorder._watch.known)
    for u in (0.0, 2.0, -2.0, 1.0):
        period(u)
        probe.spin(0.1)
    probe.wait_until(lambda: live and isfinite(live[-1]) and recorder.figures.rows >= 3)
    assert recorder.figures.values().saturated_fraction == live[-1] > 0.3
    probe.node.set_parameters([Parameter('inner_bandwidth', value=30.0)])
    probe.wait_until(lambda: read_history(the_run(tmp_path, 0)).changes)
    assert recorder._history.changes == []  # or its memory would grow with every retune
    probe.node.set_parameters([Parameter('command_max', value=1.5)])
    probe.wait_until(lambda: recorder._watch.known[source]['command_max'] == 1.5)
    period(0.0)
    assert probe.trigger('recorder/reset').success
    period(1.5)
    probe.spin(0.1)
    period(-2.0)
    assert probe.trigger('recorder/reset').success

    for number, known in ((0, False), (1, True)):
        folder = the_run(tmp_path, number)
        recorded = json.loads((folder / SUMMARY).read_text())['metrics']
        assert recorded == summarise(folder)['metrics']
        ((_, subject),) = read_runs([folder]).items()
        assert subject.metrics.as_dict() == recorded
        assert recorded['saturated_fraction'] == (1.0 if known else None)


def test_p16_a_parameter_event_of_a_type_that_does_not_exist_ends_nothing(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    directory = tmp_path / 'runs'
    probe = make_probe(parameters={'recorder': {'directory': str(directory)}})
    probe.node.declare_parameter('gain', 1.0)
    recorder = probe.add(RecorderNode())
    events = probe.node.create_publisher(ParameterEvent, '/parameter_events', 10)
    probe.publisher('measurement')
    source = f'{probe.namespace}/probe'
    probe.wait_until(lambda: source in recorder._watch.known and events.get_subscription_count())
    odd = ParameterMessage(name='gain', value=ParameterValue(type=77))
    events.publish(ParameterEvent(node=source, changed_parameters=[odd]))
    probe.wait_until(lambda: recorder._watch.known[source]['gain'] is None)
    folder = the_run(directory)

    def told() -> dict[str, Any]:
        return read_history(folder).parameters.get(source, {})

    probe.wait_until(lambda: 'gain' in told() and told()['gain'] is None)
