"""Writes docs/commands.md, every command of `nadrc` with its options, from the command line."""

from __future__ import annotations

from inspect import cleandoc
from pathlib import Path
import re
from typing import Any

from nadrc_ros.cli.app import app
import typer

PAGE = Path(__file__).with_name('commands.md')
INTRODUCTION = """# Command line

Here you find every command of `nadrc` with its options, as `nadrc COMMAND --help` shows them. Made
from the code by `python docs/commands.py`.

`nadrc` is `.venv/bin/nadrc` after `make demo` or `make test`, and on the `PATH` of a sourced
workspace or a pip install. The exit code is 0, 1 if something went wrong, 2 for an option or a
file that makes no sense, and 130 after Ctrl-C.
"""


def page() -> str:
    """Return the whole page."""
    group: Any = typer.main.get_command(app)
    commands = [section(name, command) for name, command in sorted(group.commands.items())]
    return '\n'.join([INTRODUCTION, *commands])


def section(name: str, command: Any) -> str:
    """Return what one command does, an example, and its arguments and options."""
    context = command.make_context(name, [], resilient_parsing=True)
    text, _, example = cleandoc(command.help).partition('Example: ')
    examples = re.split(r',\s+(?:or|and then)\s+', example.strip().rstrip('.'))
    records = [each.get_help_record(context) for each in command.get_params(context)]
    rows = [
        f'| `{option.replace("|", "&#124;")}` | {cell(said)} |'
        for option, said in filter(None, records)
        if option != '--help'
    ]
    parts = [f'## nadrc {name}', text.strip(), '\n'.join(['```bash', *examples, '```'])]
    return '\n\n'.join([*parts, '\n'.join(['| option | meaning |', '|---|---|', *rows])]) + '\n'


def cell(text: str) -> str:
    """Return a help text as a cell of a table, in which brackets and bars are only characters."""
    return re.sub(r'([\[\]|<>*])', r'\\\1', ' '.join(text.split()))


if __name__ == '__main__':
    PAGE.write_text(page(), encoding='utf-8')
