"""What is required is enough: with none of the extras a simulation and a node run."""

from __future__ import annotations

import json
from pathlib import Path
import re
import signal
import subprocess
import sys

from probe import Probe, Processes, ROOT
import pytest

# Modules of the extras that have not the name of the package.
MODULES = {'dask[distributed]': 'dask', 'control': 'control', 'simple-pid': 'simple_pid'}
RUN = """
import sys

class Hide:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name.partition('.')[0] in {hidden!r}:
            raise ModuleNotFoundError(f'No module named {{name!r}}', name=name)

sys.meta_path.insert(0, Hide)
{then}
"""
SIMULATE = 'from nadrc_ros.cli.__main__ import main; raise SystemExit(main())'
NODE = 'from nadrc_ros.nodes.executables import controller; raise SystemExit(controller())'


def hidden() -> set[str]:
    """Return the modules of all extras but ROS."""
    about = (ROOT / 'setup.py').read_text(encoding='utf-8')
    required = re.search(r'install_requires=\[(.*?)\]', about, re.DOTALL)
    extras = re.search(r'extras_require=\{(.*?)^    \}', about, re.DOTALL | re.MULTILINE)
    lists = re.findall(r'^[A-Z]+ = \[(.*?)\]', about, re.DOTALL | re.MULTILINE)
    assert required is not None and extras is not None
    named = re.findall(r"'([a-zA-Z][\w\[\]-]*)[^']*'(?!:)", ' '.join([extras[1], *lists]))
    modules = {MODULES.get(name, name.replace('-', '_')) for name in named}
    return modules - set(re.findall(r"'(\w+)'", required[1]))


def test_the_extras_are_known() -> None:
    assert {'numba', 'bokeh', 'jinja2', 'optuna', 'cmaes', 'pymoo', 'dask', 'pyarrow'} <= hidden()
    assert {'rosbags', 'mujoco', 'sphinx', 'control', 'hypothesis'} <= hidden()
    assert not {'numpy', 'attrs', 'matplotlib', 'scipy'} & hidden()


def test_a_simulation_runs(tmp_path: Path) -> None:
    out = tmp_path / 'demo.json'
    code = RUN.format(hidden=hidden(), then=SIMULATE)
    arguments = ['simulate', 'demo', '--duration', '0.2', '--json', str(out)]
    plot = ['--plot', str(tmp_path / 'demo.svg')]
    command = [sys.executable, '-c', code, *arguments, *plot]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(out.read_text(encoding='utf-8')) and (tmp_path / 'demo.svg').exists()


def test_a_node_runs(probe: Probe, start: Processes) -> None:
    code = RUN.format(hidden=hidden(), then=NODE)
    space = f'__ns:={probe.namespace}'
    node = start.run('controller', '-c', code, '--ros-args', '-r', space)
    probe.wait_until(probe.said)
    node.signal(signal.SIGINT)
    assert probe.end_of(node) == 0


def test_what_is_hidden_is_missing() -> None:
    code = RUN.format(hidden=hidden(), then='import bokeh')
    with pytest.raises(subprocess.CalledProcessError):
        subprocess.run([sys.executable, '-c', code], capture_output=True, check=True)
