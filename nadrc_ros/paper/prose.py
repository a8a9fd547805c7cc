"""What the article says about each section: text around the numbers of a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import attrs
from nadrc_ros.paper.figures34 import PAPER_REDUCTION
from nadrc_ros.paper.html import (
    formula,
    fraction,
    hat,
    inline,
    mi,
    mn,
    mo,
    paragraph,
    table,
)
from nadrc_ros.paper.section import Result
from nadrc_ros.paper.tables import table_1

E3 = inline(mi('e', '3'))
ZETA3 = inline(mi('ζ', '3'))
W0 = inline(mi('ω', '0'))


@attrs.frozen(kw_only=True)
class Prose:
    """Ready HTML before and after the figures, and a caption for each figure by stem."""

    before: str
    after: str = ''
    captions: dict[str, str] = attrs.field(factory=dict)


def no_prose(result: Result) -> Prose:
    """Say nothing about a section."""
    return Prose(before='')


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
            'and the printed reading.'
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
            f'{_range(single, "noisy_itae", ".1f")}. In G the noise-free improvement is due to '
            'the second subtraction; in P and V it comes with the outer states.'
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
    less = [f'{100.0 * share:.0f}' for share in nested['noisy_reduction']]
    times = [f'{factor:.2g}' for factor in nested['clean_factor']]
    against = [f'{factor:.2g}' for factor in rival['clean_factor']]
    return Prose(
        before=paragraph(
            'Any controller looks bad with the wrong bandwidths. So each observer gets its own '
            'best ones: those with the least ITAE, with noise or without, among all whose noisy '
            'run spends at most a given integral of u². The feedback is linear, '
            'and everybody knows the derivatives of the reference. The tuned '
            f'designs are run here with {result["seeds"]} seeds that the tuning never saw.'
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
            f'{", ".join(against)} times less without noise. More levels than two or three gain '
            'little. The nonlinear observers, which the paper names as future work, are in the '
            'tables as well.'
        ),
    )


def bounds(result: Result) -> Prose:
    """Tell of Theorem 1 and Corollary 1."""
    last = result['corollary_1'][-1]
    factor = result['factor']
    theorem = formula(
        mo('lim sup')
        + mo('|')
        + mi('x', 'i')
        + mo('−')
        + hat('x', 'i')
        + mo('|')
        + mo('≤')
        + fraction(
            mi('M'),
            '<msubsup><mi>ω</mi><mn>0</mn><mrow>'
            '<mi>n</mi><mo>+</mo><mn>2</mn><mo>−</mo><mi>i</mi></mrow></msubsup>',
        )
        + fraction(mn('2') + _squared('max'), mi('λ', 'min'))
    )
    return Prose(
        before=paragraph(
            'Theorem 1 bounds the estimation errors by the largest rate M of the total '
            'disturbance:'
        )
        + theorem
        + paragraph(
            f'For a second-order plant the last factor is {factor:.4f}. The sharp constants are '
            '1, 3 and 3, because the impulse responses do not change sign, and a ramp attains '
            f'them: the theorem holds, and is {factor:.0f}, {factor / 3:.0f} and '
            f'{factor / 3:.0f} times too large. Corollary 1 says the same of the outer observer, '
            f'with the rate M′ of {E3}. It holds for the nested reading. With eq. (20) as '
            f'printed {ZETA3} tends to half of {E3}, however fast the outer observer: at '
            f'{last["outer_bandwidth"]:g} rad/s it is '
            f'{last["printed"] / last["printed_bound"]:.1f} times the bound.'
        ),
        captions={
            'bounds': 'Errors of the observers of the law, open loop, against the bounds. Right: '
            f'inner bandwidth {result["inner_bandwidth"]:g} rad/s.'
        },
        after=paragraph(
            'Lemma 2, which is to make M′ ≤ M, is not true: for a sinusoid it holds below '
            f'{W0}/√6 only (0.408 {W0}), and the smallest bound for every disturbance is 2 M.'
        ),
    )


def rates(result: Result) -> Prose:
    """Tell of the rate of the loop."""
    rows = result['rows']
    first = rows[0]
    excess = first['euler_noisy_isu'] / first['current_noisy_isu']
    euler = [row['euler_clean_itae'] for row in rows]
    current = [row['current_clean_itae'] for row in rows]
    return Prose(
        before=paragraph(
            'The paper simulates in continuous time; a robot has a clock. The law uses the '
            'current observer: exact for a held command, its poles placed at exp(−ωh), with the '
            'period h that was measured. Beside it the same C-ADRC with eq. (3) stepped by '
            'forward Euler, which is what one gets by typing it in.'
        ),
        captions={
            'rates': 'C-ADRC on the plant of eq. (26), observer bandwidth '
            f'{result["bandwidth"]:g} rad/s. Noise held for 10 ms, the same at every rate.'
        },
        after=paragraph(
            f'From {rows[-1]["rate"]} down to {first["rate"]} Hz the noise-free ITAE of the '
            f'current observer stays within {100 * (max(current) / min(current) - 1):.1f} %, '
            f'that of Euler changes {max(euler) / min(euler):.1f}-fold. At ωh = {first["wh"]:g} '
            f'Euler spends {excess:.1f} times the effort under noise, and it is unstable beyond '
            f'ωh = {result["euler_stable_to_wh"]:.2f}, the current observer beyond '
            f'{result["current_stable_to_wh"]:.1f}.'
        ),
    )


def differentiator(result: Result) -> Prose:
    """Tell of the tracking differentiator."""
    labels = {'fhan': 'fhan (used)', 'sign': 'sign(), 2R', 'printed': 'sign(), 2r as printed'}
    rows = [
        (
            f'{row["rate"]:g}',
            labels[row['kind']],
            f'{row["isu"]:.4g}',
            f'{row["total_variation"]:.4g}',
            f'{row["switches_per_second"]:.3g}',
            f'{row["largest_r1"]:.4g}',
        )
        for row in result['rows']
    ]
    header = ('rate [Hz]', 'differentiator', 'ISU', 'variation of u', 'turns of r₂ /s', 'max |r₁|')
    return Prose(
        before=paragraph(
            'Eq. (1) switches the acceleration of the profile between +R and −R. In a fixed step '
            'it never settles on the reference but jumps to and fro across it. Han’s fhan is the '
            'same time-optimal law worked out for the step, and does not.'
        ),
        captions={
            'differentiator': 'Calibrated scenario G, C-ADRC without noise, in close-up.',
        },
        after=table(header, rows, words=(1,))
        + paragraph(
            'With 2r in the denominator, as printed, the braking distance is divided by the '
            'reference, which passes zero and changes sign: r₁ runs away. It must read 2R.'
        ),
    )


def startup(result: Result) -> Prose:
    """Tell of the start."""
    names = {
        'zero': 'estimates zero, y(0) = 1 (the paper)',
        'measured': 'estimates from the first measurement, plant at rest',
        'moving': 'the same, plant moving at 1/s',
    }
    rows = [
        (
            names[name],
            f'{devices["off"]["peak_command"]:.4g}',
            f'{devices["on"]["peak_command"]:.4g}',
            f'{devices["off"]["itae"]:.3g}',
            f'{devices["on"]["itae"]:.3g}',
        )
        for name, devices in result['starts'].items()
    ]
    header = ('start', 'max |u|, off', 'max |u|, on', 'ITAE, off', 'ITAE, on')
    return Prose(
        before=paragraph(
            'A fast observer that starts from a wrong estimate overshoots by powers of its '
            'bandwidth. The paper quotes a device against this peaking, a bandwidth that rises:'
        )
        + formula(
            fraction(mn('1'), mi('ε'))
            + mo('=')
            + mn('100')
            + '<msup><mi>t</mi><mn>3</mn></msup>'
            + mo(',')
            + mn('0')
            + mo('≤')
            + mi('t')
            + mo('≤')
            + mn('1')
        ),
        captions={'startup': 'Commands after the start, without and with the device.'},
        after=table(header, rows)
        + paragraph(
            'The device does what it is for. But a controller that starts its estimates at the '
            'first measurement, as this one does, has no such error to begin with; then the '
            'device only leaves the loop without an observer for half a second. It is an option '
            '(<code>startup_time</code>), off by default, for a plant that may be moving when '
            'the controller starts and whose actuator must not be kicked.'
        ),
    )


def _percent(share: float) -> str:
    return f'{100.0 * share:.0f} %'


def _at_least(share: float) -> str:
    return 'all' if share >= 0.995 else f'{_percent(share)} or more'


def _range(rows: Sequence[Mapping[str, float]], key: str, form: str) -> str:
    values = [row[key] for row in rows]
    return f'{min(values):{form}} to {max(values):{form}}'


def _signed(percent: float) -> str:
    return f'{percent:+.1f} %'.replace('-', '−')


def _squared(below: str) -> str:
    return f'<msubsup><mi>λ</mi><mi>{below}</mi><mn>2</mn></msubsup>'


PROSE: dict[str, Callable[[Result], Prose]] = {
    'table1': table1,
    'figures34': figures34,
    'attribution': attribution,
    'fair': fair,
    'bounds': bounds,
    'rates': rates,
    'differentiator': differentiator,
    'startup': startup,
}
