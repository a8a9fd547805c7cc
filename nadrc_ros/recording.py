"""A recorded run: a folder with ``samples.csv``, written as it comes, and ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
import json
from math import isnan, nan
import os
from pathlib import Path
from typing import Any

SAMPLES = 'samples.csv'
SUMMARY = 'summary.json'


class RunFolder:
    """
    A new folder for one run; an existing one is never touched.

    Parameters
    ----------
    directory
        Where the folder is made; made itself if need be.
    columns
        Names of the numbers of a row.

    Raises
    ------
    OSError
        When a folder or a file cannot be made, or the disk is full.

    """

    def __init__(self, directory: Path, columns: Sequence[str]) -> None:
        self.path = _new_folder(directory)
        self._file = (self.path / SAMPLES).open('x', encoding='utf-8')
        self._file.write(','.join(columns) + '\n')
        self.flush()

    def write(self, row: Sequence[float]) -> None:
        """Append one row; what is not known (nan) is left empty. Numbers read back to the bit."""
        self._file.write(','.join('' if isnan(x) else repr(x) for x in row) + '\n')

    def flush(self) -> None:
        """Hand all rows to the operating system: they survive the death of the process."""
        self._file.flush()

    def close(self) -> None:
        """Close the samples."""
        self._file.close()

    def write_summary(self, summary: Mapping[str, Any]) -> None:
        """Write or replace the summary in one step: it is never half there."""
        write_json(self.path / SUMMARY, summary)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write ``content`` to ``path`` in one step; an old file stays until the new one is whole."""
    partial = path.with_name(path.name + '.part')
    partial.write_text(json.dumps(content, indent=2) + '\n', encoding='utf-8')
    os.replace(partial, path)


def read_samples(folder: Path) -> dict[str, list[float]]:
    """Return the columns of ``samples.csv``; a row that was cut short is left out."""
    with (folder / SAMPLES).open(encoding='utf-8') as file:
        names = file.readline().rstrip('\n').split(',')
        rows = [line.rstrip('\n').split(',') for line in file if line.endswith('\n')]
    whole = [row for row in rows if len(row) == len(names)]
    return {
        name: [float(row[i]) if row[i] else nan for row in whole] for i, name in enumerate(names)
    }


def _new_folder(directory: Path) -> Path:
    directory.mkdir(parents=True, exist_ok=True)
    name = datetime.now().strftime('%Y%m%d-%H%M%S')
    attempt = 1
    while True:
        path = directory / (name if attempt == 1 else f'{name}-{attempt}')
        try:
            path.mkdir()
            return path
        except FileExistsError:
            attempt += 1
