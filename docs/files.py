"""Writes the tables of docs/files.md that repeat declarations: `python docs/files.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from marked import filled
from nadrc_ros.adrc.fields import declared
from nadrc_ros.records.recording import RunSettings
from nadrc_ros.tuning.design.requirements import Requirements
from nadrc_ros.tuning.search.settings import TuneSettings

PAGE = Path(__file__).with_name('files.md')


def table(cls: type[Any], below: str) -> str:
    """Return the declared fields of a class as a table of the keys below one."""
    rows = [
        f'| `{below}{name}` | {field.unit} | {field.description.replace("|", "&#124;")} |'
        for name, field in declared(cls).items()
    ]
    return '\n'.join(['| key | unit | meaning |', '|---|---|---|', *rows])


def page() -> str:
    """Return the whole page."""
    parts = {
        'run': table(RunSettings, ''),
        'requirements': table(Requirements, 'requirements.'),
        'tuning': table(TuneSettings, 'tuning.'),
    }
    return filled(PAGE, parts)


if __name__ == '__main__':
    PAGE.write_text(page(), encoding='utf-8')
