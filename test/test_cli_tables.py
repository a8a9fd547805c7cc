"""Every table that `nadrc` prints, on terminals of any width: each number stays one token."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
import fcntl
from io import StringIO
import json
import os
from pathlib import Path
import pty
import re
import struct
import subprocess
import sys
import termios
from types import SimpleNamespace
from typing import Any

from bench.identify import record
from nadrc_ros.cli import demo, table
from nadrc_ros.cli.app import app
from nadrc_ros.report.tables import FIGURES
from nadrc_ros.scenario.files import load, loads
import pytest
from test_identify import LAG
from typer.testing import CliRunner

ROOT = Path(__file__).parents[1]
SCENARIO = """
plant: {name: chain, order: 1, damping: 1, load: 2}
reference: {signal: step, amplitude: 1}
noise: {variance: 1e-4}
rate: 50
duration: 1
controllers:
  conventional: {structure: conventional}
  nested: {inner_bandwidth: 8, outer_bandwidth: 4, controller_bandwidth: 2}
"""
KEYS = [key for key, *_ in FIGURES]
# Units of JSON, and those of the table.
SHOWN = {
    'saturated_fraction': 100.0,
    'saturated': 100.0,
    'phase': 57.29578,
    'delay': 1e3,
    'input_gain_margin': 100.0,
}
WIDTHS = (60, 80, 120)
KINDS = ({'TERM': 'xterm-256color'}, {'TERM': 'xterm', 'NO_COLOR': '1'}, {'TERM': 'dumb'})
NUMBER = re.compile('-?[0-9]+(?:[.]([0-9]+))?(?:e([-+][0-9]+))?')
# Arguments of print_columns.
Tables = list[tuple[Any, ...]]


class Screen(StringIO):
    """A terminal, as wide as COLUMNS says."""

    def isatty(self) -> bool:
        return True


def shown(key: str, value: float) -> float:
    return SHOWN.get(key, 1.0) * value


def simulated(folder: Path) -> list[float]:
    nadrc('simulate', folder / 's.yaml', '--json', folder / 'f.json')
    runs = json.loads((folder / 'f.json').read_text())['runs']
    return [shown(key, run[key]) for run in runs.values() for key in KEYS]


def designed(folder: Path) -> list[float]:
    nadrc('design', '--settling-time', '0.5', '--noise-std', '1e-3', '--details', '--out', folder)
    names = ('error', 'gain_low', 'gain_high', 'phase', 'delay', 'modulus', 'itae', 'isu')
    more = ('settling_time', 'command_noise', 'noise_isu', 'input_gain_margin', 'saturated')
    numbers = []
    for each in json.loads((folder / 'design.json').read_text())['candidates'].values():
        told = each['predicted'] | each['predicted']['margins'] | each['expected']
        numbers += [*each['bandwidths'], *(shown(name, told[name]) for name in (*names, *more))]
    return numbers


def identified(folder: Path) -> list[float]:
    run = record(loads(LAG), folder / 'runs')
    nadrc('identify', run, '--order', '1', '--json', folder / 'f.json')
    found = json.loads((folder / 'f.json').read_text())
    ends = [found[name][end] for name in ('b0', 'damping') for end in ('value', 'low', 'high')]
    return [found['order'], *ends, 1.0 / found['damping']['value'], found['noise']]


def summarised(folder: Path) -> list[float]:
    run = record(loads(LAG), folder / 'runs')
    nadrc('summarise', run)
    metrics = json.loads((run / 'summary.json').read_text())['metrics']
    return [shown(key, metrics[key]) for key in KEYS if metrics[key] is not None]


def tuned(folder: Path) -> list[float]:
    few = '--trials', '20', '--population', '4', '--seeds', '1', '--jobs', '1'
    nadrc('tune', folder / 's.yaml', *few, '--out', folder)
    numbers = []
    for found in json.loads((folder / 'tune.json').read_text())['controllers'].values():
        chosen = found['front'][found['chosen'] - 1]
        numbers += [chosen['isu'], chosen['objective'], *chosen['values'].values()]
        numbers += [shown(key, found['predicted'][key]) for key in KEYS]
    return numbers


def demonstrated(folder: Path) -> list[float]:
    """Print the table of a demo; its processes are tested elsewhere."""
    scenario = load(folder / 's.yaml')
    runs: Any = {
        name: SimpleNamespace(
            summary={
                'metrics': scenario.run(name).metrics.as_dict(),
                'samples_lost': 1729,
                'rows': 50,
            },
            diagnostics={'latency_median_ms': 2.1553, 'latency_p99_ms': 33.4962, 'periods': 49},
        )
        for name in scenario.controllers
    }
    demo._print_table('mine', scenario, runs)
    figures: list[dict[str, Any]] = [demo._figures(run) for run in runs.values()]
    return [value for each in figures for value in each.values()]


COMMANDS = (simulated, designed, identified, summarised, tuned, demonstrated)


def nadrc(*words: object) -> None:
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == 0, done.output


@pytest.fixture(scope='module', params=COMMANDS, ids=lambda command: command.__name__)
def printed(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Tables, list[float]]]:
    """Return the tables of a command, and the numbers of its JSON that they show."""
    folder = tmp_path_factory.mktemp('tables')
    (folder / 's.yaml').write_text(SCENARIO)
    tables: Tables = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table, 'print_columns', lambda *given: tables.append(given))
        numbers = request.param(folder)
    yield tables, numbers


def tokens(text: str) -> Counter[str]:
    """Return the words of a text that have a digit, without the codes of colours."""
    words = re.sub('\x1b\\[[0-9;]*m', '', text).split()
    return Counter(word for word in words if re.search('[0-9]', word))


def rounds_to(number: float, word: str) -> bool:
    """Tell whether a word is a number to the digits that it has."""
    match = NUMBER.fullmatch(word)
    assert match
    last = 10.0 ** (float(match[2] or 0) - len(match[1] or ''))
    return bool(abs(float(word) - number) <= 0.501 * last)


@pytest.fixture
def render(monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    def show(tables: Tables, screen: StringIO, **environment: str) -> str:
        monkeypatch.delenv('NO_COLOR', raising=False)
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr(sys, 'stdout', screen)
        for each in tables:
            table.print_columns(*each)
        return screen.getvalue()

    return show


def test_every_number_of_the_json_is_one_token_whatever_the_terminal(
    printed: tuple[Tables, list[float]], render: Callable[..., str]
) -> None:
    tables, numbers = printed
    assert tables
    piped = render(tables, StringIO())
    cells = Counter(
        word
        for _, heads, rows, *_ in tables
        for cell in (*heads, *(cell for row in rows for cell in row.cells))
        for word in str(cell).split()
        if re.search('[0-9]', word)
    )
    there = [word for word in tokens(piped) if NUMBER.fullmatch(word)]
    for number in numbers:
        assert any(rounds_to(number, word) for word in there), number
    for kind in KINDS:
        for width in WIDTHS:
            text = render(tables, Screen(), COLUMNS=str(width), **kind)
            plain = re.sub('\x1b\\[[0-9;]*m', '', text)
            for line in plain.splitlines():
                assert len(line) <= width or len(line.split()) == 1, plain  # a long path
            missing = cells - tokens(text)
            assert not missing, (width, kind, missing)
            assert kind['TERM'] != 'dumb' or '\x1b' not in text


def test_units_stay_beside_their_labels(
    printed: tuple[Tables, list[float]], render: Callable[..., str]
) -> None:
    for each in printed[0]:
        units = [word for row in each[2] for word in row.label.split() if word.startswith('[')]
        for width in WIDTHS:
            text = render([each], Screen(), COLUMNS=str(width), TERM='dumb').split()
            assert not Counter(units) - Counter(text)


def test_a_real_terminal_of_60_columns_breaks_nothing(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack('HHHH', 40, 60, 0, 0))
    environment = {key: value for key, value in os.environ.items() if key != 'COLUMNS'}
    words = 'simulate', 'chain', '--duration', '0.2'
    process = subprocess.Popen(
        [sys.executable, '-m', 'nadrc_ros.cli', *words],
        cwd=ROOT,
        env=environment | {'TERM': 'xterm'},
        stdout=theirs,
        stderr=subprocess.DEVNULL,  # the spinner
    )
    os.close(theirs)
    text = b''
    with os.fdopen(ours, 'rb', buffering=0) as terminal:
        try:
            while part := terminal.read(4096):
                text += part
        except OSError:  # Linux says so that the other end is closed
            pass
    assert process.wait() == 0
    lines = re.sub('\x1b\\[[0-9;]*m', '', text.decode()).splitlines()
    assert 40 < max(map(len, lines)) <= 60
    names = 'conventional', 'nested', 'printed', 'cascade', 'generalized'
    assert not Counter(names) - Counter(' '.join(lines).split())
