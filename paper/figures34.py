"""(b) Figures 3 and 4 of the paper in calibrated scenario V: responses and estimation errors."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from nadrc_ros.scenario import find_scenario, load, Scenario
from nadrc_ros.simulation import simulate
import numpy as np
from paper.drawing import CONVENTIONAL, in_style, INK, NESTED, panels, thinned
from paper.published import FIGURE_4
from paper.section import Finding, Findings, Result, Section, Tell

SCENARIO = 'paper_v'
CONTROLLERS = {'c': 'c_adrc', 'n': 'n_adrc'}
CASES = ('clean', 'noisy')
LABELS = {'c': 'C-ADRC', 'n': 'N-ADRC'}
COLOURS = {'c': CONVENTIONAL, 'n': NESTED}
# The paper's reduction of the ITAE from e3 to zeta3.
PAPER_REDUCTION = 1.0 - FIGURE_4['zeta3_itae'] / FIGURE_4['e3_itae']
TOLERANCE = 0.05


def measure(tell: Tell, jobs: int) -> Result:
    """Run both controllers once, without and with noise (the seed of the scenario)."""
    scenario = load(find_scenario(SCENARIO))
    curves, metrics, errors = {}, {}, {}
    for i, case in enumerate(CASES):
        for j, (letter, name) in enumerate(CONTROLLERS.items()):
            found = _run(scenario, name, case)
            columns = {
                'time': found.time,
                'reference': found.reference,
                'output': found.output,
                'error': found.tracking - found.output,
                'command': found.command,
            }
            curves[f'{letter}_{case}'] = thinned(columns)
            metrics[f'{letter}_{case}'] = {'itae': found.metrics.itae, 'isu': found.metrics.isu}
            if letter == 'n':
                errors[case] = _estimation_errors(found)
            tell((2 * i + j + 1) / 4)
    return {
        'scenario': SCENARIO,
        'seed': scenario.noise.seed,
        'metrics': metrics,
        'figure_4': {
            case: {key: found[key] for key in ('e3_itae', 'zeta3_itae', 'reduction')}
            for case, found in errors.items()
        },
        'curves': {**curves, 'errors': errors['clean']['curves']},
    }


def _run(scenario: Scenario, name: str, case: str) -> simulate.Result:
    if case == 'clean':
        scenario = scenario.changed(noise_variance=0.0)
    settings = scenario.controllers[name]
    return simulate.simulate(scenario.experiment, settings, compiled=True)


def _estimation_errors(found: simulate.Result) -> dict[str, Any]:
    """Return e3 = L - d_1, eq. (6), and zeta3 = e3 - d_2, eq. (24) with the x3 of eq. (19)."""
    e3 = found.total_disturbance - found.disturbances[:, 0]
    zeta3 = found.total_disturbance - found.disturbance_estimate
    h = float(found.time[1])
    itae = [float(h * np.sum(found.time * np.abs(error))) for error in (e3, zeta3)]
    return {
        'e3_itae': itae[0],
        'zeta3_itae': itae[1],
        'reduction': 1.0 - itae[1] / itae[0],
        'curves': thinned({'time': found.time, 'e3': e3, 'zeta3': zeta3}),
    }


@in_style
def figures(result: Result) -> dict[str, Figure]:
    """Draw figures 3 and 4."""
    return {'figure_3': _figure_3(result['curves']), 'figure_4': _figure_4(result)}


def _figure_3(curves: Any) -> Figure:
    figure, axes = panels(3, 2, 5.6, sharex=True, sharey='row')
    for column, case in enumerate(CASES):
        for letter in ('c', 'n'):  # N-ADRC, the calmer one, on top
            of = curves[f'{letter}_{case}']
            look = {'color': COLOURS[letter], 'linewidth': 1.0, 'label': LABELS[letter]}
            for axis, key in zip(axes[:, column], ('output', 'error', 'command')):
                axis.plot(of['time'], of[key], **look)
        of = curves[f'n_{case}']
        axes[0, column].plot(
            of['time'], of['reference'], color=INK, linestyle=':', linewidth=1.0, label='reference'
        )
        axes[0, column].set_title(
            f'output y, {"with" if case == "noisy" else "without"} noise', fontweight='bold'
        )
        axes[1, column].set_title('error r₁ − y')
        axes[2, column].set_title('command u')
        axes[2, column].set_xlabel('time [s]')
    axes[0, 0].legend(loc='lower right', ncol=3)
    low, high = axes[0, 0].get_ylim()
    axes[0, 0].set_ylim(low - 0.25 * (high - low), high)
    return figure


def _figure_4(result: Result) -> Figure:
    figure, axes = panels(1, 1, 2.6)
    axis, of = axes[0, 0], result['curves']['errors']
    itae = result['figure_4']['clean']
    axis.plot(
        of['time'],
        of['e3'],
        color=CONVENTIONAL,
        linewidth=2.0,
        label=f'e₃, ITAE {itae["e3_itae"]:.2f}',
    )
    axis.plot(of['time'], of['zeta3'], color=NESTED, label=f'ζ₃, ITAE {itae["zeta3_itae"]:.2f}')
    axis.set_title('estimation error of the total disturbance, without noise')
    axis.set_xlabel('time [s]')
    late = np.array(of['time']) > 2.0
    limit = 1.3 * float(np.abs(np.array(of['e3'])[late]).max())
    axis.set_ylim(-limit, limit)
    axis.legend(loc='upper right', ncol=2)
    return figure


def findings(result: Result) -> Findings:
    """Compare the reduction from e3 to zeta3 with the paper's, and the ITAE of the runs drawn."""
    noisy = {letter: result['metrics'][f'{letter}_noisy']['itae'] for letter in CONTROLLERS}
    return {
        'reduction': Finding(
            says='share by which the ITAE of zeta3 is below that of e3',
            values=result['figure_4']['clean']['reduction'],
            low=PAPER_REDUCTION - TOLERANCE,
            high=PAPER_REDUCTION + TOLERANCE,
        ),
        'c_noisy': Finding(
            says='ITAE of C-ADRC in the run drawn', values=noisy['c'], low=4.0, high=11.0
        ),
        'n_noisy': Finding(
            says='ITAE of N-ADRC in the run drawn', values=noisy['n'], low=1.5, high=3.5
        ),
    }


SECTION = Section(
    name='figures34',
    title='Figures 3 and 4',
    measure=measure,
    figures=figures,
    findings=findings,
)
