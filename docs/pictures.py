"""
Draws the pictures of runs that README and docs show: `python docs/pictures.py [NAME ...]`.

Each page on a single feature has a scenario of its own in examples/loops, whose controllers are
compared: output with reference above, command below, in docs/NAME.svg. A test draws all of them
anew and compares their texts and lines. Those of observers.md have theirs in examples/observers.
"""

from __future__ import annotations

from pathlib import Path
import re
import sys

from matplotlib import rc_context
from matplotlib.figure import Figure
from nadrc_ros.cli.design import loops
from nadrc_ros.records.recorded_run import RecordedRun
from nadrc_ros.records.simulated import recorded
from nadrc_ros.report.bode import draw_bode
from nadrc_ros.report.marks import title_of
from nadrc_ros.report.picture import draw, turning, unit
from nadrc_ros.report.roles import looks_of, REFERENCE
from nadrc_ros.report.style import render, STYLE
from nadrc_ros.scenario.files import find_scenario, load
from nadrc_ros.tuning.design.first_design import first_design
from nadrc_ros.tuning.design.requirements import Requirements
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
# Picture of observers.md -> what its panels show: a title, and the columns.
OBSERVERS = {
    'estimate': [
        ('output y and reference r', 'output', 'reference'),
        ('load and its estimate', 'disturbance_estimate', 'total_disturbance'),
    ],
    'bandwidth': [
        ('load and its estimates', 'disturbance_estimate', 'total_disturbance'),
        ('command u', 'command', ''),
    ],
    'nested': [
        ('load and its estimates', 'disturbance_estimate', 'total_disturbance'),
        ('output y, wanted at 0', 'output', ''),
    ],
}
NAMES = ('demo', 'choosing', *OBSERVERS, *PAGES)
# Detail of a line that is left out [px]: nobody sees it, and files are smaller.
_SIMPLIFIED = 0.15


def runs_of(path: Path) -> dict[str, RecordedRun]:
    """Return the runs of the controllers of a scenario, by name."""
    scenario = load(path)
    names = scenario.controllers
    return {name: recorded(path, scenario, name, scenario.run(name)) for name in names}


def demo() -> Figure:
    """Return the picture of the README: what `nadrc simulate demo --plot` draws."""
    path = find_scenario('demo')
    return draw(runs_of(path), title_of('demo', load(path)))


def choosing() -> Figure:
    """Return the Bode plots of the `nadrc design` at the top of choosing.md."""
    page = (HERE / 'choosing.md').read_text(encoding='utf-8')
    asked = dict(re.findall(r'--(\S+) ([\d.]+)', page.split('nadrc design')[1].split('--out')[0]))
    wanted = {name.replace('-', '_'): float(value) for name, value in asked.items()}
    found = first_design(Requirements(**wanted | {'order': int(wanted['order'])}))
    band = found.wanted.disturbance_frequency
    return draw_bode(loops(found), found.chosen.name, found.title, band)


def feature(page: str) -> Figure:
    """Return the picture of the page on a feature."""
    runs, window = runs_of(SCENARIOS / f'{page}.yaml'), PAGES[page]
    with rc_context(STYLE):
        figure = Figure(figsize=(8.0, 4.2), layout='constrained')
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        first = next(iter(runs.values()))
        dashed = {'color': REFERENCE, 'linestyle': '--', 'label': 'reference'}
        above.plot(first.time, turning(first)['reference'], **dashed)
        for name, look in looks_of(runs).items():
            run, line = runs[name], {'color': look.colour, 'linestyle': look.dash}
            above.plot(run.time, run.output, label=name.replace('_', ' '), **line)
            below.step(run.time, run.command, where='post', **line)
        above.set_title('output y and reference r' + unit(runs, 'output'))
        below.set_title('command u' + unit(runs, 'command'))
        below.set_xlabel('time [s]')
        below.set_xlim(window)
        for axes in (above, below):
            lines = [(line.get_xdata(), line.get_ydata()) for line in axes.get_lines()]
            seen = np.concatenate([y[(window[0] <= x) & (x <= window[1])] for x, y in lines])
            margin = 0.06 * float(np.ptp(seen)) or 1.0
            axes.set_ylim(float(seen.min()) - margin, float(seen.max()) + margin)
        above.legend(loc='best', ncols=2)
    return figure


def observers(name: str) -> Figure:
    """Return a picture of observers.md; small, since the README shows it in a row."""
    runs = runs_of(SCENARIOS.with_name('observers') / f'{name}.yaml')
    with rc_context(STYLE):
        figure = Figure(figsize=(5.0, 3.8), layout='constrained')
        panels = figure.subplots(2, 1, sharex=True)
        for axes, (title, column, truth) in zip(panels, OBSERVERS[name]):
            axes.set_title(title)
            if truth:
                first = next(iter(runs.values()))
                dashed = {'color': REFERENCE, 'linestyle': '--', 'label': truth.split('_')[-1]}
                axes.plot(first.time, first.column(truth), **dashed)
            for run, look in looks_of(runs).items():
                label = run.replace('_', ' ') if len(runs) > 1 else column.split('_')[-1]
                line = {'color': look.colour, 'label': label}
                axes.plot(runs[run].time, runs[run].column(column), **line)
            low, high = axes.get_ylim()
            axes.set_ylim(low, high + 0.3 * (high - low))  # where the legend is
            axes.legend(loc='upper right', ncols=3, columnspacing=1.0)
        panels[-1].set_xlabel('time [s]')
    return figure


def figure(name: str) -> Figure:
    """Return a picture."""
    special = {'demo': demo, 'choosing': choosing}
    with rc_context({'path.simplify_threshold': _SIMPLIFIED}):
        if name in special:
            return special[name]()
        return observers(name) if name in OBSERVERS else feature(name)


def svg(figure: Figure) -> bytes:
    """Return a picture as SVG, whose panels and lines are named, so that they can be compared."""
    with rc_context({'path.simplify_threshold': _SIMPLIFIED}):
        for i, axes in enumerate(figure.axes):
            axes.patch.set_gid(f'panel {i}')
            for k, line in enumerate(axes.get_lines()):
                line.set_gid(f'line {i} {k}')
        return render(figure, 'svg')


if __name__ == '__main__':
    for asked in sys.argv[1:] or NAMES:
        (HERE / f'{asked}.svg').write_bytes(svg(figure(asked)))
