"""What the article says of theory, rate, differentiator and start."""

from __future__ import annotations

from nadrc_ros.paper.markup import (
    formula,
    fraction,
    hat,
    inline,
    mi,
    mn,
    mo,
    Prose,
)
from nadrc_ros.paper.section import Result
from nadrc_ros.report.markup import paragraph, table

E3 = inline(mi('e', '3'))
ZETA3 = inline(mi('ζ', '3'))
W0 = inline(mi('ω', '0'))


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


def _squared(below: str) -> str:
    return f'<msubsup><mi>λ</mi><mi>{below}</mi><mn>2</mn></msubsup>'
