"""The documents: what they show works, and what is generated is up to date."""

from __future__ import annotations

from importlib import import_module
import os
from pathlib import Path
import re
import shlex
import subprocess
import sys
from typing import Any

from nadrc_ros.adrc.fields import Declared, declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.nodes.loop_settings import LoopSettings
from nadrc_ros.nodes.plant_settings import fault_fields, noise_fields
from nadrc_ros.ros.pacing import PacingSettings
from nadrc_ros.ros.signal_parameters import DISTURBANCE, NOISE_SIGNAL, REFERENCE
from nadrc_ros.ros.wiring_parameters import build_wiring, SIGNALS, wiring_fields
from nadrc_ros.scenario.mapping import from_mapping
from nadrc_ros.simulation.plants import PaperPlant
from nadrc_ros.tuning.design.limits import check
from nadrc_ros.tuning.design.requirements import Conflict, Requirements
import pytest
from test_layers import ARROWS
import yaml

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / 'README.md').read_text(encoding='utf-8')
SAFETY = (ROOT / 'docs' / 'safety.md').read_text(encoding='utf-8')
ARCHITECTURE = (ROOT / 'docs' / 'architecture.md').read_text(encoding='utf-8')
CHOOSING = (ROOT / 'docs' / 'choosing.md').read_text(encoding='utf-8')
ALL = [README, *(path.read_text(encoding='utf-8') for path in sorted(ROOT.glob('docs/*.md')))]
BLOCKS = [block for text in ALL for block in re.findall(r'```(\w+)\n(.*?)```', text, re.DOTALL)]
BASH = [
    line.split('  #')[0] for kind, text in BLOCKS if kind == 'bash' for line in text.splitlines()
]
# Those of `nadrc demo` and `commission` are run with the tests of the nodes.
NADRC = re.findall('^(nadrc (?!demo |commission ).*?)(?: +#.*)?$', README, re.MULTILINE)
# Of the plants the one of the paper, whose parameters are below.
NODES = [line for line in BASH if line.startswith('ros2 run ') and 'plant:=' not in line]
PARAMETERS: dict[str, dict[str, Declared]] = {
    'controller': {
        **declared(ControllerSettings),
        **declared(PacingSettings),
        **declared(LoopSettings),
        **wiring_fields(),
    },
    'plant': {
        **declared(PaperPlant),
        **DISTURBANCE.fields(),
        **NOISE_SIGNAL.fields(),
        **noise_fields(),
        **fault_fields(),
    },
    'reference': {
        **declared(import_module('nadrc_ros.nodes.reference').ReferenceSettings),
        **REFERENCE.fields(),
    },
    'recorder': {},
}


def test_the_python_examples_do_what_they_say(capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / 'docs' / 'api.md').read_text(encoding='utf-8')
    law, scenario = re.findall(r'```python\n(.*?)```', page, re.DOTALL)
    exec(law, {})
    assert capsys.readouterr().out == 'y = 1.000, estimated load -3.000\n'
    exec(scenario, {})
    assert capsys.readouterr().out == 'ITAE 0.81\n'


@pytest.mark.parametrize('command', NADRC)
def test_the_nadrc_commands_run(command: str, tmp_path: Path) -> None:
    words = [sys.executable, '-m', 'nadrc_ros.cli', *shlex.split(command)[1:]]
    done = subprocess.run(
        words,
        check=False,
        cwd=tmp_path,
        env={**os.environ, 'PYTHONPATH': f'{ROOT}:{os.environ.get("PYTHONPATH", "")}'},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert any(tmp_path.rglob('*.png')) and any(tmp_path.rglob('*.json'))


def test_the_commands_of_choosing_run_and_say_what_the_page_says(tmp_path: Path) -> None:
    (block,) = re.findall(r'```bash\n(.*?)```', CHOOSING, re.DOTALL)
    for line in block.splitlines():
        test_the_nadrc_commands_run(line, tmp_path)
    assert (tmp_path / 'mine' / 'run.png').exists()
    (message,) = re.findall(r'\*(settling_time = .*?)\*', CHOOSING, re.DOTALL)
    with pytest.raises(Conflict) as refused:
        check(Requirements(settling_time=0.01, rate=500.0))
    assert str(refused.value) == ' '.join(message.split())


def test_the_wirings_of_the_page_and_of_the_examples_lead_to_numbers() -> None:
    pytest.importorskip('sensor_msgs', reason='the build brings it')
    from nadrc_ros.ros.wires import members_of
    from nadrc_ros.wiring.address import parse_address
    from nadrc_ros.wiring.reader import Reader

    page = (ROOT / 'docs' / 'wiring.md').read_text(encoding='utf-8')
    texts = re.findall(r'```yaml\n(.*?)```', page, re.DOTALL)
    texts += [p.read_text(encoding='utf-8') for p in (ROOT / 'examples/mujoco').glob('*.yaml')]
    nodes = [node for text in texts for node in yaml.safe_load(text).values()]
    wired = [node['ros__parameters'].get('wiring', {}) for node in nodes]
    for values in wired:
        build_wiring({f'wiring.{name}': value for name, value in values.items()})
    addresses = [values[name] for values in wired for name in SIGNALS.values() if name in values]
    assert len(addresses) >= 10
    addresses += re.findall(r'^\| `(/[^`]+)`', page, re.MULTILINE)
    for where in map(parse_address, addresses):
        Reader(where, where.message_type, members_of)


@pytest.mark.parametrize('command', NODES)
def test_the_nodes_and_parameters_that_are_started_exist(command: str) -> None:
    node = shlex.split(command.rstrip('\\'))[3]
    assert callable(import_module(f'nadrc_ros.nodes.{node}').main)
    for name, value in re.findall(r'-p (\w+):=(\S+)', command):
        assert _accepts(PARAMETERS[node][name], value)


def test_the_parameters_that_are_set_exist() -> None:
    changes = [shlex.split(line)[3:] for line in BASH if line.startswith('ros2 param set')]
    assert len(changes) >= 7
    for node, name, value in changes:
        assert _accepts(PARAMETERS[node.strip('/')][name], value)


def test_the_parameters_for_a_first_run_fit_together() -> None:
    page = (ROOT / 'docs' / 'first_run.md').read_text(encoding='utf-8')
    (text,) = re.findall(r'```yaml\n(.*?)```', page, re.DOTALL)
    values = yaml.safe_load(text)['/**/controller']['ros__parameters']
    for name, value in values.items():
        assert PARAMETERS['controller'][name].accepts(value), name
    law = {name: value for name, value in values.items() if name in declared(ControllerSettings)}
    ControllerSettings(**law).check_rate(values['rate'])


def test_the_faults_of_the_example_load() -> None:
    (text,) = re.findall(r'```yaml\n(.*?)```', SAFETY, re.DOTALL)
    faults = yaml.safe_load(text)
    scenario = from_mapping(
        {'plant': 'paper', 'reference': 'cosine', 'controllers': {'it': {}}, **faults}, ROOT
    )
    assert len(scenario.faults.measurement) == 2 and len(scenario.faults.command) == 1


GENERATED = ['commands', 'files', 'parameters', 'performance', 'safety', 'scenarios']


@pytest.mark.parametrize('page', GENERATED)
def test_what_is_generated_is_up_to_date(page: str) -> None:
    sys.path.insert(0, str(ROOT / 'docs'))
    generator: Any = import_module(page)
    assert generator.page() == generator.PAGE.read_text(encoding='utf-8')


def test_the_picture_of_the_states_is_up_to_date() -> None:
    sys.path.insert(0, str(ROOT / 'docs'))
    safety: Any = import_module('safety')
    assert safety.picture() == safety.PICTURE.read_text(encoding='utf-8')


def test_the_picture_of_the_floors_is_that_of_the_arrows() -> None:
    sys.path.insert(0, str(ROOT / 'docs'))
    layers: Any = import_module('layers')
    assert layers.draw() == (ROOT / 'docs' / 'layers.svg').read_text(encoding='utf-8')
    height = {name: i for i, floor in enumerate(reversed(layers.FLOORS)) for name, *_ in floor}
    assert set(height) == set(ARROWS)
    assert all(height[below] < height[floor] for floor in ARROWS for below in ARROWS[floor])


def test_what_the_tour_of_the_architecture_names_is_there() -> None:
    rows = re.findall(r'^\| `([^`]+)`(?: `([^`]+)`)? \|', ARCHITECTURE, re.MULTILINE)
    assert len(rows) > 10
    for file, name in rows:
        source = (ROOT / 'nadrc_ros' / file).read_text(encoding='utf-8')
        last = name.rpartition('.')[2]
        assert not name or re.search(rf'^ *(def|class) {last}\b', source, re.MULTILINE), name
    for file in re.findall(r'`(\w+/\w+\.py)`', ARCHITECTURE):
        assert (ROOT / 'nadrc_ros' / file).exists() or (ROOT / file).exists(), file


def test_every_promise_has_a_test() -> None:
    rows = re.findall(r'^\| (\d+) \| .* \| (.*) \|$', SAFETY, re.MULTILINE)
    assert [int(number) for number, _ in rows] == [*range(1, 26)]
    assert all('](../test/' in tests for _, tests in rows)


PAGES = [path for folder in (ROOT, ROOT / 'docs') for path in folder.glob('*.md')]


@pytest.mark.parametrize('page', PAGES, ids=lambda path: path.name)
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding='utf-8')
    for target in re.findall(r'\]\((?!https?:)([^)#]+)', text):
        assert (page.parent / target).exists(), target


def _accepts(field: Declared, value: str) -> bool:
    """Tell whether `ros2 param set` would take the value: a double needs its point."""
    if field.kind == 'flag':
        return value in ('true', 'false')
    if field.kind == 'number':
        return '.' in value and field.accepts(float(value))
    return field.accepts(value)
