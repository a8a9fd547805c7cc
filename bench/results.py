"""What the benches share: where figures and raw samples go, and the table of them."""

from __future__ import annotations

from collections.abc import Mapping
import json
from math import isfinite
from pathlib import Path
from typing import Any

from nadrc_ros.atomic import write_json
import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

FOLDER = Path(__file__).resolve().parents[1] / 'out' / 'bench'

Figures = Mapping[str, float]
Samples = Mapping[str, npt.ArrayLike]


def save(
    part: str,
    figures: Mapping[str, Any],
    samples: Samples,
    folder: Path = FOLDER,
) -> None:
    """Set what bench.json says under ``part``, and keep all samples in raw/<part>.npz."""
    (folder / 'raw').mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / 'raw' / f'{part}.npz', **dict(samples))  # type: ignore[arg-type]
    path = folder / 'bench.json'
    document: dict[str, Any] = {}
    if path.exists():
        document = json.loads(path.read_text(encoding='utf-8'))
    document[part] = _without_nan(figures)
    write_json(path, 'bench', document)


def _without_nan(figures: Any) -> Any:
    """Return figures with null where there is none: of a plant that nobody answered for."""
    if isinstance(figures, Mapping):
        return {key: _without_nan(value) for key, value in figures.items()}
    return None if isinstance(figures, float) and not isfinite(figures) else figures


def show(title: str, rows: Mapping[str, Figures], footnote: str) -> None:
    """Print a table: a row for each name, a column for each key of the first row."""
    table = Table(title=title, title_justify='left', box=None, pad_edge=False)
    table.add_column()
    columns = list(next(iter(rows.values())))
    for column in columns:
        table.add_column(column, justify='right')
    for name, row in rows.items():
        table.add_row(name, *(f'{row[column]:.3g}' for column in columns))
    console = Console(width=100)
    console.print(table)
    console.print(footnote + '\n', highlight=False)


def over(name: str, rows: Mapping[str, Figures], key: str) -> dict[str, dict[str, float]]:
    """Return the rows with one column more: ``key`` relative to that of the row ``name``."""
    base = rows[name][key]
    return {other: {**row, f'x {name}': row[key] / base} for other, row in rows.items()}
