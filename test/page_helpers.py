"""The page of a report, as a test reads it."""

from __future__ import annotations

from base64 import b64decode
from functools import cached_property
import gzip
from html.parser import HTMLParser
import json
import re
from typing import Any

from bokeh.document import Document
from bokeh.models.annotations import Label
import numpy as np

# Elements without an end.
VOID = {'meta', 'link', 'input', 'br', 'img', 'line'}


def unpacked(page: str, name: str) -> bytes:
    """Return what a page has under gzip in base 64."""
    found = re.search(f'id="{name}">(.*?)</script>', page, re.DOTALL)
    assert found
    return gzip.decompress(b64decode(found[1]))


class Page(HTMLParser):
    """What a browser would make of a page: its text, and what may load or run something."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.source = source
        self.text = ''
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self._inside: list[str] = []
        self.feed(source)
        self.data: dict[str, Any] = json.loads(unpacked(source, 'data'))
        self.columns = self._columns()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self._inside.append(tag)

    def handle_endtag(self, tag: str) -> None:
        self._inside.pop()

    def handle_data(self, data: str) -> None:
        if self._inside and self._inside[-1] not in ('script', 'style'):
            self.text += data

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def _columns(self) -> list[Any]:
        found, rest = [], unpacked(self.source, 'samples')
        for kind, count in self.data['columns']:
            wide = 4 if kind == 'single' else 8
            size = wide * count
            planes, rest = np.frombuffer(rest[:size], np.uint8), rest[size:]
            numbers = planes.reshape(wide, count).T.copy().view(f'<f{wide}')[:, 0]
            found.append(np.cumsum(numbers) / 1e9 if kind == 'time' else numbers)
        assert not rest
        return found

    def column(self, name: str, run: int = 0) -> Any:
        return self.columns[self.data['runs'][run]['columns'][name]]

    @cached_property
    def models(self) -> list[Any]:
        documents = map(Document.from_json, self.data['plots'])
        return [model for document in documents for model in document.models]

    def lines(self, name: str) -> list[Any]:
        """Return the lines of a column."""
        return [each for each in self.models if each.tags[1:2] == [name]]

    def labels(self) -> list[tuple[Any, Any]]:
        return [(each.text, each.x) for each in self.models if isinstance(each, Label)]

    def words(self) -> str:
        """Return the text with one space between words."""
        return ' '.join(self.text.split())
