"""
(f) The rate of the loop: the current observer of this package beside a LESO stepped with Euler.

The forward Euler observer is what one gets by typing eq. (3) into a fixed-step loop. It lives here
only, as the thing that the law does not use.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
from matplotlib.figure import Figure
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import find_scenario, load
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.noise import Noise
import numpy as np
from paper.drawing import GREY, in_style, LITERAL, NESTED, panels
from paper.loop import Decide, Law, run
from paper.section import Finding, Findings, Result, Section, Tell

BANDWIDTH, CONTROLLER_BANDWIDTH = 40.0, 4.0  # rad/s
LIMIT = 100.0
RATES = (100, 125, 200, 250, 500, 1000)  # Hz
SLOWEST, FASTEST = 0.5, 1000.0  # Hz: where the limit of stability is sought
# Declared tolerances. The share by which the noise-free ITAE may differ between rates, and the
# band of the ratio of the noisy efforts, Euler to current observer, at w h = 0.4.
SAME_ITAE = 0.02
EXCESS_AT_04 = (3.0, 4.2)


class Euler:
    """C-ADRC with a forward Euler step of eq. (3) for n = 2: a reference, not for use."""

    def __init__(self, bandwidth: float, controller_bandwidth: float, limit: float) -> None:
        self.beta = (3.0 * bandwidth, 3.0 * bandwidth**2, bandwidth**3)
        self.gains = (controller_bandwidth**2, 2.0 * controller_bandwidth)
        self.limit = limit
        self.x = (0.0, 0.0, 0.0)

    def __call__(
        self, reference: list[float], measurement: float, applied: float, dt: float
    ) -> float:
        """Return the command."""
        x1, x2, x3 = self.x
        e = measurement - x1
        x1, x2, x3 = (
            x1 + dt * (x2 + self.beta[0] * e),
            x2 + dt * (x3 + applied + self.beta[1] * e),
            x3 + dt * self.beta[2] * e,
        )
        self.x = x1, x2, x3
        v = self.gains[0] * (reference[0] - x1) + self.gains[1] * (reference[1] - x2)
        return min(max(v + reference[2] - x3, -self.limit), self.limit)


def current() -> Decide:
    """Return a fresh law with the current observer."""
    return Law(
        ControllerSettings(
            structure='conventional',
            inner_bandwidth=BANDWIDTH,
            controller_bandwidth=CONTROLLER_BANDWIDTH,
            command_min=-LIMIT,
            command_max=LIMIT,
        )
    )


def euler() -> Decide:
    """Return a fresh law with the Euler observer."""
    return Euler(BANDWIDTH, CONTROLLER_BANDWIDTH, LIMIT)


def experiment(rate: float) -> Experiment:
    """Return the plant of eq. (26) with noise held for 10 ms, the same at every rate."""
    noise = Noise(variance=1e-4, sample_time=0.01, seed=1)
    plant_26 = load(find_scenario('paper_fair')).experiment
    return attrs.evolve(plant_26, noise=noise, initial_state=(0.0, 0.0), rate=rate)


def stability_limit(make: Callable[[], Decide]) -> float:
    """Return the largest w h at which the loop around a double integrator is stable."""
    slow, fast = SLOWEST, FASTEST
    for _ in range(40):
        rate = (slow * fast) ** 0.5
        if _spectral_radius(make, 1.0 / rate) < 1.0:
            fast = rate
        else:
            slow = rate
    return BANDWIDTH / fast


def _spectral_radius(make: Callable[[], Decide], h: float) -> float:
    """Return the largest |pole| of one period, its matrix found by stepping unit vectors."""
    small = 1e-6  # far inside the limits
    columns = []
    for i in range(6):  # plant x1, x2; observer 3; the command before
        unit = [small * (i == j) for j in range(6)]
        decide = make()
        _set(decide, unit[2:5])
        u = decide([0.0, 0.0, 0.0], unit[0], unit[5], h)
        x1 = unit[0] + h * unit[1] + 0.5 * h * h * u
        columns.append([x1, unit[1] + h * u, *_get(decide), u])
    return float(np.abs(np.linalg.eigvals(np.array(columns).T / small)).max())


def _set(decide: Any, x: list[float]) -> None:
    if isinstance(decide, Law):
        decide.state.levels[0][:] = x
    else:
        decide.x = tuple(x)


def _get(decide: Any) -> list[float]:
    return list(decide.state.levels[0] if isinstance(decide, Law) else decide.x)


def measure(tell: Tell, jobs: int) -> Result:
    """Run both observers at every rate, with and without noise."""
    rows = []
    for i, rate in enumerate(RATES):
        noisy = experiment(rate)
        clean = attrs.evolve(noisy, noise=Noise())
        row: Result = {'rate': rate, 'wh': BANDWIDTH / rate}
        for name, make in (('current', current), ('euler', euler)):
            row[f'{name}_clean_itae'] = run(clean, make()).metrics.itae
            row[f'{name}_noisy_isu'] = run(noisy, make()).metrics.isu
        rows.append(row)
        tell((i + 1) / len(RATES))
    return {
        'bandwidth': BANDWIDTH,
        'controller_bandwidth': CONTROLLER_BANDWIDTH,
        'noise_sample_time': 0.01,
        'rows': rows,
        'current_stable_to_wh': stability_limit(current),
        'euler_stable_to_wh': stability_limit(euler),
    }


@in_style
def figures(result: Result) -> dict[str, Figure]:
    """Draw error and effort against the rate."""
    figure, axes = panels(1, 2, 2.9)
    rate = [row['rate'] for row in result['rows']]
    for axis, key, title in (
        (axes[0, 0], 'clean_itae', 'ITAE without noise'),
        (axes[0, 1], 'noisy_isu', 'ISU with noise'),
    ):
        for name, label, colour, marker in (
            ('current', 'current observer (used)', NESTED, 'o'),
            ('euler', 'forward Euler (not used)', LITERAL, 's'),
        ):
            values = [row[f'{name}_{key}'] for row in result['rows']]
            axis.plot(rate, values, color=colour, marker=marker, markersize=4, label=label)
        axis.set_title(title)
        axis.set_xscale('log')
        axis.set_xticks(rate, [str(r) for r in rate])
        axis.minorticks_off()
        axis.set_xlabel('rate [Hz]')
        axis.set_ylim(0.0)
    axes[0, 0].legend()
    axes[0, 1].annotate(
        f'w h = {result["rows"][0]["wh"]:g}',
        (rate[0], result['rows'][0]['euler_noisy_isu']),
        xytext=(8, -4),
        textcoords='offset points',
        color=GREY,
    )
    return {'rates': figure}


def findings(result: Result) -> Findings:
    """Compare the two discretisations over the rate, and where each becomes unstable."""
    rows = result['rows']
    first = rows[0]
    spread = {
        name: max(row[f'{name}_clean_itae'] for row in rows)
        / min(row[f'{name}_clean_itae'] for row in rows)
        for name in ('current', 'euler')
    }
    return {
        'current_spread': Finding(
            says='largest over smallest noise-free ITAE between rates, current observer, minus 1',
            values=spread['current'] - 1.0,
            high=SAME_ITAE,
        ),
        'euler_spread': Finding(
            says='largest over smallest noise-free ITAE between rates, Euler',
            values=spread['euler'],
            low=2.0,
        ),
        'excess': Finding(
            says=f'times the effort of the current observer that Euler takes at {first["wh"]:g}',
            values=first['euler_noisy_isu'] / first['current_noisy_isu'],
            low=EXCESS_AT_04[0],
            high=EXCESS_AT_04[1],
        ),
        'euler_stable': Finding(
            says='largest stable w h, Euler',
            values=result['euler_stable_to_wh'],
            low=0.6,
            high=0.95,
        ),
        'current_stable': Finding(
            says='largest stable w h, current observer',
            values=result['current_stable_to_wh'],
            low=2.0,
        ),
    }


SECTION = Section(
    name='rates',
    title='The rate of the loop',
    measure=measure,
    figures=figures,
    findings=findings,
)
