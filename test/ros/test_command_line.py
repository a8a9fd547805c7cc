"""The command line of the executables, and the surroundings in which they have to start."""

from __future__ import annotations

from importlib import import_module
import os
from pathlib import Path
import re
import shlex
import signal
import subprocess
import sys
from typing import Any

from nadrc_ros.ros import command_line
from nadrc_ros.ros.command_line import About, NodeParser
from probe import Probe, Processes, ROOT
import pytest

NODES = ('controller', 'plant', 'reference', 'recorder')
WITHOUT = """
import sys
sys.modules['{}'] = None
from nadrc_ros.nodes import executables
raise SystemExit(executables.{}())
"""


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run Python to its end."""
    return subprocess.run(
        [sys.executable, *arguments],
        check=False,
        capture_output=True,
        text=True,
        env=os.environ | {'PYTHONPATH': str(ROOT)} | environment,
    )


def help_of(node: str, width: int | None, monkeypatch: pytest.MonkeyPatch) -> str:
    module = import_module(f'nadrc_ros.nodes.{"axes" if node == "controller" else node}')
    about = module._ABOUT if node == 'controller' else module._about()
    monkeypatch.setattr(command_line, 'columns', lambda _: width)
    return NodeParser(node, about).format_help()


@pytest.mark.parametrize('node', NODES)
def test_help_has_purpose_topics_five_parameters_and_two_examples(
    node: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = help_of(node, None, monkeypatch)
    parts = dict(part.split(':\n') for part in told.split('\n\n') if ':\n' in part)
    assert {'command', 'reference', 'measurement'} & set(re.findall('[a-z]+', parts['topics']))
    assert ' '.join(parts['main parameters'].split()).count('(default ') == 5
    examples = parts['examples'].splitlines()
    assert len(examples) == 2
    for line in examples:
        words = shlex.split(line)
        assert words[:4] == ['ros2', 'run', 'nadrc_ros', node]
    for width in (60, 80, 120):
        narrow = help_of(node, width, monkeypatch)
        assert narrow.replace('\\\n', '').split() == told.split()
        assert all(len(line) <= width for line in narrow.splitlines())


@pytest.mark.parametrize('node', NODES)
def test_help_is_shown_and_nothing_is_started(node: str) -> None:
    told = run('-m', f'nadrc_ros.nodes.{node}', '--help', ROS_DOMAIN_ID='none')  # ROS takes none
    assert (told.returncode, told.stderr) == (0, '')
    assert told.stdout.startswith(f'usage: {node} ')


def test_help_into_a_closed_pipe_is_no_news() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, '-m', 'nadrc_ros.nodes.plant', '--help'],
        check=False,
        stdout=writing,
        stderr=subprocess.PIPE,
        env=os.environ | {'PYTHONPATH': str(ROOT)},
    )
    os.close(writing)
    assert done.stderr == b''


@pytest.mark.parametrize(
    ('arguments', 'complaint'),
    [
        (('rate:=100.0',), '{} --ros-args -p rate:=100.0'),
        (('--ros-args', 'rate:=100.0'), '{} --ros-args -p rate:=100.0'),
        (('-p', 'rate:=100.0'), 'come after --ros-args, each behind its -p or -r: {} --ros-args'),
        (('-r', 'command:=/u'), '{} --ros-args -r command:=/u'),
        (('-o', 'x'), 'no such option: -o x; '),
        (('--hlep',), 'no such option: --hlep; did you mean --help? {} --help says more'),
        (('runs',), 'no such option: runs'),
    ],
)
def test_what_is_for_nobody_on_a_command_line_is_refused(
    arguments: tuple[str, ...], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for node in NODES:
        about = About(purpose='', topics={}, parameters={}, examples=())
        with pytest.raises(SystemExit) as ended:
            NodeParser(node, about).parse([node, *arguments])
        assert ended.value.code == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith('error: ') and complaint.format(node) in line


@pytest.mark.parametrize('node', NODES)
def test_without_ros_one_sentence_says_so(node: str) -> None:
    told = run('-c', WITHOUT.format('rclpy', node))
    assert told.returncode == 1
    assert told.stderr.startswith(f'error: the {node} needs ROS 2 Jazzy or Kilted, which is')
    assert len(told.stderr.splitlines()) == 1


def test_where_a_part_of_this_package_is_missing_ros_is_not_blamed() -> None:
    told = run('-c', WITHOUT.format('nadrc_ros.simulation.plant_run', 'plant'))
    assert told.returncode == 1
    assert 'ROS 2 Jazzy' not in told.stderr and 'nadrc_ros.simulation.plant_run' in told.stderr


@pytest.mark.parametrize(
    ('surroundings', 'complaint'),
    [
        ({'HOME': ''}, 'there is no HOME: '),
        ({'HOME': '/proc'}, '/proc/.ros/log: '),
        ({'ROS_HOME': '/proc/me'}, '/proc/me/log: '),
        ({'ROS_LOG_DIR': '/proc/log'}, '/proc/log: '),
        ({'ROS_LOG_DIR': '~/log', 'HOME': ''}, 'there is no HOME: '),
    ],
)
def test_a_node_starts_where_no_log_file_can_be_written(
    surroundings: dict[str, str],
    complaint: str,
    start: Processes,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv('ROS_LOG_DIR')
    for name, value in surroundings.items():
        monkeypatch.setenv(name, value)
    process = start('reference', rate=-1.0)  # it gets as far as that
    assert process.end() == 1
    warning, refusal = process.own_lines
    assert complaint in warning and 'unless ROS_LOG_DIR names a folder' in warning
    assert 'rate' in refusal


def test_a_node_that_can_write_its_log_says_nothing_of_it(
    start: Processes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'new' / 'log'))
    assert start('reference', rate=-1.0).end() == 1
    assert list((tmp_path / 'new' / 'log').iterdir())


@pytest.mark.parametrize(
    ('node', 'begin', 'end'),
    [
        ('plant', 'chain at 50 Hz, no noise, disturbance none; held until ', ' s have passed, 0'),
        ('reference', 'cosine at 50 Hz; r(0) until ', ' s of the signal were sent'),
        ('recorder', 'recording to ', 'no row was recorded'),
    ],
)
def test_a_node_says_in_one_line_what_it_does_and_what_it_did(
    node: str, begin: str, end: str, probe: Probe, start: Processes
) -> None:
    own = {'plant': {'plant': 'chain'}, 'recorder': {'directory': str(start.directory)}}
    parameters: dict[str, Any] = {'rate': 50.0, **own.get(node, {})}
    process = start(node, **parameters)
    probe.wait_until(lambda: begin in process.said)
    process.signal(signal.SIGINT)
    assert probe.end_of(process) == 0
    assert len(process.own_lines) == 2 and end in process.own_lines[-1], process.said
