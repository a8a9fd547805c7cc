"""How commands end when something went wrong."""

from __future__ import annotations

import ctypes
from pathlib import Path
import signal
import sys
from threading import Event

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.cli.__main__ import _interrupt_again
from nadrc_ros.cli.app import app
from nadrc_ros.cli.failure import reporting
import pytest
import typer
from typer.testing import CliRunner


def disguised(error: Exception) -> None:
    """Raise what a library makes of Ctrl-C: `__set_name__` in an import, a lock being released."""
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt:
        raise error  # noqa: B904 as a library might


@pytest.mark.parametrize('error', [RuntimeError('set_name'), FileNotFoundError(2, 'gone', 'lock')])
def test_ctrl_c_is_known_in_whatever_disguise(
    error: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    with (
        pytest.raises(typer.Exit) as ended,
        reporting(),
        reporting(after_interrupt=lambda: 'all is kept'),
    ):
        disguised(error)
    assert ended.value.exit_code == 130
    assert capsys.readouterr().err == 'error: interrupted: all is kept\n'


def test_ctrl_c_is_not_lost_in_a_callback_from_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """As numba's compiler has some: what is raised there is only printed."""
    monkeypatch.setattr(sys, 'unraisablehook', _interrupt_again)
    callback = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        callback()
        Event().wait(10.0)


@pytest.mark.parametrize('error', [UserError('no'), FileNotFoundError(2, 'no', 'it')])
def test_what_the_user_can_mend_is_one_line(
    error: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(typer.Exit) as ended, reporting():
        raise error
    assert ended.value.exit_code == 1
    assert capsys.readouterr().err.count('\n') == 1


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (('design', '--settling-time', '1', '--out', 'file'), 'is a file, not a folder'),
        (('tune', 'demo', '--out', 'file/sub'), 'is a file, not a folder'),
        (('identify', 'log', '--json', 'none/f.json'), 'none: there is no such folder'),
        (('identify', 'log', '--json', '.'), 'is a folder, not a file'),
        (('identify', 'log', '--out', 'file'), 'is a file, not a folder'),
        (('simulate', 'demo', '--plot', 'none/f.png'), 'none: there is no such folder'),
        (('demo', '--out', 'file'), 'is a file, not a folder'),
        (('report', 'log', '--page', '.'), 'is a folder, not a file'),
        (('report', 'log', '--plot', 'none/f.svg'), 'none: there is no such folder'),
        (('sweep', 'file', '--table', 'none/f.csv'), 'none: there is no such folder'),
    ],
)
def test_where_nothing_can_be_written_is_said_before_the_work(
    words: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path('file').touch()
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == 1 and done.output.splitlines()[-1].endswith(said)
    assert 'settling' not in done.output  # a table


def test_a_bug_keeps_its_traceback() -> None:
    with pytest.raises(ZeroDivisionError), reporting():
        raise ZeroDivisionError
