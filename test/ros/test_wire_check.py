"""`nadrc fields` and `nadrc wire --check` against a running graph."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import subprocess
import sys
import threading
from typing import Any

from nadrc_ros.parameter_file import in_force
from nadrc_ros.ros.wire_check import check_wiring, fields_now
from probe import parameter_file, Probe
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from wired import joints, listen

STATES = 'sensor_msgs/msg/JointState'


@pytest.fixture
def arm(probe: Probe) -> Iterator[Probe]:
    """Publish two joints, and take an array, while the test is busy with something else."""
    publisher = probe.node.create_publisher(JointState, 'joints', 10)
    listen(probe, Float64MultiArray, 'efforts')

    def send() -> None:
        now = probe.node.get_clock().now().nanoseconds
        publisher.publish(joints(now, shoulder=1.0, elbow=2.0))

    probe.node.create_timer(0.02, send)
    with spinning(probe):
        yield probe


def nadrc(*arguments: str) -> tuple[int, str]:
    """Run a command; return its exit code and all that it printed."""
    done = subprocess.run(
        [sys.executable, '-m', 'nadrc_ros.cli', *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


@contextmanager
def spinning(probe: Probe) -> Iterator[None]:
    over = threading.Event()

    def spin() -> None:
        while not over.is_set():
            probe.spin(0.05)

    thread = threading.Thread(target=spin)
    thread.start()
    yield
    over.set()
    thread.join()


def test_every_number_of_a_live_topic_is_listed_as_an_address(arm: Probe) -> None:
    kind, numbers = fields_now(f'{arm.namespace}/joints', 10.0)
    assert kind == STATES
    assert dict(numbers)['position[name=elbow]'] == 2.0
    code, said = nadrc('fields', f'{arm.namespace}/joints')
    assert code == 0, said
    line = f'{arm.namespace}/joints {STATES} position[name=elbow]'
    assert [each.split()[:-1] for each in said.splitlines()].count(line.split()) == 1


def test_a_wiring_is_checked_against_the_graph(arm: Probe) -> None:
    found = {
        each.signal: each
        for each in check_wiring(
            {
                'wiring.measurement': 'joints position[name=elbow] * -1',
                'wiring.reference': 'joints position[name=elbo]',
                'wiring.reference_rate': f'{arm.namespace}/nothing data',
                'wiring.command': 'efforts std_msgs/Float64MultiArray data[1]',
            },
            arm.namespace,
            2.0,
        )
    }
    measurement, probe = found['measurement'], f'{arm.namespace}/probe'
    assert measurement.value == -2.0 and not measurement.wrong and measurement.who == [probe]
    assert 5.0 < measurement.rate < 60.0 and 0.0 < measurement.age < 1.0
    assert STATES in measurement.address
    assert found['reference'].wrong == 'elbo is not among shoulder, elbow'
    assert 'did you mean' in found['reference_rate'].wrong or 'published are' in (
        found['reference_rate'].wrong
    )
    assert found['command'].who == [probe] and found['command'].taken
    assert not found['command'].wrong


@pytest.mark.parametrize(
    ('measurement', 'code', 'said'),
    [
        ('joints position[name=elbow]', 0, 'Hz'),
        ('joints position[name=wrist]', 1, 'wrist is not among shoulder, elbow'),
        ('joints positions[0]', 1, 'did you mean position?'),
        ('joints position[', 1, 'is no field'),
    ],
)
def test_a_parameter_file_is_checked(
    arm: Probe, tmp_path: Path, measurement: str, code: int, said: str
) -> None:
    command = 'efforts std_msgs/Float64MultiArray data[1]'
    own: dict[str, Any] = {'wiring': {'command': command}}
    common: dict[str, Any] = {'rate': 50.0, 'wiring': {'measurement': measurement}}
    file = parameter_file(
        tmp_path / 'arm.yaml', {'/**/controller': common, f'{arm.namespace}/controller': own}
    )
    ended, output = nadrc('wire', '--check', str(file), '--seconds', '1')
    assert ended == code, output
    assert said in output and '/**' not in output


def test_a_file_that_no_controller_would_take_is_told_once(tmp_path: Path) -> None:
    wiring = {'wiring': {'measurment': '/x std_msgs/Float64 data'}}
    file = parameter_file(tmp_path / 'arm.yaml', {'/**/controller': wiring})
    code, said = nadrc('wire', '--check', str(file))
    assert code == 1 and f'error: {file}: wiring.measurment: there is no such key' in said
    code, said = nadrc('wire', '--check', 'no.yaml')
    assert (code, said) == (1, 'error: no.yaml: cannot be read: No such file or directory\n')


def test_a_topic_that_is_not_there_is_told_with_those_that_are(arm: Probe) -> None:
    code, said = nadrc('fields', f'{arm.namespace}/joint', '--wait', '5')
    assert code == 1
    assert f'did you mean {arm.namespace}/joints?' in said
    assert said.count('/joint:') == 1 and 'nadrc fields' not in said


def test_what_a_file_says_of_a_pattern_holds_for_the_nodes_that_it_means() -> None:
    parameters = {
        '/**/controller': {'rate': 50.0, 'b0': 1.0},
        '/x/controller': {'b0': 2.0},
        '/y/**': {'b0': 3.0},
    }
    assert in_force(parameters) == {
        '/x/controller': {'rate': 50.0, 'b0': 2.0},
        '/y/**': {'b0': 3.0},
    }
    assert in_force({'/**/controller': {'b0': 1.0}}) == {'/**/controller': {'b0': 1.0}}
