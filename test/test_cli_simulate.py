"""`nadrc simulate` writes what it computed, and ends with one line when something is wrong."""

from __future__ import annotations

import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from types import SimpleNamespace
from typing import Any

import attrs
from nadrc_ros.atomic import write_whole
from nadrc_ros.cli.app import app
from nadrc_ros.records.simulated import recorded
from nadrc_ros.report.picture import draw
from nadrc_ros.report.style import render
from nadrc_ros.scenario import find_scenario, load
from nadrc_ros.scenario.mapping import from_mapping
from nadrc_ros.scenario.units import Units
import numpy as np
import pytest
from typer.testing import CliRunner

ROOT = Path(__file__).parents[1]
COMMAND = [sys.executable, '-m', 'nadrc_ros.cli']
SCENARIO = """
plant: {name: paper, a3: 0.2}
reference: {signal: cosine, frequency: 0.5}
disturbance: decaying_cosine
noise: {variance: 1e-6}
rate: 100
duration: 3
controllers:
  conventional: {structure: conventional}
  nested: {}
retune: [{time: 2, inner_bandwidth: 20}]
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / 'mine.yaml'
    path.write_text(SCENARIO)
    return path


def nadrc(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *map(str, arguments)],
        check=False,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
    )


def test_the_table_compares_the_controllers(scenario: Path) -> None:
    result = nadrc('simulate', scenario)
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[0] == 'mine: plant paper, 3 s at 100 Hz, noise variance 1e-06'
    assert lines[1].split() == ['conventional', 'nested']
    assert [line.split()[0] for line in lines[2:]] == [
        *('ITAE', 'ISU', 'IAE', 'RMSE', 'max', 'peak', 'max', 'TV', 'saturated')
    ]
    metrics = load(scenario).run('nested').metrics
    assert lines[2].split()[-1] == f'{metrics.itae:.4g}'


def test_json_holds_the_scenario_and_every_figure_of_merit(scenario: Path) -> None:
    out = scenario.with_name('out.json')
    assert nadrc('simulate', scenario, '--json', out, '--seed', 5).exit_code == 0
    document = json.loads(out.read_text())
    assert list(document) == ['format', 'scenario', 'runs']
    loaded = from_mapping(document['scenario'], '/')
    assert loaded == load(scenario).changed(seed=5)
    assert document['runs'] == {
        name: loaded.run(name).metrics.as_dict() for name in ('conventional', 'nested')
    }


def test_options_replace_what_the_file_says(scenario: Path) -> None:
    out = scenario.with_name('out.json')
    options = ['--duration', 1.5, '--rate', 50, '--seed', 3, '--noise-variance', 0]
    result = nadrc('simulate', scenario, '--json', out, *options)
    assert result.exit_code == 0
    described = json.loads(out.read_text())['scenario']
    assert (described['duration'], described['rate'], described['seed']) == (1.5, 50.0, 3)
    assert described['noise']['variance'] == 0.0
    assert described['retune'] == []
    assert 'note: the retune at 2 s is after the end of this run' in result.output


@pytest.mark.parametrize(
    ('suffix', 'head'), [('png', b'\x89PNG'), ('svg', b'<?xml'), ('pdf', b'%PDF')]
)
def test_a_picture_is_drawn(scenario: Path, suffix: str, head: bytes) -> None:
    picture = scenario.with_name(f'picture.{suffix}')
    assert nadrc('simulate', scenario, '--plot', picture).exit_code == 0
    assert picture.read_bytes().startswith(head)
    assert sorted(os.listdir(scenario.parent)) == ['mine.yaml', picture.name]


def test_a_shipped_scenario_goes_by_its_bare_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = nadrc('simulate', 'demo', '--duration', 1)
    assert result.exit_code == 0
    assert 'demo: plant paper, 1 s at 200 Hz' in result.stdout


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('nested: {}', 'nested: {b0: 0}', 'controllers.nested.b0 = 0.0: must be'),
        ('disturbance', 'fault', 'fault: there is no such key; did you mean faults?'),
        ('rate: 100', 'rate: [', 'line 8, column 12: not YAML: '),
    ],
)
def test_an_error_in_the_file_is_one_line_with_its_name(
    scenario: Path, old: str, new: str, message: str
) -> None:
    scenario.write_text(SCENARIO.replace(old, new))
    done = run('simulate', scenario)
    assert (done.returncode, done.stdout) == (1, '')
    assert done.stderr.startswith(f'error: {scenario}: {message}')
    assert done.stderr.count('\n') == 1


def test_an_error_in_an_option_is_one_line(scenario: Path) -> None:
    done = run('simulate', scenario, '--rate', '-5')
    assert done.returncode == 1
    assert done.stderr == (
        'error: --rate = -5.0: must be a finite number from 0.001 to 100000 Hz\n'
    )


def test_a_plant_that_fails_in_the_run_is_told_by_its_line(scenario: Path) -> None:
    scenario.with_name('plant.py').write_text(
        'class Lag:\n'
        '    order = states = b0 = 1\n'
        '    def derivative(self, t, x, u, w, dx):\n'
        '        dx[0] = u + (1 / (t - 2.5) if t == 2.5 else 0)\n'
        '    def output(self, x):\n'
        '        return x[0]\n'
    )
    scenario.write_text(SCENARIO.replace('{name: paper, a3: 0.2}', '{file: plant.py}'))
    out = scenario.with_name('out.json')
    done = run('simulate', scenario, '--json', out)
    assert done.returncode == 1
    assert 'plant.py, line 4: ZeroDivisionError: ' in done.stderr
    assert 'Traceback' not in done.stderr
    assert not out.exists()


def test_a_plant_that_runs_away_is_told_and_gives_finite_figures(scenario: Path) -> None:
    scenario.with_name('plant.py').write_text(
        'class Blast:\n'
        '    order = states = b0 = 1\n'
        '    def derivative(self, t, x, u, w, dx):\n'
        '        dx[0] = x[0] * x[0] * x[0] + 50.0 * (t > 1)\n'
        '    def output(self, x):\n'
        '        return x[0]\n'
    )
    scenario.write_text(SCENARIO.replace('{name: paper, a3: 0.2}', '{file: plant.py}'))
    out, picture = scenario.with_name('out.json'), scenario.with_name('out.png')
    done = run('simulate', scenario, '--json', out, '--plot', picture)
    assert done.returncode == 0
    assert 'warning: nested: the plant diverged at 1.' in done.stderr
    assert 'Traceback' not in done.stderr and 'Warning' not in done.stderr
    assert json.loads(out.read_text())['runs']['nested']['skipped'] > 0
    assert picture.exists()


def test_where_nothing_can_be_written_is_told(
    scenario: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = scenario.parent
    for option, file, said in (
        ('--json', folder / 'nowhere' / 'out.png', f'{folder}/nowhere: there is no such folder'),
        ('--plot', folder / 'nowhere' / 'out.png', f'{folder}/nowhere: there is no such folder'),
        ('--json', folder, f'{folder}: is a folder, not a file'),
    ):
        with pytest.raises(SystemExit) as ended:
            app(['simulate', str(scenario), option, str(file)])
        assert ended.value.code == 1
        assert capsys.readouterr().err == f'error: {said}\n'


def test_usage_errors_are_those_of_the_command_line(scenario: Path) -> None:
    for arguments in (
        ['simulate'],
        ['simulate', scenario, '--rate', 'fast'],
        ['simulate', scenario, '--plot', 'picture.gif'],
        ['fly'],
    ):
        assert nadrc(*arguments).exit_code == 2


def test_without_a_command_there_is_help() -> None:
    assert 'simulate' in nadrc().output
    assert nadrc('--version').stdout.startswith('nadrc')


def test_ctrl_c_ends_with_130_and_leaves_nothing_behind(scenario: Path) -> None:
    started, out = scenario.with_name('started'), scenario.with_name('out.json')
    scenario.with_name('plant.py').write_text(
        'from pathlib import Path\n'
        'from nadrc_ros.simulation.plants import Chain\n'
        'class Mine(Chain):\n'
        '    def derivative(self, t, x, u, w, dx):\n'
        '        if t > 5:\n'  # later than any time at which a plant is tried before the run
        f'            Path({str(started)!r}).touch()\n'
        '        super().derivative(t, x, u, w, dx)\n'
    )
    scenario.write_text(SCENARIO.replace('{name: paper, a3: 0.2}', '{file: plant.py}'))
    # A job in the background of a shell inherits SIGINT as ignored; with a handler here it is not.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(
        [*COMMAND, 'simulate', str(scenario), '--duration', '1e5', '--json', str(out)],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not started.exists():
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    assert process.stderr is not None
    message = process.stderr.read()
    assert process.wait(60) == 130
    assert 'Traceback' not in message
    assert sorted(os.listdir(scenario.parent)) == ['mine.yaml', 'plant.py', 'started']


def test_help_loads_nothing_heavy() -> None:
    code = (
        'import sys\n'
        'import nadrc_ros.cli.app\n'
        "heavy = {'numpy', 'scipy', 'matplotlib', 'numba', 'yaml', 'rclpy'} & set(sys.modules)\n"
        'sys.exit(str(heavy) if heavy else 0)\n'
    )
    subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=True)


# ---- writing and drawing -----------------------------------------------------------------------


def test_a_file_is_replaced_in_full_or_left_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / 'out.json'
    write_whole(target, b'old')

    def fail(*_: Any) -> None:
        raise OSError(28, 'No space left on device', str(target))

    with monkeypatch.context() as patch:
        patch.setattr(os, 'replace', fail)
        with pytest.raises(OSError, match='No space'):
            write_whole(target, b'new')
    assert (target.read_bytes(), os.listdir(tmp_path)) == (b'old', ['out.json'])
    link = tmp_path / 'link.json'
    link.symlink_to(target)
    write_whole(link, b'new')
    assert link.is_symlink() and target.read_bytes() == b'new'
    write_whole(Path(os.devnull), b'new')
    assert not Path(os.devnull).is_file()


DRAWN = ['time', 'reference', 'output', 'command', 'disturbance_estimate', 'total_disturbance']


def flat(**columns: Any) -> Any:
    zeros = np.zeros_like(columns['time'])
    drawn = {name: np.array(columns.get(name, zeros)) for name in DRAWN}
    told = {'color': 0, 'path': Path('run'), 'changes': [], 'unit': lambda _: ''}
    return SimpleNamespace(**drawn, measurement_period=0.0, **told)


def test_a_picture_has_a_row_for_each_signal_and_each_controller() -> None:
    scenario = load(find_scenario('demo')).changed(duration=3)
    scenario = attrs.evolve(scenario, units=Units(output='rad', command='V'))
    results = {name: scenario.run(name) for name in scenario.controllers}
    traces = {name: recorded(Path(name), scenario, name, each) for name, each in results.items()}
    figure = draw(traces, 'title')
    titles = [axis.get_title('left') for axis in figure.axes]
    assert [title.split('  ')[0] for title in titles] == [
        'output y and reference r [rad]',
        'tracking error r − y [rad]',
        'command u [V]',
        'total disturbance and its estimate: conventional [rad/s²]',
        'total disturbance and its estimate: nested [rad/s²]',
    ]
    drawn = figure.axes[1].get_lines()[0].get_ydata()
    assert any(np.array_equal(drawn, t.reference - t.output) for t in results.values())
    truth, estimate = figure.axes[4].get_lines()[:2]
    assert np.array_equal(estimate.get_ydata(), traces['nested'].disturbance_estimate)
    assert np.array_equal(truth.get_ydata(), traces['nested'].total_disturbance)


def test_only_a_start_that_dwarfs_the_rest_is_cut_off() -> None:
    time = np.linspace(0.0, 10.0, 101)
    late = np.sin(time)
    for size, cut in ((2.0, False), (50.0, True)):
        command = np.where(time < 1.0, size, late)
        axis = draw({'it': flat(time=time, command=command)}, 'title').axes[2]
        assert bool(axis.get_ylim()[1] < size) is cut
        assert ('cut off' in axis.get_title('left')) is cut


def test_what_was_not_recorded_is_left_blank() -> None:
    nothing = [float('nan')] * 4
    trace = flat(time=[0, 1, 2, 3], output=nothing, total_disturbance=nothing)
    assert render(draw({'a': trace, 'b': trace}, 'title'), 'png')
    with pytest.raises(ValueError, match='same first dimension'):
        draw({'a': flat(time=[0, 1], command=[1.0])}, 'title')


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (('simulate', 'demmo'), 'did you mean demo?'),
        (('simulate', ROOT / 'config/sweeps/bandwidth.yaml'), 'this is a sweep, not a scenario'),
        (('sweep', ROOT / 'config/demo.yaml'), 'this is a scenario, not a sweep'),
        (('simulate', 'parameters.yaml'), 'these are parameters of a node, not a scenario'),
    ],
)
def test_a_file_of_another_kind_is_refused_as_such(
    words: tuple[object, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path('parameters.yaml').write_text('/**/controller:\n  ros__parameters: {b0: 2.0}\n')
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == 1 and said in done.output and done.output.count('\n') == 1
