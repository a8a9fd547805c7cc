"""What docs/files.md says of the files of a command, and whether a file that was written is so."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import csv
import json
from pathlib import Path
import re
from typing import Any

from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.recording import JOINED

PAGE = (Path(__file__).resolve().parents[1] / 'docs' / 'files.md').read_text(encoding='utf-8')


def names(heading: str) -> list[str]:
    """Return what the first column of a section names."""
    (section,) = re.findall(rf'^## {re.escape(heading)}\n(.*?)(?=^## |\Z)', PAGE, re.M | re.S)
    found: list[str] = re.findall(r'^\| `([^`]+)` \|', section, re.M)
    assert found, heading
    return found


KNOWN = {
    'figure': names('Figures of merit'),
    'margin': names('Margins'),
    'setting': list(declared(ControllerSettings)),
}


def pattern(name: str) -> re.Pattern[str]:
    """Return what a name such as `runs.<controller>.<figure>` or `scenario.*` stands for."""
    text = re.escape(name).replace(r'\.\*', r'(\..+)?')
    for kind in re.findall('<(\\w+)>', name):
        known = KNOWN.get(kind)
        text = text.replace(f'<{kind}>', f'({"|".join(known)})' if known else r'.+')
    return re.compile(text)


def paths(value: Any, path: str = '') -> Iterator[str]:
    """Yield the keys of a document as the page writes them."""
    if isinstance(value, dict) and value:
        for key, item in value.items():
            yield from paths(item, f'{path}.{key}' if path else key)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for item in value:
            yield from paths(item, path + '[]')
    else:
        yield path


def differences(heading: str, found: Iterable[str]) -> list[str]:
    """Return what a file has and the page does not, or the other way."""
    found, documented = set(found), names(heading)
    patterns = {name: pattern(name) for name in documented}
    wrong = [
        f'{heading}: {path} is not on the page'
        for path in sorted(found)
        if not any(each.fullmatch(path) for each in patterns.values())
    ]
    for name, each in patterns.items():
        parent = name.rpartition('.')[0]  # null, or empty, it has no children
        below = any(other.startswith(name + '.') for other in patterns)
        if not (below or parent in found or any(map(each.fullmatch, found))):
            wrong.append(f'{heading}: {name} is not in the file')
    return wrong


def document(path: Path, kind: str) -> set[str]:
    """Return the keys of a JSON file of that kind, which the page must name."""
    content = json.loads(path.read_text(encoding='utf-8'))
    said = next(iter(content.items()))
    assert said == ('format', f'nadrc/{kind} 1') and f'`{said[1]}`' in PAGE
    return {*paths(content)} - {'format'}


def lines(path: Path) -> set[str]:
    """Return the keys of all lines of a file of JSON lines."""
    records = path.read_text(encoding='utf-8').splitlines()
    return {key for record in records for key in paths(json.loads(record))}


def columns(path: Path) -> list[str]:
    """Return the headings of a CSV file."""
    with path.open(encoding='utf-8', newline='') as file:
        return next(csv.reader(file))


def files_of(writer: str) -> set[str]:
    """Return the files that the page says one writes, but for those with a name of their own."""
    (row,) = re.findall(rf'^\| {re.escape(writer)} \| (.*) \|$', PAGE, re.M)
    return {name for name in re.findall(r'`([^`]*\.\w+)`', row) if '<' not in name}


def recording(folder: Path) -> list[str]:
    """Return in what the folder of a recorder in real time differs from the page."""
    assert {path.name for path in folder.iterdir()} == files_of('`recorder`')
    return [
        *differences('`run.json`', document(folder / 'run.json', 'run')),
        *differences('`about.json`', document(folder / 'about.json', 'about')),
        *differences('`summary.json`', document(folder / 'summary.json', 'summary')),
        *differences('`samples.csv`', {*columns(folder / 'samples.csv'), *JOINED}),
        *differences('`parameters.jsonl`', lines(folder / 'parameters.jsonl')),
        *differences('`events.jsonl`', lines(folder / 'events.jsonl')),
    ]
