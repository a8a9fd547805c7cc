"""Text on a terminal breaks between words, whatever its width; elsewhere a line stays one."""

from __future__ import annotations

from collections.abc import Sequence
import os
from shlex import join, quote
from textwrap import wrap
from typing import TextIO

_WITHOUT_A_SIZE = 80


def columns(stream: TextIO | None) -> int | None:
    """Return how wide the terminal behind a stream is; None where there is none."""
    if stream is None or not stream.isatty():
        return None
    said = os.environ.get('COLUMNS', '')
    if said.isdecimal() and int(said):
        return int(said)
    try:
        return os.get_terminal_size(stream.fileno()).columns or _WITHOUT_A_SIZE
    except OSError:
        return _WITHOUT_A_SIZE


def wrapped(text: str, width: int | None, indent: str = '') -> str:
    """Return text whose lines are as wide at most, if no word is longer; ``indent`` hangs."""
    if width is None:
        return text
    return '\n'.join(
        part
        for line in text.split('\n')
        for part in wrap(
            line,
            width,
            subsequent_indent=indent,
            break_long_words=False,
            break_on_hyphens=False,
        )
        or ['']
    )


def command_line(words: Sequence[str], width: int | None, begin: str = '') -> str:
    r"""Return a line to be copied, after ``begin``; where too long it goes on after a ``\``."""
    whole = begin + join(words)
    if width is None or len(whole) <= width:
        return whole
    lines = [begin + quote(words[0])]
    for word in map(quote, words[1:]):
        if len(lines[-1]) + len(word) + len('  \\') <= width:
            lines[-1] += f' {word}'
        else:
            lines.append(f'    {word}')
    return ' \\\n'.join(lines)
