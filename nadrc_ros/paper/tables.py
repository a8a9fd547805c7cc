"""Table I beside the calibrated scenarios: the rows that terminal and article show."""

from __future__ import annotations

from typing import Any

import attrs
from nadrc_ros.paper.section import Result

# Key in the result, label.
NUMBERS = {
    'c_clean_itae': 'C-ADRC, no noise, ITAE',
    'c_clean_isu': 'C-ADRC, no noise, ISU',
    'n_clean_itae': 'N-ADRC, no noise, ITAE',
    'n_clean_isu': 'N-ADRC, no noise, ISU',
    'c_noisy_itae': 'C-ADRC, noise, ITAE',
    'c_noisy_isu': 'C-ADRC, noise, ISU',
    'n_noisy_itae': 'N-ADRC, noise, ITAE',
    'n_noisy_isu': 'N-ADRC, noise, ISU',
    'e3_itae': 'ITAE of e₃',
    'zeta3_itae': 'ITAE of ζ₃',
}


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
    for key, label in NUMBERS.items():
        found = [numbers[key] for numbers in scenarios.values()]
        cells = [label, f'{found[0]["paper"]:g}']
        for number in found:
            cells += [_mean(number), f'{100.0 * number["relative"]:+.1f} %']
        rows.append(cells)
    return Table(list(scenarios), rows)


def reduction(numbers: dict[str, Any], case: str, figure: str, of: str = 'mean') -> float:
    """Return by how much N-ADRC is below C-ADRC, as a share."""
    nested, single = (float(numbers[f'{letter}_{case}_{figure}'][of]) for letter in 'nc')
    return 1.0 - nested / single


def _mean(number: dict[str, float]) -> str:
    std = number['std']
    return f'{number["mean"]:.4g}' + (f' ± {std:.2g}' if std > 0.0 else '')
