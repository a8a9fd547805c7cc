"""What happens to the nodes of a loop is told as it happens, and recorded with its own time."""

from __future__ import annotations

from collections.abc import Callable
import json
from pathlib import Path
from typing import Any

from files_helpers import recording
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.nodes.recorder_settings import DEFAULT_INPUTS
from nadrc_ros.records.figures import summarise
from nadrc_ros.records.history import Event, read_history
from nadrc_ros.records.recording import JOINED, read_samples, SUMMARY
from nadrc_ros.records.states import states
from probe import Probe
import pytest

RATE = 100.0
SILENT = 'fault.measurement.kind'


def running_loop(
    make: Callable[..., Probe], directory: Path, **controller: Any
) -> tuple[Probe, Any]:
    """Return a probe with a loop in its process, in control and recorded, and its recorder."""
    plant = {'rate': RATE, 'plant': 'chain', 'order': 1}
    control = {'rate': RATE, 'plant_order': 1, 'measurement_timeout': 0.1, **controller}
    recorder = {'directory': str(directory), 'inputs': ' '.join((*DEFAULT_INPUTS, *JOINED))}
    probe = make(parameters={'plant': plant, 'controller': control, 'recorder': recorder})
    node = probe.add(RecorderNode())
    probe.add(PlantNode())
    probe.add(ControllerNode())
    probe.publisher('reference')(1.0)
    probe.wait_until(lambda: node.figures.rows > 50)
    return probe, node


def cause(probe: Probe) -> str:
    """Return the cause in the last report of the controller."""
    return probe.said()[-1][2]['cause'] if probe.said() else ''


def test_every_change_of_state_is_an_event_with_its_time(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    probe, node = running_loop(make_probe, tmp_path)
    folder = node.folder.path
    assert probe.set('plant', **{SILENT: 'silent'}) == ['']
    probe.wait_until(
        lambda: probe.said() and probe.said()[-1][2]['cause'] == 'measurement_timeout'
    )
    rows = node.figures.rows
    probe.wait_until(lambda: node.figures.rows > rows + 50)  # a gap, whatever stalls there were
    assert probe.set('plant', **{SILENT: 'none'}) == ['']
    probe.wait_until(lambda: cause(probe) == 'none')
    assert probe.trigger('controller/reset').success
    assert probe.set('controller', outer_bandwidth=-3.0) != ['']
    assert probe.enable(False).success
    probe.wait_until(lambda: cause(probe) == 'disabled')
    assert probe.enable().message == 'enabled'
    assert probe.enable().message == 'already enabled'  # which is no event
    rows = node.figures.rows
    probe.wait_until(lambda: node.figures.rows > rows + 60)
    assert probe.trigger('recorder/reset').success
    standing = [e for e in read_history(node.folder.path).events if e.time is None]
    assert [e.message for e in standing if e.kind == 'mode'] == ['in control']

    history, end = read_history(folder), read_samples(folder)['time'][-1]
    known = [event for event in history.events if event.time is not None]
    assert all(0.0 <= event.time <= end for event in known if event.time is not None)
    kinds = [(event.node.rpartition('/')[2], event.kind) for event in in_order(known)]
    told = [(node, kind) for node, kind in kinds if kind != 'gap']
    for event in (('plant', 'fault'), ('controller', 'reset'), ('controller', 'refused')):
        assert event in told
    begin, over = (event.time for event in known if event.kind == 'fault')
    (gap,) = (event for event in known if event.kind == 'gap')
    assert begin is not None and over is not None and gap.time is not None
    # the last measurement came a period before the fault, and the loop held after the timeout
    assert gap.time == pytest.approx(begin, abs=0.1)
    held = next(e.time for e in known if e.kind == 'mode' and 'no valid measure' in e.message)
    assert held is not None and begin + 0.05 < held < over
    (refused,) = (event for event in known if event.kind == 'refused')
    assert 'outer_bandwidth' in refused.message and '-3.0' in refused.message
    said = [event.message for event in known if event.kind == 'enable']
    assert said == ['disabled', 'enabled']
    lasted = [each.state for each in states(history.events, 0.0, end)]
    assert lasted[0] == 'in control' and lasted[-1] == 'in control'
    assert 'holding' in lasted and {'ramping', 'off'} & set(lasted)
    changes = {change.after: change.time for change in history.changes if change.name == SILENT}
    assert changes['silent'] == pytest.approx(begin, abs=0.1)
    assert changes['none'] == pytest.approx(over, abs=0.1)
    assert recording(folder) == []  # all of it, and nothing else, is in docs/files.md


def in_order(events: list[Event]) -> list[Event]:
    return sorted(events, key=lambda event: event.time or 0.0)


def test_the_figures_of_a_run_with_a_silent_sensor_are_those_of_its_files(
    make_probe: Callable[..., Probe], tmp_path: Path
) -> None:
    probe, node = running_loop(make_probe, tmp_path)
    folder = node.folder.path
    assert probe.set('plant', **{SILENT: 'silent'}) == ['']
    rows = node.figures.rows
    probe.wait_until(lambda: node.figures.rows > rows + 40)
    assert probe.trigger('recorder/reset').success
    recorded, found = json.loads((folder / SUMMARY).read_text()), summarise(folder)
    assert {name: found[name] for name in ('metrics', 'rows', 'periods', 'rate', 'gap_time')} == {
        name: recorded[name] for name in ('metrics', 'rows', 'periods', 'rate', 'gap_time')
    }
    assert found['metrics']['samples'] == found['rows']
