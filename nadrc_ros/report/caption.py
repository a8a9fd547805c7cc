"""What to write over a picture or a table of a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from nadrc_ros.scenario import Scenario


class Mark(NamedTuple):
    """Something that happened at a time [s]."""

    time: float
    label: str


def title_of(name: str, scenario: Scenario) -> str:
    """Return one line that says what was run."""
    plant = scenario.plant.name or Path(scenario.plant.file).name
    variance = scenario.noise.variance
    noise = f'noise variance {variance:g}' if variance else 'no noise'
    return f'{name}: plant {plant}, {scenario.duration:g} s at {scenario.rate:g} Hz, {noise}'


def marks_of(scenario: Scenario) -> list[Mark]:
    """Return a mark for each retune, which says what changed."""
    return [
        Mark(retune.time, ', '.join(f'{key} {_short(v)}' for key, v in retune.settings.items()))
        for retune in scenario.retunes
    ]


def _short(value: object) -> str:
    return f'{value:g}' if isinstance(value, float) else str(value)
