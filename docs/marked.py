"""Generated parts of a page that is otherwise written by hand: each stands between two marks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def filled(page: Path, parts: Mapping[str, str]) -> str:
    """Return the page with ``<!-- name -->`` to ``<!-- end of name -->`` as they have to be."""
    text = page.read_text(encoding='utf-8')
    for name, part in parts.items():
        marks = f'<!-- {name} -->', f'<!-- end of {name} -->'
        before, rest = text.split(marks[0])
        text = f'{before}{marks[0]}\n\n{part}\n\n{marks[1]}{rest.split(marks[1])[1]}'
    return text
