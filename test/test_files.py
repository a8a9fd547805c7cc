"""docs/files.md names what is written: the commands are run, and files and page compared."""

from __future__ import annotations

from math import nan
import os
from pathlib import Path
import re
from typing import Any

import attrs
from bench.identify import record
from files_helpers import columns, differences, document, files_of, KNOWN, lines, PAGE
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.cli.app import app
from nadrc_ros.records.step_trace import TraceWriter
from nadrc_ros.scenario.files import loads
from nadrc_ros.simulation.metrics import MetricValues
from nadrc_ros.theory.margins import Margins
import pytest
from test_identify import LAG
from typer.main import get_command
from typer.testing import CliRunner

PACKAGE = Path(__file__).resolve().parents[1] / 'nadrc_ros'
WRITING = {'--out', '--json', '--plot', '--page', '--table', '--write'}
SCENARIO = """
plant: paper
reference: cosine
noise: {variance: 1e-6}
rate: 100
duration: 0.5
controllers:
  one: {structure: conventional, inner_bandwidth: 12, controller_bandwidth: 4}
"""


def nadrc(*arguments: object) -> None:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output


@pytest.fixture
def scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / 'mine.yaml'
    path.write_text(SCENARIO, encoding='utf-8')
    return path


def test_figures_and_margins_are_those_that_there_are() -> None:
    assert KNOWN['figure'] == [field.name for field in attrs.fields(MetricValues)]
    assert KNOWN['margin'] == list(Margins._fields)


def test_every_kind_of_document_and_of_event_is_on_the_page() -> None:
    sources = [path.read_text(encoding='utf-8') for path in PACKAGE.rglob('*.py')]
    written = re.compile(r"write_json\(\s*[^,()]+,\s*'(\w+)'")
    kinds = {kind for text in sources for kind in written.findall(text)}
    assert kinds >= {'run', 'about', 'demo', 'design', 'simulate', 'tune'}
    assert {kind for kind in kinds if f'`nadrc/{kind} 1`' not in PAGE} == set()
    (row,) = re.findall(r'^\| `kind` \|.*', PAGE, re.MULTILINE)
    events = {kind for text in sources for kind in re.findall(r"events\.tell\('(\w+)'", text)}
    assert {'mode', 'fault'} <= events <= set(re.findall(r'`(\w+)`', row))


def test_every_command_that_writes_is_on_the_page_with_its_options() -> None:
    root: Any = get_command(app)
    for name, command in root.commands.items():
        told = {option for each in command.params for option in each.opts} & WRITING
        row = re.search(rf'^\| `nadrc {name}` \|.*', PAGE, re.MULTILINE)
        assert {option for option in told if not row or f'`{option}`' not in row[0]} == set(), name


def test_simulate(scenario: Path, tmp_path: Path) -> None:
    nadrc('simulate', scenario, '--json', 'a.json')
    found = document(tmp_path / 'a.json', 'simulate')
    assert differences('`nadrc simulate --json`', found) == []


def test_sweep(scenario: Path, tmp_path: Path) -> None:
    sweep = tmp_path / 'sweep.yaml'
    sweep.write_text('scenario: mine.yaml\nvary: {plant.a3: [0.1, 0.2]}\nseeds: 1\n')
    nadrc('sweep', sweep, '--table', 'a.csv', '--jobs', 1)
    found = columns(tmp_path / 'a.csv')
    assert 'duration_used' in found and '`duration_used`' in PAGE
    known = {'duration' if name == 'duration_used' else name for name in found}
    assert differences('`nadrc sweep --table`', known) == []
    assert (tmp_path / 'a.csv.yaml').exists() and '`<table>.yaml`' in PAGE


def test_design_and_export(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    nadrc('design', '--settling-time', 0.5, '--rate', 200, '--out', out)
    assert set(os.listdir(out)) == files_of('`nadrc design`')
    assert differences('`design.json`', document(out / 'design.json', 'design')) == []
    nadrc('export', 'c', out / 'design.yaml', '--out', tmp_path / 'c')
    assert set(os.listdir(tmp_path / 'c')) == files_of('`nadrc export`') | {'nadrc.h', 'nadrc.c'}


def test_tune(scenario: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out'
    options = ('--trials', 4, '--population', 4, '--seeds', 1, '--jobs', 1)
    spread = ('--plant', 'a3=0.1:0.2', '--vary', 'inner_bandwidth=5:20')
    nadrc('tune', scenario, *options, *spread, '--out', out)
    assert set(os.listdir(out)) == files_of('`nadrc tune`') | {'one.yaml'}
    assert differences('`tune.json`', document(out / 'tune.json', 'tune')) == []


def test_identify_and_summarise(tmp_path: Path) -> None:
    run, out = record(loads(LAG), tmp_path), tmp_path / 'out'
    nadrc('identify', run, '--order', 1, '--out', out)
    assert set(os.listdir(out)) == files_of('`nadrc identify`')
    assert columns(out / 'reference.csv') == ['time', 'reference']
    assert differences('`identify.json`', document(out / 'identify.json', 'identify')) == []
    nadrc('summarise', run)
    found = document(run / 'summary.json', 'summary')
    assert differences('`summary.json`', found) == []


def test_a_trace(tmp_path: Path) -> None:
    path = tmp_path / 'trace'
    controller = Controller(ControllerSettings())
    trace = TraceWriter(path, controller.settings)
    for k in range(2):
        controller.tick(1.0 if k else nan, 0.01, reference=[1.0, 0.0, None])
        trace.tick(controller, [1.0, 0.0, None])
    trace.disabled()
    trace.reset()
    trace.close()
    assert differences('Traces', lines(path) - {'format'}) == []
    assert '`nadrc/trace 1`' in PAGE


def test_a_difference_is_found() -> None:
    found = {'started', 'namespace', 'version', 'units.output', 'color'}
    assert differences('`about.json`', found) == [
        '`about.json`: version is not on the page',
        '`about.json`: versions.<package> is not in the file',
    ]
    assert differences('`nadrc simulate --json`', {'scenario', 'runs.a.itea'}) == [
        '`nadrc simulate --json`: runs.a.itea is not on the page',
        '`nadrc simulate --json`: runs.<controller>.<figure> is not in the file',
    ]
