"""What `nadrc` and the nodes say: lines break between words, and say of what kind they are."""

from __future__ import annotations

from io import StringIO
import shlex
import sys
from typing import Any

from nadrc_ros.cli import messages
from nadrc_ros.cli.app import app, COMMANDS
from nadrc_ros.cli.wire import _print
from nadrc_ros.scenario.files import shipped_scenarios
from nadrc_ros.terminal import command_line, wrapped
import pytest
from typer.main import get_command
from typer.testing import CliRunner


class Screen(StringIO):
    """A terminal, as wide as COLUMNS says."""

    def isatty(self) -> bool:
        return True


LONG = 'nadrc report "runs/a b" runs/20260101-120000 runs/20260101-120015 --page compared.html'


@pytest.mark.parametrize('width', [12, 30, 60, 80])
def test_lines_break_between_words_only(width: int) -> None:
    text = 'a delay of 12.5 ms, not 1/s: --settling-time and inner_bandwidth\n\nmore'
    lines = wrapped(text, width, '  ').split('\n')
    assert ' '.join(lines).split() == text.split()
    assert all(len(line) <= width or ' ' not in line.strip() for line in lines)
    assert '' in lines
    assert wrapped(text, None) == text


@pytest.mark.parametrize('width', [20, 60, 80, None])
def test_a_command_can_be_copied_from_any_terminal(width: int | None) -> None:
    words = shlex.split(LONG)
    text = command_line(words, width, 'more in: ')
    assert shlex.split(text.removeprefix('more in: ').replace('\\\n', ' ')) == words
    for line in text.split('\n'):
        assert width is None or len(line) <= width or len(line.split()) <= 3
    assert (width is None) == ('\n' not in text)


@pytest.mark.parametrize('kind', ['error', 'warning', 'note'])
def test_a_message_says_of_what_kind_it_is(kind: str, capfd: pytest.CaptureFixture[str]) -> None:
    getattr(messages, kind)('there is [b] in it')
    assert capfd.readouterr().err == f'{kind}: there is [b] in it\n'


def test_colours_are_for_terminals_whose_reader_wants_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    screen = Screen()
    monkeypatch.setenv('TERM', 'xterm')
    monkeypatch.delenv('NO_COLOR', raising=False)
    assert messages.colourful(screen)
    monkeypatch.setenv('NO_COLOR', '1')
    assert not messages.colourful(screen)
    monkeypatch.setenv('NO_COLOR', '')
    monkeypatch.setenv('TERM', 'dumb')
    assert not messages.colourful(screen)


@pytest.mark.parametrize('width', [60, 80, 120])
@pytest.mark.parametrize('name', ['', *(command.__name__ for command in COMMANDS)])
def test_help_breaks_no_word(name: str, width: int) -> None:
    root: Any = get_command(app)
    command = root.commands[name] if name else root

    def shown(columns: int) -> str:
        context = command.context_class(command, info_name=name, terminal_width=columns)
        text: str = command.get_help(context)
        return text

    assert all(len(line) <= width for line in shown(width).splitlines())
    assert shown(width).split() == shown(500).split()
    assert '\\' not in shown(width) and '…' not in shown(width)


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['desgin'], 'no such command: desgin; did you mean design?'),
        (['design', '--setling-time', '3'], 'such option: --setling-time; did you mean --settli'),
        (['design', '--settling-time', '-2'], '--settling-time = -2.0: must be a finite number'),
        (['identify', 'log', '--order', '9'], "for '--order': "),
        (['identify', 'log', '--order', '9'], ' 9'),
        (['simulate', 'demo', '--seed', '-2'], '--seed = -2: must be'),
        (['tune', 'demo', '--b0-spread', '1'], "--b0-spread = '1': must be low:high"),
        (['tune', 'demo', '--isu', '-1'], '--isu = -1.0: must be above 0'),
        (['tune', 'demo', '--choose', '1', '--isu', '3'], '--choose: it excludes --isu'),
        (['tune', 'demo', '--vary', 'b0=2'], "--vary b0 = '2': must be low:high"),
    ],
)
def test_an_error_names_what_was_typed(words: list[str], said: str) -> None:
    done = CliRunner().invoke(app, words)
    (line,) = (line for line in done.output.splitlines() if line.startswith('error: '))
    assert said in line and done.exit_code in (1, 2)


def test_an_error_in_a_file_names_its_key_whatever_was_typed(tmp_path: Any) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text('{plant: chain, reference: sine, controllers: {c: {}}, rate: -1}')
    done = CliRunner().invoke(app, ['simulate', str(file), '--rate', '50'])
    assert done.output.startswith(f'error: {file}: rate = -1.0: must be')


@pytest.mark.parametrize(
    ('words', 'completed'),
    [
        ('nadrc sce', 'scenarios'),
        ('nadrc simulate mot', 'motor_position\nmotor_speed'),
        ('nadrc design --structure ne', 'nested'),
        ('nadrc design --settl', '--settling-time'),
    ],
)
def test_a_shell_completes_commands_scenarios_options_and_their_values(
    words: str, completed: str
) -> None:
    asked = {
        'COMP_WORDS': words,
        'COMP_CWORD': str(len(words.split()) - 1),
        '_NADRC_COMPLETE': 'complete_bash',
    }
    done = CliRunner().invoke(app, [], env=asked, prog_name='nadrc')
    assert (done.exit_code, done.output.strip()) == (0, completed)


def test_the_units_of_options_are_completed_too() -> None:
    root: Any = get_command(app)
    design = root.commands['design']
    context = design.context_class(design, info_name='design')
    (option,) = design.shell_complete(context, '--settling')
    assert option.help.endswith('(s).')


def test_scenarios_lists_every_shipped_one() -> None:
    listed = CliRunner().invoke(app, ['scenarios'])
    assert listed.exit_code == 0
    for name in shipped_scenarios():
        assert f'\n{name} ' in f'\n{listed.output}'
    assert 'chain, order 3, 15 s at 200 Hz: conventional, nested' in listed.output


@pytest.mark.parametrize('width', [60, 80, 200])
def test_addresses_of_fields_break_at_their_blank_only(
    width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    screen = Screen()
    monkeypatch.setattr(sys, 'stdout', screen)
    monkeypatch.setenv('COLUMNS', str(width))
    numbers = [('position[name=left_shoulder_pan_joint]', 1.25), ('header.stamp.sec', -3e-9)]
    _print('/joint_states', 'sensor_msgs/msg/JointState', numbers)
    words = screen.getvalue().split()
    assert all(len(line) <= max(width, 60) for line in screen.getvalue().splitlines())
    for word in ('/joint_states', 'sensor_msgs/msg/JointState', numbers[0][0], '1.25', '-3e-09'):
        assert words.count(word) == (2 if width == 200 and word[0] in '/s' else 1), word
