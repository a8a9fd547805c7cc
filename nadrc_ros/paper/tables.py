"""Table I beside the calibrated scenarios: the rows that terminal and article show."""

from __future__ import annotations

from typing import Any

import attrs
from nadrc_ros.paper.section import Result
from nadrc_ros.paper.table1 import LABELS


@attrs.frozen
class Table:
    """Scenario names, and rows of a label, the paper's number and a pair for each scenario."""

    scenarios: list[str]
    rows: list[list[str]]


def scenarios_of(result: Result) -> dict[str, dict[str, Any]]:
    """Return the numbers of Table I by scenario: paper, mean, std and relative, by key."""
    return {name: scenario['table1'] for name, scenario in result['scenarios'].items()}


def table_1(result: Result) -> Table:
    """Return Table I: ours as mean +- deviation over the seeds, and the relative difference."""
    scenarios = scenarios_of(result)
    rows = []
    for key, label in LABELS.items():
        found = [numbers[key] for numbers in scenarios.values()]
        cells = [label, f'{found[0]["paper"]:g}']
        for number in found:
            cells += [_mean(number), f'{100.0 * number["relative"]:+.1f} %'.replace('-', '−')]
        rows.append(cells)
    return Table(list(scenarios), rows)


def _mean(number: dict[str, float]) -> str:
    std = number['std']
    return f'{number["mean"]:.4g}' + (f' ± {std:.2g}' if std > 0.0 else '')
