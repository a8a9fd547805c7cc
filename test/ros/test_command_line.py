"""The command line of the executables, and the surroundings in which they have to start."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys

from probe import Processes, ROOT
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


@pytest.mark.parametrize('node', NODES)
def test_help_is_shown_and_nothing_is_started(node: str) -> None:
    told = run('-m', f'nadrc_ros.nodes.{node}', '--help')
    assert (told.returncode, told.stderr) == (0, '')
    assert f'ros2 run nadrc_ros {node} --ros-args -p' in told.stdout


@pytest.mark.parametrize('node', NODES)
@pytest.mark.parametrize(
    ('arguments', 'complaint'),
    [
        (('rate:=100.0',), 'rate:=100.0 has no -p or -r before it'),
        (('--ros-args', 'rate:=100.0'), 'rate:=100.0 has no -p or -r before it'),
        (('-o', 'x'), 'unrecognized arguments: -o x'),
        (('-p', 'rate:=100.0'), 'unrecognized arguments: -p rate:=100.0'),
        (('runs',), '--ros-args: `-p name:=value` is a parameter'),
    ],
)
def test_what_is_for_nobody_on_a_command_line_is_refused(
    node: str, arguments: tuple[str, ...], complaint: str
) -> None:
    told = run('-m', f'nadrc_ros.nodes.{node}', *arguments)
    assert told.returncode == 2
    assert complaint in told.stderr and 'Traceback' not in told.stderr


@pytest.mark.parametrize('node', NODES)
def test_without_ros_one_sentence_says_so(node: str) -> None:
    told = run('-c', WITHOUT.format('rclpy', node))
    assert told.returncode == 1
    assert told.stderr.startswith(f'the {node} needs ROS 2 Jazzy, which is not here')
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
