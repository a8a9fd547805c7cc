"""What the article says of the controllers compared: the text around the numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from nadrc_ros.paper.figures34 import PAPER_REDUCTION
from nadrc_ros.paper.markup import Prose
from nadrc_ros.paper.section import Result
from nadrc_ros.paper.tables import table_1
from nadrc_ros.report.markup import paragraph, table


def table1(result: Result) -> Prose:
    """Tell of Table I."""
    found = table_1(result)
    header = ['', 'paper', *(cell for name in found.scenarios for cell in (name, 'difference'))]
    titles = {
        'clean_itae': 'ITAE, no noise',
        'clean_isu': 'ISU, no noise',
        'noisy_itae': 'ITAE, noise',
        'noisy_isu': 'ISU, noise',
        'e3_to_zeta3_itae': 'ITAE of ζ₃ against e₃',
    }
    columns = [result['paper_reductions']]
    columns += [scenario['reductions'] for scenario in result['scenarios'].values()]
    reductions = [
        (title, *(_signed(-column[key]) for column in columns)) for key, title in titles.items()
    ]
    best = max(column['clean_isu'] for column in columns[1:])
    shifts = [found['one_period'] for found in result['scenarios'].values()]
    paired = max(abs(shift) for found in shifts for shift in found.values())
    return Prose(
        before=paragraph(
            'Three calibrated scenarios, each run once without noise and with '
            f'{result["seeds"]} seeds of it (mean ± standard deviation of a run). G is the nested '
            'reading with the error r − y, fitted to the eight numbers of Table I; V the nested '
            'and P the printed reading with r₁ − y, fitted to the numbers of figure 4 as well. '
            'All three are files that anyone can run or change.'
        )
        + table(header, found.rows),
        captions={
            'table_1': 'Difference from the printed numbers, for those that a scenario was '
            'fitted to. Lines: the declared tolerances, 5 % for G and 12 % for P and V.'
        },
        after=paragraph('What N-ADRC changes, against C-ADRC with the same gains:')
        + table(('', 'paper', *found.scenarios), reductions)
        + paragraph(
            'The improvement under noise comes out in all three. The 7.5 % lower effort without '
            f'noise in none: the best is {best:.1f} %. Nothing here decides between the nested '
            'and the printed reading. Where the error is r₁ − y (P and V), a simulator that pairs '
            'profile and output one period apart changes the ITAE of C-ADRC without noise by '
            f'{100.0 * paired:.0f} %, which is more than the tolerance.'
        ),
    )


def figures34(result: Result) -> Prose:
    """Tell of figures 3 and 4."""
    errors, metrics = result['figure_4']['clean'], result['metrics']
    return Prose(
        before=paragraph(
            'One run of calibrated scenario V, drawn as the figures of the paper. Without noise '
            'the two controllers cannot be told apart by eye; with noise C-ADRC leaves the '
            'reference wherever the nonlinear feedback meets a noisy estimate of the velocity.'
        ),
        captions={
            'figure_3': 'Figure 3. Left without, right with noise of variance 10⁻⁴ (seed '
            f'{result["seed"]}). ITAE with noise: C-ADRC {metrics["c_noisy"]["itae"]:.2f}, '
            f'N-ADRC {metrics["n_noisy"]["itae"]:.2f}.',
            'figure_4': 'Figure 4. Estimation errors of the inner observer, e₃, and of both '
            'together, ζ₃.',
        },
        after=paragraph(
            f'ζ₃ has {100 * errors["reduction"]:.0f} % less ITAE than e₃; the paper has '
            f'{100 * PAPER_REDUCTION:.0f} %. The spikes are in both: where the '
            'nonlinear feedback switches, the command jumps, and with it a₃ sin(t) u, which is '
            'part of L.'
        ),
    )


def attribution(result: Result) -> Prose:
    """Tell which part of N-ADRC does what."""
    scenarios = result['scenarios']
    labels = {
        'c_adrc': 'C-ADRC',
        'subtraction': 'only ẑ₃ subtracted too',
        'states': 'only the outer states fed back',
        'n_adrc': 'N-ADRC: both',
        'c_best': 'C-ADRC at its best bandwidth',
        'n_best': 'N-ADRC at its best bandwidth, the same for both levels',
    }
    rows = []
    for key, label in labels.items():
        row = [label]
        for found in scenarios.values():
            numbers = found['variants'][key]
            row += [
                f'{numbers["inner_bandwidth"]:.0f}',
                f'{numbers["noisy_itae"]:.2f}',
                f'{numbers["noisy_isu"]:.0f}',
            ]
        rows.append(row)
    header = ['']
    for name in scenarios:
        header += [f'{name}: ω₀', 'ITAE', 'ISU']
    shares = [found['shares'] for found in scenarios.values()]
    states = min(share['states']['noisy_itae'] for share in shares)
    subtraction = max(share['subtraction']['noisy_itae'] for share in shares)
    single = [found['variants']['c_best'] for found in scenarios.values()]
    best = [found['variants']['n_best'] for found in scenarios.values()]
    return Prose(
        before=paragraph(
            'N-ADRC differs from C-ADRC in two things at once: the feedback takes the states of '
            'the slow outer observer, and the command subtracts its disturbance estimate as well. '
            'Only the second is nesting. Each alone, all gains the same, with noise:'
        )
        + table(header, rows),
        captions={
            'attribution': 'ITAE with noise. Left: the two differences alone and together. Right: '
            'over the bandwidth of the observers, all other gains the same.'
        },
        after=paragraph(
            f'The outer states alone bring {_at_least(states)} of the improvement, the '
            f'second subtraction {_percent(max(subtraction, 0.0))}. And '
            'C-ADRC is far from its best here: with a slower observer, nothing else changed, it '
            f'spends an ISU of {_range(single, "noisy_isu", ".0f")} and reaches an ITAE of '
            f'{_range(single, "noisy_itae", ".1f")}; N-ADRC at its best has an ITAE of '
            f'{_range(best, "noisy_itae", ".1f")} at an ISU of '
            f'{_range(best, "noisy_isu", ".0f")}. In G the noise-free improvement is due to the '
            'second subtraction; in P and V it comes with the outer states.'
        ),
    )


def fair(result: Result) -> Prose:
    """Tell what nesting is worth under the same effort."""
    candidates, gains = result['candidates'], result['gains']
    budgets = [row['budget'] for row in candidates['conventional']['noisy']]
    header = ['ISU up to', *(f'{budget:g}' for budget in budgets)]
    noisy = [
        (each['label'], *(f'{row["noisy_itae"]["mean"]:.3f}' for row in each['noisy']))
        for each in candidates.values()
    ]
    clean = [
        (each['label'], *(f'{row["clean_itae"]:.3g}' for row in each['clean']))
        for each in candidates.values()
    ]
    nested, rival = gains['nested_2'], gains['generalized']
    seeds = result['seeds']
    less = [f'{100.0 * share:.0f}' for share in nested['noisy_reduction']]
    times = [f'{factor:.2g}' for factor in nested['clean_factor']]
    against = [f'{factor:.2g}' for factor in rival['clean_factor']]
    nonlinear = gains['nonlinear_2']['clean_factor']
    noisy_more, clean_more = _beyond_two_levels(gains)
    return Prose(
        before=paragraph(
            'Any controller looks bad with the wrong bandwidths. So each observer gets its own '
            'best ones: those with the least ITAE, with noise or without, among all whose noisy '
            'run spends at most a given integral of u². The feedback is linear, '
            'and everybody knows the derivatives of the reference. The tuned '
            f'designs are run here with {seeds["noisy"]} seeds that the tuning never saw, '
            f'{seeds["clean"]} where noise counts for the effort only.'
        ),
        captions={'fair': 'Each point is a design of its own, the best for its budget.'},
        after=paragraph('ITAE with noise:')
        + table(header, noisy)
        + paragraph('ITAE without noise, of designs within the same noisy effort:')
        + table(header, clean)
        + paragraph(
            f'Two nested levels instead of one: {", ".join(less)} % less ITAE with noise, and '
            f'{", ".join(times)} times less without, from the tightest budget to the '
            'loosest. The rival that is as simple, one observer with two extended states, has '
            f'{", ".join(against)} times less without. A third and a fourth level change the '
            f'ITAE with noise by {100.0 * noisy_more:.1f} % at most; without noise four levels '
            f'have {min(clean_more):.1f} to {max(clean_more):.1f} times less than two.'
        )
        + paragraph(
            'The paper names nonlinear observers as future work. Nested, they are '
            f'{_span(nonlinear)} times better than one linear observer without noise, because '
            'their gain is higher for small innovations. With noise, innovations are not small: '
            'there they do as well as the linear ones and no better.'
        ),
    )


def _percent(share: float) -> str:
    return f'{100.0 * share:.0f} %'


def _span(values: Sequence[float]) -> str:
    return f'{min(values):.2g} to {max(values):.2g}'


def _at_least(share: float) -> str:
    return 'all' if share >= 0.995 else f'{_percent(share)} or more'


def _range(rows: Sequence[Mapping[str, float]], key: str, form: str) -> str:
    values = [row[key] for row in rows]
    return f'{min(values):{form}} to {max(values):{form}}'


def _signed(percent: float) -> str:
    return f'{percent:+.1f} %'.replace('-', '−')


def _beyond_two_levels(gains: Mapping[str, Any]) -> tuple[float, list[float]]:
    """Return the largest change of the noisy ITAE, and the factors of the clean one with four."""
    two, more = gains['nested_2'], [gains[name] for name in ('nested_3', 'nested_4')]
    changes = [
        abs(1.0 - (1.0 - other) / (1.0 - one))
        for each in more
        for one, other in zip(two['noisy_reduction'], each['noisy_reduction'])
    ]
    factors = [b / a for a, b in zip(two['clean_factor'], more[-1]['clean_factor'])]
    return max(changes), factors
