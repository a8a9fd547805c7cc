"""Signals that are fields of the messages in a bag."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
from pathlib import Path
from typing import Any

from bag_helpers import FLOAT64, START, STORE, write_bag
from bench.identify import record
from nadrc_ros.cli.app import app
from nadrc_ros.records.read_run import read_run
from nadrc_ros.records.recording import read_samples, RecordingError
from nadrc_ros.records.source import Source
from nadrc_ros.scenario.files import loads
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from test_identify import LAG
from typer.testing import CliRunner

STATES = 'sensor_msgs/msg/JointState'
EFFORTS = 'std_msgs/msg/Float64MultiArray'
ELBOW = {
    'measurement': '/joint_states position[name=elbow]',
    'command': f'/efforts {EFFORTS} data[1] * 2',
    'reference': '/joint_states effort[0] + 1',
}
Pairs = Mapping[str, Sequence[tuple[float, float]]]


def message(kind: str, **values: Any) -> bytes:
    types = STORE.types
    time = types['builtin_interfaces/msg/Time'](sec=3, nanosec=0)
    if kind == STATES:
        values['header'] = types['std_msgs/msg/Header'](stamp=time, frame_id='arm')
    else:
        values['layout'] = types['std_msgs/msg/MultiArrayLayout'](dim=[], data_offset=0)
    return bytes(STORE.serialize_cdr(types[kind](**values), kind))


def write_arm(path: Path, signals: Pairs) -> Path:
    """Write the numbers of a Float64 bag as those of an arm, with what else such a bag has."""
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        states = writer.add_connection('/joint_states', STATES, typestore=STORE)
        efforts = writer.add_connection('/efforts', EFFORTS, typestore=STORE)
        entries = []
        for k, ((t, y), (_, r)) in enumerate(zip(signals['/measurement'], signals['/reference'])):
            order = [['shoulder', 'elbow'], ['elbow', 'wrist', 'shoulder']][k // 50 % 2]
            values = {
                'name': order,
                'position': np.array([y if name == 'elbow' else 9.0 for name in order]),
                'velocity': np.array([np.nan] * len(order)),
                'effort': np.array([r - 1.0]),
            }
            entries.append((t, states, message(STATES, **values)))
        for t, u in signals['/command']:
            entries.append((t, efforts, message(EFFORTS, data=np.array([5.0, u / 2.0]))))
        for t, link, data in sorted(entries, key=lambda each: each[0]):
            writer.write(link, START + round(t * 1e9), data)
    return path


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a bag of Float64, and one with the same numbers in messages of an arm."""
    folder = tmp_path_factory.mktemp('bags')
    run = read_samples(record(loads(LAG), folder))
    signals = {
        f'/{name}': [(t + late, value) for t, value in zip(run['time'], run[name])]
        for name, late in (('measurement', 0.0), ('reference', 0.0), ('command', 0.001))
    }
    return write_bag(folder / 'plain', signals, mcap=True), write_arm(folder / 'arm', signals)


def test_a_bag_of_any_messages_is_the_same_log(bags: tuple[Path, Path]) -> None:
    plain, arm = (read_run(bag, Source(signals=named)) for bag, named in zip(bags, ({}, ELBOW)))
    assert plain.columns.keys() == arm.columns.keys()
    for name, column in plain.columns.items():
        np.testing.assert_array_equal(column, arm.columns[name])
    assert (plain.rate, plain.stop) == (arm.rate, arm.stop)


def test_identify_gives_exactly_what_it_gives_for_float64(
    bags: tuple[Path, Path], tmp_path: Path
) -> None:
    found = []
    for bag, named in zip(bags, ({}, ELBOW)):
        options = [f'--{name}={address}' for name, address in named.items()]
        out = tmp_path / f'{bag.name}.json'
        shown = CliRunner().invoke(app, ['identify', str(bag), *options, '--json', str(out)])
        assert shown.exit_code == 0, shown.output
        found.append(json.loads(out.read_text()))
    assert found[0] == found[1]
    assert found[0]['b0']['value'] > 0.0


@pytest.mark.parametrize(
    ('measurement', 'why'),
    [
        ('/joint_states position[name=elbo]', 'no message on /joint_states'),
        ('/joint_states positions[0]', 'did you mean position?'),
        ('/joint_states', 'not one number as std_msgs/Float64: name a field of it'),
        ('/joint_state position[0]', 'did you mean /joint_states?'),
        ('/joint_states sensor_msgs/Imu angular_velocity.z', f'has {STATES}, not sensor_msgs'),
        ('/joint_states position[0] / 2', 'is too much'),
    ],
)
def test_what_is_not_in_a_bag_is_told(bags: tuple[Path, Path], measurement: str, why: str) -> None:
    with pytest.raises(RecordingError) as caught:
        read_run(bags[1], Source(signals=ELBOW | {'measurement': measurement}))
    assert why in str(caught.value)


def test_the_numbers_of_a_bag_are_listed_as_addresses(bags: tuple[Path, Path]) -> None:
    shown = CliRunner().invoke(app, ['fields', str(bags[1])])
    assert shown.exit_code == 0, shown.output
    addresses = [line.rpartition(' ')[0].strip() for line in shown.output.splitlines()]
    assert f'/joint_states {STATES} position[name=elbow]' in addresses
    assert f'/efforts {EFFORTS} data[1]' in addresses
    one = CliRunner().invoke(app, ['fields', str(bags[1]), '/efforts']).output
    assert '/joint_states' not in one and '/efforts' in one
    wrong = CliRunner().invoke(app, ['fields', str(bags[1]), '/effort'])
    assert wrong.exit_code == 1 and 'did you mean /efforts?' in wrong.output
    assert FLOAT64 in CliRunner().invoke(app, ['fields', str(bags[0])]).output
