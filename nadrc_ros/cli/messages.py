"""What `nadrc` says besides tables: results on stdout, the rest on stderr with its kind before."""

from __future__ import annotations

from collections.abc import Sequence
from os import environ
import sys
from typing import TextIO

from nadrc_ros.terminal import columns, command_line, wrapped
import typer

_COLOURS = {'error': 'red', 'warning': 'yellow', 'note': 'cyan'}


def say(text: str, indent: str = '') -> None:
    """Write a sentence of the result, with ``indent`` before its lines but the first."""
    typer.echo(wrapped(text, columns(sys.stdout), indent))


def say_command(words: Sequence[str], begin: str = '') -> None:
    """Write a command that can be copied from any terminal."""
    typer.echo(command_line(words, columns(sys.stdout), begin))


def error(text: str) -> None:
    """Say why there is no result."""
    _tell('error', text)


def warning(text: str) -> None:
    """Say what is wrong with a result, or what of the request was left out."""
    _tell('warning', text)


def note(text: str) -> None:
    """Say how the request was understood, or how far it is."""
    _tell('note', text)


def colourful(stream: TextIO) -> bool:
    """Tell whether a stream shows colours and its reader wants them."""
    return stream.isatty() and not environ.get('NO_COLOR') and environ.get('TERM') != 'dumb'


def _tell(kind: str, text: str) -> None:
    said = wrapped(f'{kind}: {text}', columns(sys.stderr)).removeprefix(kind)
    head = typer.style(kind, fg=_COLOURS[kind], bold=True) if colourful(sys.stderr) else kind
    typer.echo(head + said, err=True)
