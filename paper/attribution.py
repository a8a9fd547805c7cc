"""
(c) Which part of N-ADRC brings its improvement, in the calibrated scenarios.

N-ADRC differs from C-ADRC in two things: the law takes the states of the outer observer, and the
command subtracts the outer disturbance estimate too. Each is taken alone, all gains being equal.
Beside them each controller at its own best bandwidth: that of the scenarios is far from it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import attrs
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import find_scenario, load, Scenario
from paper.drawing import CONVENTIONAL, GREY, in_style, NESTED, panels
from paper.runs import metrics_of, statistics, without_noise
from paper.section import Finding, Findings, Result, Section, Tell
from paper.table1 import SCENARIOS

SEEDS, FEW_SEEDS = 16, 4
# Another set of seeds finds the best bandwidths, on a grid.
SEARCH_SEEDS = range(2001, 2005)
BANDWIDTHS = (5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 14.0, 17.0, 20.0, 30.0)  # rad/s
FIGURES_OF_MERIT = ('clean_itae', 'clean_isu', 'noisy_itae', 'noisy_isu')
LABELS = {
    'c_adrc': 'C-ADRC',
    'subtraction': 'second subtraction only',
    'states': 'outer states only',
    'n_adrc': 'N-ADRC',
    'c_best': 'C-ADRC at its best bandwidth',
    'n_best': 'N-ADRC at its best equal bandwidths',
}
# Declared: shares of the improvement of N-ADRC in the noisy ITAE.
STATES_AT_LEAST = 0.9
SUBTRACTION_AT_MOST = 0.1


def measure(tell: Tell, jobs: int, seeds: int = SEEDS) -> Result:
    """Run the parts of N-ADRC in each scenario."""
    found: dict[str, Any] = {}
    for i, (name, file) in enumerate(SCENARIOS.items()):
        tell(i / len(SCENARIOS))
        scenario = load(find_scenario(file))
        variants = parts(scenario)
        sweep = {which: over_bandwidth(scenario, which, jobs) for which in ('c_adrc', 'n_adrc')}
        for which, rows in sweep.items():
            best = min(rows, key=lambda row: row['noisy_itae'])
            variants[f'{which[0]}_best'] = at(scenario.controllers[which], best['bandwidth'])
        rows = merits(scenario, list(variants.values()), range(seeds), jobs)
        numbers = dict(zip(variants, rows))
        for label, settings in variants.items():
            numbers[label]['inner_bandwidth'] = settings.inner_bandwidth
        found[name] = {
            'scenario': file,
            'variants': numbers,
            'shares': {
                part: shares(numbers, part) for part in ('subtraction', 'states', 'n_adrc')
            },
            'over_bandwidth': sweep,
        }
    return {'seeds': seeds, 'scenarios': found}


def parts(scenario: Scenario) -> dict[str, ControllerSettings]:
    """Return the two controllers of the scenario, and each of the differences alone."""
    whole = scenario.controllers['n_adrc']
    return {
        'c_adrc': scenario.controllers['c_adrc'],
        'subtraction': attrs.evolve(whole, feedback_level='inner'),
        'states': attrs.evolve(whole, structure='filtered'),
        'n_adrc': whole,
    }


def at(settings: ControllerSettings, bandwidth: float) -> ControllerSettings:
    """Return the controller with that bandwidth of all its observers."""
    return attrs.evolve(settings, inner_bandwidth=bandwidth, outer_bandwidth=bandwidth)


def over_bandwidth(scenario: Scenario, which: str, jobs: int) -> list[dict[str, float]]:
    """Return noisy ITAE and ISU of a controller over the bandwidth of its observers."""
    settings = [at(scenario.controllers[which], bandwidth) for bandwidth in BANDWIDTHS]
    runs = metrics_of(scenario.experiment, settings, SEARCH_SEEDS, jobs)
    return [
        {
            'bandwidth': bandwidth,
            'noisy_itae': statistics([run.itae for run in each])['mean'],
            'noisy_isu': statistics([run.isu for run in each])['mean'],
        }
        for bandwidth, each in zip(BANDWIDTHS, runs)
    ]


def merits(
    scenario: Scenario, settings: Sequence[ControllerSettings], seeds: Sequence[int], jobs: int
) -> list[dict[str, float]]:
    """Return ITAE and ISU of each controller, without noise and on average over the seeds."""
    experiment = scenario.experiment
    clean = metrics_of(without_noise(experiment), settings, [0], jobs)
    noisy = metrics_of(experiment, settings, seeds, jobs)
    return [
        {
            'clean_itae': silent.itae,
            'clean_isu': silent.isu,
            'noisy_itae': statistics([run.itae for run in runs])['mean'],
            'noisy_isu': statistics([run.isu for run in runs])['mean'],
        }
        for (silent,), runs in zip(clean, noisy)
    ]


def shares(numbers: Mapping[str, Mapping[str, float]], part: str) -> dict[str, float]:
    """Return which share of the change from C-ADRC to N-ADRC a part makes by itself."""
    return {
        merit: (numbers['c_adrc'][merit] - numbers[part][merit])
        / (numbers['c_adrc'][merit] - numbers['n_adrc'][merit])
        for merit in FIGURES_OF_MERIT
    }


@in_style
def figures(result: Result) -> dict[str, Figure]:
    """Draw the noisy ITAE of the parts, and of both controllers over the bandwidth."""
    scenarios = result['scenarios']
    figure, axes = panels(1, 2, 3.6, width_ratios=(3, 2))
    bars, curves = axes[0]
    height = 0.8 / len(LABELS)
    ticks, labels = [], []
    colours = {'c': CONVENTIONAL, 'n': NESTED, 's': GREY}
    for i, (name, found) in enumerate(scenarios.items()):
        for j, (key, label) in enumerate(LABELS.items()):
            place = i + (j - 0.5 * len(LABELS)) * height
            value = found['variants'][key]['noisy_itae']
            bars.barh(place, value, 0.9 * height, color=colours[key[0]], zorder=2)
            ticks.append(place)
            labels.append(f'{name}: {label}')
    bars.set_yticks(ticks, labels, fontsize=7)
    bars.invert_yaxis()
    bars.set_xlabel('ITAE with noise')
    for which, colour in (('c_adrc', CONVENTIONAL), ('n_adrc', NESTED)):
        for (name, found), style in zip(scenarios.items(), ('-', '--', ':')):
            rows = found['over_bandwidth'][which]
            curves.plot(
                [row['bandwidth'] for row in rows],
                [row['noisy_itae'] for row in rows],
                color=colour,
                linestyle=style,
                label=f'{name}: {LABELS[which]}',
            )
    curves.set_xscale('log')
    curves.set_yscale('log')
    curves.xaxis.set(major_locator=FixedLocator((5, 10, 20, 30)), minor_locator=NullLocator())
    curves.yaxis.set(major_locator=FixedLocator((2, 3, 5, 10, 20)), minor_locator=NullLocator())
    for axis in (curves.xaxis, curves.yaxis):
        axis.set_major_formatter('{x:g}')
    curves.set_xlabel('bandwidth of all observers [rad/s]')
    curves.set_ylabel('ITAE with noise')
    curves.legend(fontsize=7)
    return {'attribution': figure}


def findings(result: Result) -> Findings:
    """Say which part brings what, and what each controller comes to at its best bandwidth."""
    scenarios = result['scenarios']

    def shares_of(part: str, merit: str, names: Iterable[str] = SCENARIOS) -> list[float]:
        return [scenarios[name]['shares'][part][merit] for name in names]

    def best(which: str, merit: str) -> list[float]:
        return [found['variants'][f'{which}_best'][merit] for found in scenarios.values()]

    def saved(merit: str) -> list[float]:
        return [1.0 - n / c for n, c in zip(best('n', merit), best('c', merit))]

    alone = {'G': 'subtraction', 'P': 'states', 'V': 'states'}
    other = {'subtraction': 'states', 'states': 'subtraction'}
    return {
        'states': Finding(
            says='share of the noisy improvement that the outer states bring alone',
            values=shares_of('states', 'noisy_itae'),
            low=STATES_AT_LEAST,
        ),
        'subtraction': Finding(
            says='share of the noisy improvement that the second subtraction brings alone',
            values=shares_of('subtraction', 'noisy_itae'),
            high=SUBTRACTION_AT_MOST,
        ),
        'clean_part': Finding(
            says='share of the noise-free improvement of the part that brings it (G: subtraction, '
            'P and V: states)',
            values=[s for n, part in alone.items() for s in shares_of(part, 'clean_itae', [n])],
            low=STATES_AT_LEAST,
        ),
        'clean_other': Finding(
            says='share of the noise-free improvement of the other part',
            values=[
                s for n, part in alone.items() for s in shares_of(other[part], 'clean_itae', [n])
            ],
            high=SUBTRACTION_AT_MOST,
        ),
        'c_itae': Finding(
            says='noisy ITAE of C-ADRC at its best bandwidth over that in the scenario',
            values=[
                found['variants']['c_best']['noisy_itae']
                / found['variants']['c_adrc']['noisy_itae']
                for found in scenarios.values()
            ],
            high=0.8,
        ),
        'c_isu': Finding(
            says='noisy ISU of C-ADRC at its best bandwidth over that of N-ADRC in the scenario',
            values=[
                found['variants']['c_best']['noisy_isu'] / found['variants']['n_adrc']['noisy_isu']
                for found in scenarios.values()
            ],
            high=0.2,
        ),
        'itae_saved': Finding(
            says='share of the noisy ITAE that N-ADRC saves, both at their best bandwidth',
            values=saved('noisy_itae'),
            low=0.0,
            high=0.6,
        ),
        'isu_saved': Finding(
            says='share of the noisy ISU that N-ADRC saves, both at their best bandwidth',
            values=saved('noisy_isu'),
            low=0.0,
            high=0.9,
        ),
    }


SECTION = Section(
    name='attribution',
    title='Where the improvement comes from',
    measure=measure,
    figures=figures,
    findings=findings,
    quick=partial(measure, seeds=FEW_SEEDS),
)
