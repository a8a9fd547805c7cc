"""Follows a tutorial by its text: saves its files, runs its commands, compares what they print."""

from __future__ import annotations

from doctest import ELLIPSIS, OutputChecker
import os
from pathlib import Path
import re
import subprocess
import sys

ROOT = Path(__file__).resolve().parents[1]
_BLOCK = re.compile(r'^```(\w+)\n(.*?)^```', re.MULTILINE | re.DOTALL)
# What the page has its reader source, of the tree that is tested.
_SOURCED = (
    f'set -e; python() {{ {sys.executable} "$@"; }}; nadrc() {{ python -m nadrc_ros.cli "$@"; }}\n'
)


def part(page: str, begin: str, end: str) -> str:
    """Return what a page of docs/ says from one heading to another."""
    text = (ROOT / 'docs' / page).read_text(encoding='utf-8')
    return text[text.index(begin) : text.index(end)]


def follow(text: str, folder: Path, patience: int = 1) -> int:
    """
    Do in ``folder`` what a text says, and return how many outputs were compared.

    A block that begins with ``# NAME`` is a file to save, ``bash`` is run, ``text`` is what that
    prints; ``...`` in it stands for anything. A command that fails is tried so often.
    """
    compared, printed = 0, ''
    for kind, block in _BLOCK.findall(text):
        name = re.match(r'# (\S+\.\w+)\n', block)
        if name is not None:
            (folder / name[1]).write_text(block, encoding='utf-8')
        elif kind == 'bash':
            printed = _run(block, folder, patience)
        elif kind == 'text':
            assert OutputChecker().check_output(block, printed, ELLIPSIS), printed
            compared += 1
    return compared


def _run(commands: str, folder: Path, patience: int) -> str:
    """Return what commands print; they have to succeed."""
    done = subprocess.run(
        ['bash', '-c', _SOURCED + commands],
        check=False,
        cwd=folder,
        env={
            **os.environ,
            'COLUMNS': '100',
            'PYTHONPATH': f'{ROOT}:{os.environ.get("PYTHONPATH", "")}',
        },
        capture_output=True,
        text=True,
        timeout=120,
    )
    if done.returncode and patience > 1:
        return _run(commands, folder, patience - 1)
    assert done.returncode == 0, done.stderr
    return done.stdout
