"""The table of claims: what the paper says, what is measured, and the verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from nadrc_ros.paper.section import Result

# Where in the paper, what it says, what is measured, the verdict: ready HTML.
Row = tuple[str, str, str, str]


def claims(results: Mapping[str, Result]) -> list[Row]:
    """Return a row for each claim about which a section measured something."""
    return [row for name, rows in CLAIMS.items() if name in results for row in rows(results[name])]


def figures34(result: Result) -> list[Row]:
    """Judge figure 4."""
    found = result['figure_4']['clean']
    return [
        (
            'Figure 4',
            'ζ₃ has 45 % less ITAE than e₃ (10.58 to 5.83)',
            f'{100 * found["reduction"]:.0f} % ({found["e3_itae"]:.2f} to '
            f'{found["zeta3_itae"]:.2f}) in calibrated scenario V',
            'plausible; without noise. It cannot tell v from v′ in eq. (20)',
        )
    ]


def bounds(result: Result) -> list[Row]:
    """Judge theorem, corollary and lemma."""
    factor, last = result['factor'], result['corollary_1'][-1]
    tightest = min(row['ramp'][2] / row['sharp_bound'][2] for row in result['theorem_1'])
    return [
        (
            'Theorem 1',
            'estimation errors stay below a bound that falls with the bandwidth',
            f'never above; a ramp reaches {100 * tightest:.0f} % of the sharp bound, which is '
            f'{factor / 3:.0f} times smaller for e₃',
            'true; loose, and printed with = for ≤',
        ),
        (
            'Corollary 1',
            'ζ₃ falls as 1/ω₀′',
            'nested: it does. As printed: half of e₃, '
            f'{last["printed"] / last["printed_bound"]:.1f} times the bound at '
            f'{last["outer_bandwidth"]:g} rad/s',
            'true with v′ in eq. (20), false with v',
        ),
        (
            'Lemma 2',
            'the rate of e₃ is at most that of the disturbance',
            'up to 1.29 times for a sinusoid, 2 times at worst',
            'false; its proof lets a constant go to zero in which the bound grows',
        ),
    ]


def startup(result: Result) -> list[Row]:
    """Judge the device against peaking."""
    zero, measured = result['starts']['zero'], result['starts']['measured']
    return [
        (
            'II-C',
            '1/ε = 100 t³ alleviates peaking',
            f'largest command {zero["off"]["peak_command"]:.0f} → '
            f'{zero["on"]["peak_command"]:.0f}; started at the first measurement '
            f'{measured["off"]["peak_command"]:.1f} without it',
            'true, and not needed by a controller that looks before it starts',
        )
    ]


def differentiator(result: Result) -> list[Row]:
    """Judge eq. (1)."""
    rows = {(row['rate'], row['kind']): row for row in result['rows']}
    rate = result['rows'][0]['rate']
    sign, fhan = rows[rate, 'sign']['isu'], rows[rate, 'fhan']['isu']
    return [
        (
            'Eq. (1)',
            'a differentiator gives the reference and its rate, free of noise',
            f'with sign() at {rate:g} Hz it chatters: {sign / fhan:.1f} times the effort of fhan',
            'use fhan; 2r must read 2R',
        )
    ]


CLAIMS: dict[str, Callable[[Result], list[Row]]] = {
    'figures34': figures34,
    'bounds': bounds,
    'differentiator': differentiator,
    'startup': startup,
}
