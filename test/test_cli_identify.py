"""`nadrc identify` as a user runs it, on runs of the recorder and on bags."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copytree
from typing import Any

from bag_helpers import write_bag
from bench.identify import record
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.cli import identify as command
from nadrc_ros.cli.app import app
from nadrc_ros.records import shaping
from nadrc_ros.records.history import append_parameters
from nadrc_ros.records.recording import read_samples
from nadrc_ros.scenario.files import load, loads
from nadrc_ros.scenario.parameter_files import controller_parameters
import pytest
from test_identify import LAG
from typer.testing import CliRunner
import yaml


def nadrc(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture(scope='module')
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(loads(LAG), tmp_path_factory.mktemp('runs'))


def test_a_run_gives_a_table_a_verdict_and_three_files_to_go_on_with(
    run: Path, tmp_path: Path
) -> None:
    out = tmp_path / 'new' / 'mine'
    files = [out / name for name in ('identify.yaml', 'scenario.yaml', 'identify.json')]
    options = ('--out', out, '--json', tmp_path / 'f.json')
    done = nadrc('identify', run, '--order', 1, '--b0', 12, *options)
    assert done.exit_code == 0, done.output
    assert 'b0 = 12 is 2.39 times too large: worth a change.' in done.output
    for said in (
        'Suggested start: settling time',
        'Stable if the true gain is ',
        'Next: nadrc design ',
    ):
        assert said in done.output
    assert f'Then: nadrc tune {files[1]} --budget ' in done.output
    assert 'without command_min, command_max and safe_command' in done.output
    assert files[2].read_text() == (tmp_path / 'f.json').read_text()
    figures = json.loads(files[2].read_text())
    assert figures['b0']['low'] < 5.0 < figures['b0']['high']
    ((node, content),) = yaml.safe_load(files[0].read_text()).items()
    assert node == '/**/controller'
    parameters = content['ros__parameters']
    assert parameters.pop('rate') == 100.0
    settings = ControllerSettings(**parameters)
    unknown = {'command_min', 'command_max', 'safe_command'}
    assert parameters.keys() | unknown == declared(ControllerSettings).keys()
    assert not parameters.keys() & unknown
    assert settings.b0 == pytest.approx(5.0, rel=0.02) and settings.plant_order == 1
    scenario = load(files[1])
    assert scenario.controllers['identified'].b0 == settings.b0
    assert nadrc('simulate', files[1]).exit_code == 0


def test_the_log_knows_its_controller_and_the_line_that_is_printed_makes_the_start(
    run: Path, tmp_path: Path
) -> None:
    folder = tmp_path / 'run'
    copytree(run, folder)
    running = ControllerSettings(
        plant_order=1, b0=12.0, structure='conventional', command_min=-9.0, command_max=9.0
    )
    append_parameters(folder, None, '/it/controller', controller_parameters(running, 100.0))
    out, figures = tmp_path / 'found', tmp_path / 'f.json'
    done = nadrc('identify', folder, '--order', 1, '--out', out, '--json', figures)
    assert done.exit_code == 0, done.output
    assert 'b0 = 12 is 2.39 times too large' in done.output
    ((_, content),) = yaml.safe_load((out / 'identify.yaml').read_text()).items()
    start = content['ros__parameters']
    assert (start['command_min'], start['command_max']) == (-9.0, 9.0)
    line = json.loads(figures.read_text())['design'].split()
    assert f'Next: {" ".join(line)} --out {out / "design"}' in done.output
    done = nadrc(*line[1:], '--out', out / 'design')
    assert done.exit_code == 0, done.output
    ((_, content),) = yaml.safe_load((out / 'design' / 'design.yaml').read_text()).items()
    design = content['ros__parameters']
    for name in ('structure', 'b0', 'inner_bandwidth', 'controller_bandwidth', 'command_max'):
        assert design[name] == start[name], name


@pytest.mark.parametrize(
    ('b0', 'said'), [(-5, 'WRONG SIGN'), (5.0, 'agrees with the log'), (4, 'too small: tolerable')]
)
def test_the_verdict_on_a_b0(b0: float, said: str, run: Path) -> None:
    assert said in nadrc('identify', run, '--order', 1, '--b0', b0).output


@pytest.fixture(scope='module')
def own(run: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    folder = tmp_path_factory.mktemp('own')
    b0_of(folder, run)
    return interval_in(folder)


@pytest.mark.parametrize(
    ('mcap', 'late', 'within'),
    [
        (False, -2e-4, 0.008),  # the same rows, at a rate that is found: 1e-4 of b0
        # of a square that comes after its measurement a row has the value before: 3e-5 of the
        # estimate, but an end of the interval is that of a model with backlash, which moves more
        (True, 2e-4, 0.05),
    ],
)
def test_a_bag_of_other_topics_gives_the_same_plant(
    mcap: bool, late: float, within: float, own: dict[str, float], run: Path, tmp_path: Path
) -> None:
    samples = read_samples(run)
    topics = {'measurement': '/x/state', 'command': '/x/control_effort', 'reference': '/x/set'}
    after = {'measurement': 0.0, 'command': 4e-4, 'reference': late}
    signals = {
        topic: [(1.0 + t + after[name], v) for t, v in zip(samples['time'], samples[name])]
        for name, topic in topics.items()
    }
    bag = write_bag(tmp_path / 'bag', signals, mcap)
    options = [word for name, topic in topics.items() for word in (f'--{name}', topic)]
    b0_of(tmp_path, bag, *options)
    found = interval_in(tmp_path)
    half = 0.5 * (own['high'] - own['low'])
    for end in ('low', 'value', 'high'):
        assert found[end] == pytest.approx(own[end], abs=within * half), end


def as_csv(folder: Path, columns: dict[str, Any]) -> Path:
    """Write a file as a spreadsheet in Europe does, in milliseconds and without a reference."""
    path = folder / 'öl log.csv'
    lines = ['t;Drehzahl (rpm);PWM;Ziel']
    for row in zip(
        columns['time'], *(columns[n] for n in ('measurement', 'command', 'reference'))
    ):
        lines.append(';'.join(f'{x!r}' for x in (round(1e3 * row[0]), *row[1:])).replace('.', ','))
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8-sig')
    return path


def b0_of(folder: Path, *options: object) -> tuple[float, str]:
    done = nadrc('identify', *options, '--order', 1, '--json', folder / 'f.json')
    assert done.exit_code == 0, done.output
    return json.loads((folder / 'f.json').read_text())['b0']['value'], done.output


def interval_in(folder: Path) -> dict[str, float]:
    found: dict[str, float] = json.loads((folder / 'f.json').read_text())['b0']
    return found


def test_a_csv_file_gives_the_plant_of_the_run_and_says_how_it_was_read(
    run: Path, tmp_path: Path
) -> None:
    path = as_csv(tmp_path, read_samples(run))
    options = (
        '--time',
        't',
        '--time-unit',
        'ms',
        '--reference',
        'ziel',
        '--measurement',
        'Drehzahl',
    )
    value, output = b0_of(tmp_path, path, *options)
    assert value == pytest.approx(b0_of(tmp_path, run)[0], rel=1e-4)
    assert 'semicolons between cells, decimal commas' in output
    assert 'PWM (guessed by its name)' in output
    guess = 'the limits of the command, '
    assert guess in output and 'are guessed: the log does not contain them' in output
    b0_of(tmp_path, path, *options, '--out', tmp_path / 'found')
    scenario = tmp_path / 'found' / 'scenario.yaml'
    assert scenario.read_text().startswith(f'# {guess}') and load(scenario)
    assert b0_of(tmp_path, run / 'samples.csv')[0] == pytest.approx(value, rel=1e-4)
    wrong = nadrc('identify', path, *options[:-1], 'drehzal')
    assert wrong.exit_code == 1 and 'did you mean Drehzahl (rpm)?' in wrong.output


def test_a_part_of_a_log_is_used_if_asked_for(run: Path, tmp_path: Path) -> None:
    value, output = b0_of(tmp_path, run, '--from', 5, '--to', 12)
    assert '701 samples, 7.01 s' in output and value == pytest.approx(5.0, rel=0.05)
    none = nadrc('identify', run, '--from', 50)
    assert none.exit_code == 1 and 'the run has 0 to 19.99 s' in none.output


def test_of_a_dense_log_not_every_row_is_used_and_that_is_said(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    value, output = b0_of(tmp_path, run, '--every', 2, '--out', tmp_path)
    assert 'every 2 rows count as one, 50 Hz\n' in output and '1000 samples' in output
    assert value == pytest.approx(5.0, rel=0.05)
    figures = json.loads((tmp_path / 'f.json').read_text())
    assert (figures['rows_per_sample'], figures['period']) == (2, 0.01)
    assert 'rate: 100.0' in (tmp_path / 'identify.yaml').read_text()  # that of the loop
    assert figures['inner_bandwidth'] <= 30.0
    monkeypatch.setattr(command, '_MOST_ROWS', 1500)
    monkeypatch.setattr(shaping, '_BEND', 1.0)  # as if it were sampled ten times as densely
    assert 'every 2 rows count as one, 50 Hz; --every 1 uses' in b0_of(tmp_path, run)[1]


def test_a_heading_that_wraps_is_named_with_the_remedy(run: Path, tmp_path: Path) -> None:
    samples = read_samples(run)
    for name in ('measurement', 'reference'):
        samples[name] = [(100.0 * x) % 360.0 for x in samples[name]]
    path = as_csv(tmp_path, samples)
    options = (path, '--time-unit', 'ms', '--reference', 'Ziel', '--measurement', 'Drehzahl')
    wrapped = nadrc('identify', *options)
    assert wrapped.exit_code == 1
    assert 'the measurement jumps by 360, as an angle that wraps: --wrap 360' in wrapped.output
    assert b0_of(tmp_path, *options, '--wrap', 360)[0] == pytest.approx(500.0, rel=0.02)


def test_nonsense_is_refused_in_one_line_and_leaves_no_file(run: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out'
    for path in (tmp_path / 'nothing', tmp_path, run / 'run.json'):
        done = nadrc('identify', path, '--out', out)
        assert done.exit_code == 1 and str(path) in done.output
        assert len(done.output.splitlines()) == 1 and not out.exists()
    for b0 in (0, 'nan'):
        assert 'error: --b0 = ' in nadrc('identify', run, '--b0', b0).output
    assert nadrc('identify', run, '--order', 7).exit_code == 2
    assert nadrc('identify', run, '--namespace', 'x').exit_code == 1
    done = nadrc('identify', run, '--order', 1, '--json', tmp_path / 'no' / 'f.json')
    assert done.exit_code == 1 and 'no such folder' in done.output


def test_help_has_an_example() -> None:
    assert 'Example: nadrc identify runs/' in nadrc('identify', '--help').output


def test_what_was_found_is_printed_before_what_cannot_be_set(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from nadrc_ros.tuning.identification import advice

    monkeypatch.setattr(advice, 'NOISE_SHARE', 1e-15)
    done = nadrc('identify', run, '--order', 1)
    assert done.exit_code == 1
    assert done.output.index('b0') < done.output.index('no settling time up to')


def test_a_b0_of_another_order_is_asked_for_its_order(run: Path) -> None:
    assert 'give its order: --order' in nadrc('identify', run, '--b0', 50).output
    assert 'give its order' not in nadrc('identify', run, '--b0', 50, '--order', 1).output
