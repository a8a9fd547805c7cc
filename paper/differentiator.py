"""
(b) The tracking differentiator of eq. (1) taken literally, beside Han's fhan that the law uses.

Literally means sign() in a fixed-step loop. Two readings: with 2 R in the denominator, as in the
literature, and with 2 r as printed, where r is the reference and passes zero.
"""

from __future__ import annotations

import attrs
from matplotlib.figure import Figure
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import find_scenario, load, Scenario
from nadrc_ros.simulation.noise import Noise
import numpy as np
from paper.drawing import in_style, INK, LITERAL, NESTED, panels, thinned
from paper.loop import Decide, Law, run
from paper.section import Finding, Findings, Result, Section, Tell

SCENARIO = 'paper_g'
CONTROLLER = 'c_adrc'
RATES = (100.0, 1000.0)  # Hz
KINDS = ('fhan', 'sign', 'printed')
LABELS = {'fhan': 'fhan', 'sign': 'eq. (1), 2R', 'printed': 'eq. (1), 2r as printed'}
WINDOW = (3.0, 5.0)  # s, of the picture
# Declared: what sign() costs in effort at the slow rate, at least, where r1 must stay, and how far
# it runs away as printed.
EXCESS = 1.5
BOUNDED = 1.1
RUNAWAY = 10.0


class Literal:
    """The law without its differentiator, behind eq. (1) stepped with Euler and sign()."""

    def __init__(self, settings: ControllerSettings, as_printed: bool) -> None:
        self.acceleration = settings.tracking_acceleration
        self.as_printed = as_printed
        self.law = Law(
            attrs.evolve(settings, tracking_acceleration=0.0, reference_derivatives='topics')
        )
        self.profile = [0.0, 0.0, 0.0]

    def __call__(
        self, reference: list[float], measurement: float, applied: float, dt: float
    ) -> float:
        """Return the command."""
        r1, r2, _ = self.profile
        scale = reference[0] if self.as_printed else self.acceleration
        braking = r2 * abs(r2) / (2.0 * scale) if scale else 0.0
        r2_rate = -self.acceleration * float(np.sign(r1 - reference[0] + braking))
        self.profile = [r1 + dt * r2, r2 + dt * r2_rate, 0.0]
        return self.law(self.profile, measurement, applied, dt)


def measure(tell: Tell, jobs: int) -> Result:
    """Run C-ADRC without noise behind each differentiator, at each rate."""
    scenario = load(find_scenario(SCENARIO))
    rows, curves = [], {}
    for rate in RATES:
        for kind in KINDS:
            row, columns = _run(scenario, rate, kind)
            rows.append(row)
            if rate == RATES[0] and kind != 'printed':
                curves[kind] = columns
            tell(len(rows) / (len(RATES) * len(KINDS)))
    return {
        'scenario': SCENARIO,
        'acceleration': scenario.controllers[CONTROLLER].tracking_acceleration,
        'rows': rows,
        'curves': curves,
    }


def _run(scenario: Scenario, rate: float, kind: str) -> tuple[Result, dict[str, list[float]]]:
    settings = scenario.controllers[CONTROLLER]
    decide = Law(settings) if kind == 'fhan' else Literal(settings, kind == 'printed')
    profile = []

    def recorded(r: list[float], measurement: float, applied: float, dt: float) -> float:
        command = decide(r, measurement, applied, dt)
        profile.append(decide.profile[:2])
        return command

    followed: Decide = recorded
    found = run(attrs.evolve(scenario.experiment, rate=rate, noise=Noise()), followed)
    r1, r2 = np.array(profile).T
    turns = np.diff(np.sign(np.diff(r2)))
    row = {
        'rate': rate,
        'kind': kind,
        'itae': found.metrics.itae,
        'isu': found.metrics.isu,
        'total_variation': found.metrics.total_variation,
        'switches_per_second': float(np.count_nonzero(turns)) / found.metrics.duration,
        'largest_r1': float(np.abs(r1).max()),
    }
    shown = (found.time >= WINDOW[0]) & (found.time < WINDOW[1])
    columns = {'time': found.time[shown], 'r2': r2[shown], 'command': found.command[shown]}
    return row, thinned(columns)


@in_style
def figures(result: Result) -> dict[str, Figure]:
    """Draw the derivative r2 and the command behind both differentiators, close up."""
    figure, axes = panels(1, 2, 2.7)
    for axis, key, title in (
        (axes[0, 0], 'r2', 'derivative r₂ of the reference'),
        (axes[0, 1], 'command', 'command u'),
    ):
        for kind, colour, width in (('sign', LITERAL, 0.8), ('fhan', NESTED, 1.8)):
            curves = result['curves'][kind]
            axis.plot(
                curves['time'], curves[key], color=colour, linewidth=width, label=LABELS[kind]
            )
        axis.set_title(f'{title}, {RATES[0]:g} Hz, no noise')
        axis.set_xlabel('time [s]')
    time = np.array(result['curves']['fhan']['time'])
    axes[0, 0].plot(time, -0.5 * np.sin(0.5 * time), color=INK, linestyle=':', label='true')
    axes[0, 0].legend(loc='upper left', ncol=3)
    low, high = axes[0, 0].get_ylim()
    axes[0, 0].set_ylim(low, high + 0.25 * (high - low))
    return {'differentiator': figure}


def findings(result: Result) -> Findings:
    """Compare sign() with fhan, and say where each takes r1."""
    rows = {(row['rate'], row['kind']): row for row in result['rows']}
    slow = RATES[0]
    return {
        'excess': Finding(
            says=f'times the effort of fhan that sign() takes at {slow:g} Hz',
            values=rows[slow, 'sign']['isu'] / rows[slow, 'fhan']['isu'],
            low=EXCESS,
        ),
        'fhan_r1': Finding(
            says='largest |r1| of fhan',
            values=[rows[rate, 'fhan']['largest_r1'] for rate in RATES],
            high=BOUNDED,
        ),
        'printed_r1': Finding(
            says='largest |r1| with 2r as printed',
            values=[rows[rate, 'printed']['largest_r1'] for rate in RATES],
            low=RUNAWAY,
        ),
    }


SECTION = Section(
    name='differentiator',
    title='The tracking differentiator',
    measure=measure,
    figures=figures,
    findings=findings,
)
