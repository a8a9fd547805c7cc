"""`nadrc` under terminals, pipes, disks and paths as they come."""

from __future__ import annotations

from io import StringIO
import os
from pathlib import Path
import subprocess
import sys

from nadrc_ros.cli import table
from nadrc_ros.cli.app import app
from nadrc_ros.cli.progress import progress
from nadrc_ros.cli.table import print_columns, Row
import pytest
import rich.console
from rich.console import Console
from rich.text import Text
from typer.main import get_command
from typer.testing import CliRunner

SIMULATE = ('simulate', 'demo', '--duration', '0.5')
SWEEP = Path(__file__).parents[1] / 'config' / 'sweeps' / 'bandwidth.yaml'
DESIGN = ('design', '--settling-time', '0.5')


def nadrc(
    *arguments: str, stdout: int = subprocess.PIPE, cwd: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'nadrc_ros.cli', *arguments],
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        env={**os.environ, 'PYTHONPATH': str(Path(__file__).parents[1]), **environment},
        check=False,
    )


def test_an_output_of_ascii_shows_what_stands_for_the_rest(tmp_path: Path) -> None:
    folder = tmp_path / 'mein öl'
    folder.mkdir()
    rows = ''.join(f'{k},{k % 3},1\n' for k in range(300))
    (folder / 'log ².csv').write_text('t,y,u\n' + rows, encoding='utf-8')
    shown = nadrc(*SIMULATE, PYTHONIOENCODING='ascii')
    assert shown.returncode == 0 and 'integral of u2' in shown.stdout, shown.stderr
    refused = nadrc('identify', 'mein öl/log ².csv', cwd=tmp_path, PYTHONIOENCODING='ascii')
    assert refused.returncode == 1 and 'log' in refused.stderr
    assert refused.stderr.splitlines()[-1].split(': ')[2] == 'the command is 1 all the time'
    assert nadrc('design', '--help', PYTHONIOENCODING='latin-1').returncode == 0


def test_a_mistyped_option_is_a_line_for_a_process_too() -> None:
    done = nadrc('design', '--setling-time', '3')
    said = done.stderr.splitlines()[0]
    assert said == 'error: no such option: --setling-time; did you mean --settling-time?'
    assert done.returncode == 2 and 'Traceback' not in done.stderr


REPORT = ('report', 'log.csv', '--plot', 'log.png')


@pytest.mark.parametrize('arguments', [SIMULATE, REPORT, ('--help',)], ids=lambda each: each[0])
def test_a_reader_that_goes_away_is_no_news(arguments: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / 'log.csv').write_text('t,y,u\n' + ''.join(f'{k},{k},1\n' for k in range(9)))
    reading, writing = os.pipe()
    os.close(reading)
    done = nadrc(*arguments, stdout=writing, cwd=tmp_path)
    os.close(writing)
    assert done.returncode == 1
    for word in ('Traceback', 'Errno', 'pipe'):
        assert word not in done.stderr


@pytest.mark.parametrize('arguments', [DESIGN, ('--help',)], ids=lambda each: each[0])
def test_a_full_disk_behind_the_output_is_one_line(arguments: tuple[str, ...]) -> None:
    with Path('/dev/full').open('w') as full:
        done = nadrc(*arguments, stdout=full.fileno(), PYTHONUNBUFFERED='')  # as users have it
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == 'error: output: No space left on device'


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> StringIO:
    """Take the place of a terminal that is as wide as the parameter says."""
    text = StringIO()
    wide = Console(file=text, width=request.param, markup=False, emoji=False, highlight=False)
    monkeypatch.setattr(table, 'console', lambda: wide)
    return text


@pytest.mark.parametrize('screen', [20, 50, 80, 120, 200], indirect=True)
def test_no_number_and_no_name_is_broken_at_any_width(screen: StringIO) -> None:
    names = [f'controller_{i}' for i in range(9)]
    rows = [
        Row(f'max |{k}|', f'largest {k} after the start', [Text(f'{i}.{k}2345') for i in range(9)])
        for k in range(8)
    ]
    print_columns('a title [of] these', [Text(name) for name in names], rows)
    lines, words = screen.getvalue().splitlines(), screen.getvalue().split()
    assert lines[0] == 'a title [of] these'
    assert [word for word in words if word.startswith('controller')] == names
    for i in range(9):
        assert [words.count(f'{i}.{k}2345') for k in range(8)] == [1] * 8
    for k in range(8):
        assert ' '.join(words).count(f'largest {k} after the start') == 1


def test_units_in_brackets_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    print_columns('[a]', [Text('a[b]')], [Row('median [ms]', 'of [it]', [Text('1')])])
    assert capsys.readouterr().out.split() == ['[a]', 'a[b]', 'median', '[ms]', 'of', '[it]', '1']


def test_help_shows_every_word_of_every_option(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('COLUMNS', '300')
    command = get_command(app)
    context = command.make_context('nadrc', ['design'], resilient_parsing=True)
    for name in command.list_commands(context):  # type: ignore[attr-defined]
        sub = command.get_command(context, name)  # type: ignore[attr-defined]
        done = CliRunner().invoke(app, [name, '--help'], env={'COLUMNS': '300'})
        shown = ' '.join(done.output.split())
        for option in sub.params:
            said = (getattr(option, 'help', None) or '').replace('\\[', '[')
            assert said.split('.')[0] in shown, (name, option.name)


@pytest.mark.parametrize('where', ['/dev/null/x', '/proc/x'])
def test_an_output_that_cannot_be_is_named_by_what_was_asked_for(where: str) -> None:
    for arguments in (
        (*SIMULATE, '--json', where),
        (*SIMULATE, '--plot', f'{where}.png'),
        (*DESIGN, '--out', where),
        ('tune', 'demo', '--trials', '1', '--out', where),
        ('sweep', str(SWEEP), '--table', f'{where}.csv'),
    ):
        done = CliRunner().invoke(app, arguments)
        last = done.output.splitlines()[-1]
        assert done.exit_code == 1 and last.startswith('error: ' + where.removesuffix('/x')), last
        assert '.part' not in last and 'Errno' not in last


def test_seconds_are_told_to_a_tenth_and_runs_in_full(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr('nadrc_ros.cli.progress._EVERY', 0.0)
    with progress('running', 9.0, unit='s') as tell:
        tell(2.94421, 'ITAE 3')
    with progress('trying designs', 2e6) as tell:
        tell(1_234_567, '')
    assert capsys.readouterr().err == (
        'note: running: 2.9 of 9 s, ITAE 3\nnote: trying designs: 1234567 of 2000000\n'
    )


def test_a_path_in_brackets_is_shown_while_it_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    text = StringIO()
    seen = Console(file=text, force_terminal=True, width=100)
    monkeypatch.setattr(rich.console, 'Console', lambda **_: seen)
    with progress('reading my [log].csv'):
        pass
    assert 'reading my [log].csv' in text.getvalue()
