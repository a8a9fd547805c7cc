"""
The paper reproduced: every claim beside what is measured.

    python -m paper --quick --out look

Writes index.html, paper.json and the figures. Fails if a number is out of the range that its
section declares.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from nadrc_ros.atomic import write_whole
from nadrc_ros.cli.messages import error, say, warning
from nadrc_ros.cli.table import print_columns, Row
from paper.run import files, measure, sections, violations
from paper.section import Section
from paper.table1 import LABELS
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


def main(arguments: list[str] | None = None) -> int:
    """Measure all sections, write the article, and return 1 if a number is out of range."""
    given = _parser().parse_args(arguments)
    try:
        given.out.mkdir(parents=True, exist_ok=True)
    except OSError as failure:
        error(f'{failure.filename}: {failure.strerror}')
        return 1
    chosen = sections()
    with _Bar(chosen) as bar:
        results = measure(chosen, bar.tell, os.cpu_count() or 1, given.quick)
    for name, content in files(chosen, results, given.quick).items():
        write_whole(given.out / name, content)
    _print_table_1(results['table1'])
    say(f'article {given.out / "index.html"}, numbers {given.out / "paper.json"}')
    wrong = [] if given.quick else violations(chosen, results)
    for sentence in wrong:
        warning(f'out of range: {sentence}')
    if wrong:
        error(f'{len(wrong)} numbers are out of range')
    return 1 if wrong else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='python -m paper', description=__doc__.split('\n')[1])
    parser.add_argument(
        '--out', type=Path, default=Path('out/paper'), help='folder for article and figures'
    )
    parser.add_argument(
        '--quick', action='store_true', help='few seeds, seconds: for a look, nothing is checked'
    )
    return parser


class _Bar:
    """A progress bar over all sections, each an equal share."""

    def __init__(self, chosen: tuple[Section, ...]) -> None:
        columns = (BarColumn(), TimeElapsedColumn(), TextColumn('{task.description}'))
        self.progress = Progress(*columns)
        self.place = {section.name: i for i, section in enumerate(chosen)}
        self.task = self.progress.add_task('', total=len(chosen))

    def tell(self, section: Section, share: float) -> None:
        """Show how far a section is."""
        done = self.place[section.name] + share
        self.progress.update(self.task, completed=done, description=section.title)

    def __enter__(self) -> _Bar:
        self.progress.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.progress.update(self.task, description='')
        self.progress.stop()


def _print_table_1(result: dict[str, Any]) -> None:
    heads = ['paper']
    for name in result['scenarios']:
        heads += [name, f'{name} off [%]']
    rows = []
    for key, label in LABELS.items():
        numbers = [scenario['table1'][key] for scenario in result['scenarios'].values()]
        cells = [f'{numbers[0]["paper"]:g}']
        for number in numbers:
            spread = f' ± {number["std"]:.2g}' if number['std'] > 0.0 else ''
            cells += [f'{number["mean"]:.4g}{spread}', f'{100.0 * number["relative"]:+.1f}']
        rows.append(Row(label, '', cells))
    print_columns('Table I: paper, and calibrated scenarios with the difference', heads, rows)


if __name__ == '__main__':
    raise SystemExit(main())
