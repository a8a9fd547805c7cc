"""The tour of the first tutorial, taken literally, with and without the command `ros2`."""

from __future__ import annotations

from importlib import util
import os
from pathlib import Path
import re
import shlex
import subprocess
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from probe import Probe, Processes, ROOT
import pytest
from rcl_interfaces.msg import ParameterDescriptor
from std_msgs.msg import Float64
import yaml

PAUSE = 0.7
TYPES: dict[str, Any] = {'/diagnostics': DiagnosticArray}


def lines_of_the_tour() -> list[str]:
    """Return the lines of the code blocks up to where the same is done without `ros2`."""
    text = (ROOT / 'docs' / 'tutorial_laptop.md').read_text(encoding='utf-8')
    section = text.split('## With the `ros2` command')[1].split('Without `ros2`')[0]
    blocks = re.findall(r'```bash\n(.*?)```', section, re.DOTALL)
    return [line for block in blocks for line in block.splitlines()]


def follow(probe: Probe, words: list[str]) -> None:
    """Do what a line of `ros2 param`, `topic` or `service` does."""
    kind, verb, *rest = words
    if (kind, verb) == ('topic', 'echo'):
        heard: list[Any] = []
        probe.node.create_subscription(TYPES.get(rest[0], Float64), rest[0], heard.append, 10)
        probe.wait_until(lambda: heard)
    elif (kind, verb) == ('param', 'describe'):
        (found,) = probe.descriptors(rest[0], rest[1:])
        assert isinstance(found, ParameterDescriptor) and found.description
    elif (kind, verb) == ('param', 'set'):
        node, name, value = rest
        assert probe.set(node, **{name: yaml.safe_load(value)}) == ['']
    else:
        assert (kind, verb, rest[1]) == ('service', 'call', 'std_srvs/srv/SetBool')
        assert rest[0] == '/controller/enable'
        assert probe.enable(yaml.safe_load(rest[2])['data'], '/controller').success


def test_the_tour_taken_literally_ends_in_control_and_harms_no_plant(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    measured = probe.listen('/measurement')
    wanted = probe.listen('/reference')
    asked = [shlex.split(line)[1:] for line in lines_of_the_tour()]
    assert {line.split()[0] for line in lines_of_the_tour()} == {'ros2'}
    nodes = [words for words in asked if words[0] == 'run']
    assert [words[1] for words in nodes] == ['nadrc_ros'] * 4
    for _, _, node, *arguments in nodes:
        ros = arguments or ['--ros-args']
        more = ['-p', f'directory:={tmp_path}'] if node == 'recorder' else []
        start.run(node, '-m', f'nadrc_ros.nodes.{node}', *ros, *more)
    probe.wait_until(lambda: measured and wanted)
    for words in asked:
        if words[0] != 'run':
            follow(probe, words)
            probe.spin(PAUSE)
    probe.wait_until(lambda: abs(measured[-1] - wanted[-1]) < 0.1)
    assert max(map(abs, measured)) < 3.0
    assert probe.reports['/controller'][-1][1] == 'in control'


def test_the_tour_without_ros2_shows_the_same(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = util.spec_from_file_location('tour', ROOT / 'examples' / 'tour.py')
    assert spec is not None and spec.loader is not None
    tour = util.module_from_spec(spec)
    spec.loader.exec_module(tour)
    monkeypatch.setattr(tour, 'STEP', 0.9)
    tour.main()
    said = capfd.readouterr().out
    assert 'inner observer [rad/s]' in said and 'nothing measured' in said
    assert said.splitlines()[-1].startswith('ITAE ')
    errors = [float(x) for x in re.findall(r'largest error ([\d.]+)', said)]
    assert len(errors) == 8 and max(errors) < 2.0


def clean(**more: str) -> dict[str, str]:
    """Return the environment of a terminal in which nothing was sourced."""
    kept = {name: os.environ[name] for name in ('HOME', 'PATH', 'LANG') if name in os.environ}
    path = ':'.join(p for p in kept['PATH'].split(':') if '.venv' not in p and 'install' not in p)
    return {**kept, 'PATH': path, **more}


@pytest.mark.parametrize(
    'command',
    [f'{Path(sys.prefix).name}/bin/nadrc', 'source install/local_setup.bash; nadrc'],
    ids=['after make', 'sourced'],
)
def test_nadrc_is_found_where_the_pages_say(command: str) -> None:
    done = subprocess.run(
        ['bash', '-c', f'{command} --version'],
        cwd=ROOT,
        env=clean(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 and done.stdout.startswith('nadrc '), done.stderr
