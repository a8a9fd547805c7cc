"""Text on a terminal breaks between words, whatever its width; elsewhere a line stays one."""

from __future__ import annotations

from collections.abc import Sequence
import os
import re
from shlex import join, quote
from textwrap import wrap
from typing import TextIO

_WITHOUT_A_SIZE = 80
# Between a number and its unit no line ends.
_UNIT = re.compile(r'(?<=\d) (?=%|(?:[mun]?s|Hz|rad/s|periods?)\b)')
_BOUND = '\N{NO-BREAK SPACE}'


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
        part.replace(_BOUND, ' ')
        for line in text.split('\n')
        for part in wrap(
            _UNIT.sub(_BOUND, line),
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
    parts: list[str] = []
    for word, before in zip(words[1:], words):
        if before.startswith('-') and not word.startswith('-'):
            parts[-1] += f' {quote(word)}'  # a value stays with its option
        else:
            parts.append(quote(word))
    for word in parts:
        if len(lines[-1]) + len(word) + len('  \\') <= width:
            lines[-1] += f' {word}'
        else:
            lines.append(f'    {word}')
    return ' \\\n'.join(lines)
