"""
(e) Theorem 1 and Corollary 1 against the errors that the observers really make.

The observers of the law run open loop beside y'' = L(t), whose solution is known, so that every
error e_i = x_i - xh_i is exact. L is a ramp, the worst case of |dL/dt| <= M, or a sinusoid. A
sampled observer takes L for held over each period, so L is compared at the middle of the next one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, sin
from typing import Any

from matplotlib.figure import Figure
from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.adrc.observer import update
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.report.style import plain_log_ticks
from nadrc_ros.theory.bounds import error_rate, lyapunov, residuals, sharp, theorem_1
import numpy as np
from paper.drawing import CONVENTIONAL, in_style, INK, NESTED, panels, PRINTED
from paper.section import Finding, Findings, Result, Section, Tell

ORDER = 2
M = 1.0  # bound of |dL/dt|
BANDWIDTHS = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0)  # rad/s
WH = 0.02  # w h for Theorem 1
RATE = 1000.0  # Hz for Corollary 1
FAST, SLOW = 1.0, 0.1  # rad/s, the sinusoids for Theorem 1 and for Corollary 1
INNER = 20.0  # rad/s, while the outer bandwidth varies
SETTLE = 25.0  # in units of 1 / bandwidth
# Declared tolerances: how far a measured error may exceed its sharp bound, and fall short of it
# under a ramp.
ABOVE, BELOW = 0.02, 0.05

Truth = Callable[[float], tuple[float, float, float]]


def ramp(t: float) -> tuple[float, float, float]:
    """Return x1, x2 and L for L = M t."""
    return M * t**3 / 6.0, M * t**2 / 2.0, M * t


def sinusoid(om: float) -> Truth:
    """Return x1, x2 and L over time for L = (M / Om) sin(Om t)."""

    def truth(t: float) -> tuple[float, float, float]:
        return -M / om**3 * sin(om * t), -M / om**2 * cos(om * t), M / om * sin(om * t)

    return truth


def design(structure: str, inner: float, outer: float) -> Design:
    """Return the observers to run."""
    return make_design(
        ControllerSettings(
            plant_order=ORDER,
            structure=structure,
            inner_bandwidth=inner,
            outer_bandwidth=outer,
            levels=2,
        )
    )


def largest_errors(
    of: Design, truth: Truth, rate: float, settle: float, length: float
) -> list[list[float]]:
    """
    Return the largest |x_1 - xh_1|, |x_2 - xh_2| of each level, and last |L - sum d| up to it.

    Taken over ``length`` seconds, ``settle`` seconds after the start [s], ``rate`` times a second.
    """
    h = 1.0 / rate
    levels, out = blank_state(of).levels, blank_state(of).levels
    scratch = blank_state(of).scratch
    levels[0][:] = truth(0.0)
    for level in list(levels)[1:]:
        level[:ORDER] = levels[0][:ORDER]
    worst = [[0.0] * (ORDER + 1) for _ in range(of.levels)]
    first = round(settle * rate)
    for k in range(1, first + round(length * rate)):
        x = truth(k * h)
        update(of, levels, x[0], 0.0, h, 1.0, out, scratch)
        levels, out = out, levels
        if k < first:
            continue
        left = truth((k + 0.5) * h)[ORDER]
        for row, xh in zip(worst, levels):
            left -= xh[ORDER]
            errors = [*(x[i] - xh[i] for i in range(ORDER)), left]
            row[:] = [max(a, abs(e)) for a, e in zip(row, errors)]
    return worst


def measure(tell: Tell, jobs: int) -> Result:
    """Run the observers over the bandwidths."""
    return _over(BANDWIDTHS, tell)


def quick(tell: Tell, jobs: int) -> Result:
    """Run the observers at the ends of the range."""
    return _over((BANDWIDTHS[0], BANDWIDTHS[-1]), tell)


def _over(bandwidths: Sequence[float], tell: Tell) -> Result:
    theorem, corollary = [], []
    for i, w in enumerate(bandwidths):
        tell(i / len(bandwidths))
        theorem.append(_theorem_row(w))
        corollary.append(_corollary_row(w))
    return {
        'm': M,
        'sinusoid_frequencies': [FAST, SLOW],
        'inner_bandwidth': INNER,
        'factor': lyapunov(ORDER).factor,
        'lemma_2': _lemma_2(),
        'theorem_1': theorem,
        'corollary_1': corollary,
    }


def _theorem_row(w: float) -> dict[str, Any]:
    of, rate, settle = design('conventional', w, w), w / WH, SETTLE / w
    return {
        'bandwidth': w,
        'printed_bound': theorem_1(ORDER, w, M).tolist(),
        'sharp_bound': sharp(ORDER, w, M).tolist(),
        'ramp': largest_errors(of, ramp, rate, settle, settle)[0],
        'sinusoid': largest_errors(of, sinusoid(FAST), rate, settle, pi / FAST)[0],
    }


def _corollary_row(w: float) -> dict[str, Any]:
    """Measure zeta3 over the outer bandwidth, for the sinusoid: M' = max |de3/dt|."""
    found: dict[str, Any] = {'outer_bandwidth': w}
    for structure in ('nested', 'printed'):
        of = design(structure, INNER, w)
        settle = SETTLE / min(w, INNER)
        inner, outer = largest_errors(of, sinusoid(SLOW), RATE, settle, pi / SLOW)
        found[structure] = outer[ORDER]
        found[f'{structure}_sharp_bound'] = float(residuals(of)[1]) * M
        found['e3'] = inner[ORDER]
    # e3 of the sinusoid is itself one, of the same frequency.
    rate = found['e3'] * SLOW
    found['m_prime'] = rate
    found['printed_bound'] = float(theorem_1(ORDER, w, rate)[ORDER])
    found['sharp_for_m_prime'] = float(sharp(ORDER, w, rate)[ORDER])
    return found


@in_style
def figures(result: Result) -> dict[str, Figure]:
    """Draw both claims over the bandwidth."""
    figure, axes = panels(1, 2, 3.6)
    rows = result['theorem_1']
    w = [row['bandwidth'] for row in rows]
    axis = axes[0, 0]
    for key, label, style in (
        ('printed_bound', 'Theorem 1 as printed', {'color': INK, 'linestyle': '--'}),
        ('sharp_bound', 'sharp bound 3 M / w₀', {'color': INK}),
        ('ramp', 'measured, ramp', {'color': CONVENTIONAL, 'marker': 'o', 'linestyle': ''}),
        (
            'sinusoid',
            'measured, sinusoid of 1 rad/s',
            {'color': NESTED, 'marker': 'x', 'linestyle': ''},
        ),
    ):
        axis.plot(w, [row[key][ORDER] for row in rows], label=label, **style)
    axis.set_title('Theorem 1: |e₃| for |dL/dt| ≤ M = 1')
    axis.set_xlabel('bandwidth w₀ [rad/s]')
    rows = result['corollary_1']
    w = [row['outer_bandwidth'] for row in rows]
    axis = axes[0, 1]
    for key, label, style in (
        ('printed_bound', 'Corollary 1 as printed', {'color': INK, 'linestyle': '--'}),
        ('sharp_for_m_prime', "sharp bound 3 M' / w₀'", {'color': INK}),
        ('e3', 'e₃, measured', {'color': CONVENTIONAL, 'linestyle': '-.'}),
        ('printed', 'ζ₃ with eq. (20) as printed', {'color': PRINTED, 'marker': 's'}),
        ('nested', 'ζ₃ nested', {'color': NESTED, 'marker': 'o', 'linestyle': ''}),
    ):
        axis.plot(w, [row[key] for row in rows], label=label, markersize=4, **style)
    axis.set_title('Corollary 1: |ζ₃| for a sinusoid of 0.1 rad/s')
    axis.set_xlabel("outer bandwidth w₀' [rad/s]")
    for axis in axes[0]:
        axis.set_xscale('log')
        axis.set_yscale('log')
        plain_log_ticks(axis)
        low, high = axis.get_ylim()
        axis.set_ylim(low, high * 8.0)
        axis.legend(loc='upper right', ncol=1)
    return {'bounds': figure}


def findings(result: Result) -> Findings:
    """Compare measured errors with the sharp bounds, and each claim with what is measured."""
    theorem, corollary = result['theorem_1'], result['corollary_1']
    last = corollary[-1]
    return {
        'factor': Finding(
            says='2 lmax^2 / lmin of Theorem 1', values=result['factor'], low=191.404, high=191.405
        ),
        'theorem': Finding(
            says='largest error under a ramp over its sharp bound',
            values=[m / b for row in theorem for m, b in zip(row['ramp'], row['sharp_bound'])],
            low=1.0 - BELOW,
            high=1.0 + ABOVE,
        ),
        'sharp': Finding(
            says='residual over its sharp bound',
            values=[
                row[name] / row[f'{name}_sharp_bound']
                for row in corollary
                for name in ('nested', 'printed')
            ],
            high=1.0 + ABOVE,
        ),
        'nested': Finding(
            says='zeta3 over the bound of Corollary 1, nested',
            values=[row['nested'] / row['sharp_for_m_prime'] for row in corollary],
            high=1.0 + ABOVE,
        ),
        'printed': Finding(
            says='zeta3 with eq. (20) as printed over the printed bound, fastest outer observer',
            values=last['printed'] / last['printed_bound'],
            low=1.0,
        ),
        'half': Finding(
            says='zeta3 with eq. (20) as printed over e3',
            values=[row['printed'] / row['e3'] for row in corollary],
            low=0.5 - ABOVE,
            high=0.5 + ABOVE,
        ),
        'lemma_2_sinusoid': Finding(
            says='largest rate of e3 over that of L, for a sinusoid',
            values=result['lemma_2']['sinusoid'],
            low=1.28,
            high=1.30,
        ),
        'lemma_2_worst': Finding(
            says='largest rate of e3 over that of L',
            values=result['lemma_2']['worst'],
            low=1.99,
            high=2.01,
        ),
        'lemma_2_holds_below': Finding(
            says='frequency over w0 below which Lemma 2 holds for a sinusoid',
            values=result['lemma_2']['holds_below'],
            low=0.407,
            high=0.409,
        ),
    }


def _lemma_2() -> dict[str, float]:
    """
    Return by how much the rate of e3 can exceed that of L: the gain of 1 - G_1 at s = j Om.

    For a sinusoid the largest gain over all frequencies, and the frequency over w0 from which it
    exceeds 1; for any disturbance the L1 norm.
    """
    x = np.linspace(1e-3, 10.0, 200_001)  # Om / w0
    gain = np.abs(1.0 - (1.0 / (1.0 + 1j * x)) ** (ORDER + 1))
    return {
        'sinusoid': float(gain.max()),
        'holds_below': float(x[np.argmax(gain > 1.0)]),
        'worst': error_rate(ORDER),
    }


SECTION = Section(
    name='bounds',
    title='The bounds',
    measure=measure,
    figures=figures,
    findings=findings,
    quick=quick,
)
