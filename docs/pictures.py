"""
Draws the runs that the pages on single features show: `python docs/pictures.py [PAGE ...]`.

Each page has a scenario of its own in examples/loops, whose controllers are compared: output with
reference above, command below, in docs/PAGE.svg.
"""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
import sys

from matplotlib import rc_context
from matplotlib.figure import Figure
from nadrc_ros.report.picture import STYLE, turning
from nadrc_ros.report.roles import COLOURS, INK
from nadrc_ros.scenario.files import load
from nadrc_ros.simulation.simulate import Result
import numpy as np

HERE = Path(__file__).parent
SCENARIOS = HERE.parent / 'examples' / 'loops'
# Page -> from when to when it is shown [s].
PAGES: dict[str, tuple[float, float]] = {
    'gain_table': (0.0, 8.5),
    'rest': (0.0, 9.0),
    'angles': (0.0, 5.0),
    'applied': (0.0, 6.0),
    'feed_forward': (0.5, 4.0),
    'cascade': (0.0, 7.0),
    'known_dynamics': (0.0, 2.5),
    'vibration': (0.0, 2.0),
    'reference': (0.2, 2.8),
    'delay': (0.3, 4.0),
}


def runs(page: str) -> dict[str, Result]:
    """Return the runs of the controllers that a page compares, by name."""
    scenario = load(SCENARIOS / f'{page}.yaml')
    return {name: scenario.run(name) for name in scenario.controllers}


def digest(results: dict[str, Result]) -> str:
    """Return a short hash of what is drawn, to six digits, by which a stale picture is told."""
    sha = sha256()
    for name, result in results.items():
        sha.update(name.encode())
        for values in (result.reference, result.output, result.command):
            sha.update(' '.join(f'{value:.6g}' for value in values).encode())
    return sha.hexdigest()[:16]


def draw(page: str) -> None:
    """Write the picture of a page."""
    results, window = runs(page), PAGES[page]
    with rc_context(STYLE | {'svg.fonttype': 'none', 'svg.hashsalt': page}):
        figure = Figure(figsize=(8.0, 4.2), layout='constrained')
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        first = next(iter(results.values()))
        reference = turning(first)['reference']
        above.plot(first.time, reference, color=INK, linestyle='--', label='reference')
        for (name, result), colour in zip(results.items(), COLOURS, strict=False):
            above.plot(result.time, result.output, color=colour, label=name.replace('_', ' '))
            below.step(result.time, result.command, where='post', color=colour)
        above.set_title('output y and reference r')
        below.set_title('command u')
        below.set_xlabel('time [s]')
        below.set_xlim(window)
        for axes in (above, below):
            lines = [(line.get_xdata(), line.get_ydata()) for line in axes.get_lines()]
            seen = np.concatenate([y[(window[0] <= x) & (x <= window[1])] for x, y in lines])
            margin = 0.06 * float(np.ptp(seen)) or 1.0
            axes.set_ylim(float(seen.min()) - margin, float(seen.max()) + margin)
        above.legend(loc='best', frameon=False, ncols=2)
        figure.savefig(
            HERE / f'{page}.svg', metadata={'Date': None, 'Description': digest(results)}
        )


if __name__ == '__main__':
    for asked in sys.argv[1:] or PAGES:
        draw(asked)
