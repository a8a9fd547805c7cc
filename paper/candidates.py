"""
The observers of the fair comparison: what is fixed, what is tuned, and the committed designs.

``config/paper_fair.yaml`` declares the experiment and the fixed settings of each observer, and
``designs.yaml`` beside this file what the tuning found, for each budget and each aim.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import find_scenario, load, Scenario
from nadrc_ros.yaml_text import read_yaml, write_yaml

SCENARIO = 'paper_fair'
FILE = Path(__file__).with_name('designs.yaml')
# Integral of u^2 over the noisy run that a design may spend, on average over seeds.
BUDGETS = (4.5, 8.0, 20.0, 100.0, 450.0)
# What is least within the budget: the ITAE with noise, or the ITAE without.
AIMS = ('noisy', 'clean')

# Range of each tuned number. All are searched on a logarithmic scale; the outer bandwidth as a
# share of the inner one.
RANGES = {
    'inner_bandwidth': (1.0, 200.0),
    'outer_share': (0.05, 2.0),
    'bandwidth_ratio': (0.05, 2.0),
    'controller_bandwidth': (0.3, 300.0),
    'eso_delta': (1e-3, 1.0),
}
# With these a candidate comes close to the simpler one that lacks the number.
INERT = {'bandwidth_ratio': RANGES['bandwidth_ratio'][0], 'eso_delta': RANGES['eso_delta'][1]}


@attrs.frozen(kw_only=True)
class Candidate:
    """
    One observer: its name in the scenario, a label, and which numbers are tuned.

    ``simpler`` names one that it contains as a limiting case.
    """

    name: str
    label: str
    tuned: tuple[str, ...]
    levels: int = 1
    simpler: str = ''

    def values(self, point: list[float]) -> dict[str, Any]:
        """
        Return settings from logarithms of the tuned numbers and, with several levels, a level.

        They are rounded to what a file shows, so that what was tuned is what is committed.
        """
        numbers = {
            name: float(f'{10.0**exponent:.6g}') for name, exponent in zip(self.tuned, point)
        }
        if 'outer_share' in numbers:
            outer = numbers.pop('outer_share') * numbers['inner_bandwidth']
            numbers['outer_bandwidth'] = float(f'{outer:.6g}')
        if self.levels == 1:
            return numbers
        return {**numbers, 'feedback_level': str(round(point[-1]))}


ONE = ('inner_bandwidth', 'controller_bandwidth')
TWO = ('inner_bandwidth', 'outer_share', 'controller_bandwidth')
MORE = ('inner_bandwidth', 'outer_share', 'bandwidth_ratio', 'controller_bandwidth')
CANDIDATES = (
    Candidate(name='conventional', label='C-ADRC', tuned=ONE),
    Candidate(name='generalized', label='generalized, 2 extended states', tuned=ONE),
    Candidate(name='nested_2', label='nested, 2 levels', tuned=TWO, levels=2),
    Candidate(name='nested_3', label='nested, 3 levels', tuned=MORE, levels=3, simpler='nested_2'),
    Candidate(name='nested_4', label='nested, 4 levels', tuned=MORE, levels=4, simpler='nested_3'),
    Candidate(name='printed', label='eq. (20) as printed', tuned=TWO, levels=2),
    Candidate(name='cascade_2', label='cascade, 2 levels', tuned=TWO, levels=2),
    Candidate(
        name='nonlinear_1',
        label='nonlinear, 1 level',
        tuned=(*ONE, 'eso_delta'),
        simpler='conventional',
    ),
    Candidate(
        name='nonlinear_2',
        label='nonlinear nested, 2 levels',
        tuned=(*TWO, 'eso_delta'),
        levels=2,
        simpler='nested_2',
    ),
)

# By candidate, aim and budget, in the order of BUDGETS.
Designs = dict[str, dict[str, list[dict[str, Any]]]]


def load_scenario() -> Scenario:
    """Return the experiment with the fixed settings of each candidate."""
    return load(find_scenario(SCENARIO))


def load_designs() -> Designs:
    """Return the committed designs."""
    designs: Designs = read_yaml(FILE.read_text(encoding='utf-8'))
    return designs


def dump_designs(designs: Designs) -> str:
    """Return the text of ``designs.yaml``."""
    budgets = ', '.join(f'{budget:g}' for budget in BUDGETS)
    head = (
        f'# Made by retune() in the experiment of config/{SCENARIO}.yaml: the least ITAE, with\n'
        f'# noise or without, for a noisy ISU up to each of {budgets}.\n'
    )
    return head + write_yaml(designs)


def designed(scenario: Scenario, name: str, values: dict[str, Any]) -> ControllerSettings:
    """Return the settings of a candidate with the numbers of a design."""
    return attrs.evolve(scenario.controllers[name], **values)
