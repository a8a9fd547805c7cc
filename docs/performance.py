"""
Writes the tables of docs/performance.md from docs/performance.json.

    python docs/performance.py [out/bench/bench.json]

A file that is named, as ``make bench`` writes it, first becomes docs/performance.json.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import json
from pathlib import Path
import sys
from typing import Any

from marked import filled

PAGE = Path(__file__).with_name('performance.md')
FIGURES = PAGE.with_suffix('.json')
PARTS = ('step', 'simulate', 'batch', 'ros_latency', 'axes', 'start_up')
NAMES = {
    'nadrc_n2_k2': 'this package, n = 2, K = 2',
    'nadrc_n2_k1': 'this package, n = 2, one observer',
    'nadrc_n2_k4': 'this package, n = 2, K = 4',
    'nadrc_n4_k2': 'this package, n = 4, K = 2',
    'nadrc_n2_k2_jitter': 'this package, n = 2, K = 2, another time step each call',
    'pyadrc_statespace': 'pyadrc, StateSpace (n = 2, one observer)',
    'pyadrc_feedbacktf': 'pyadrc, FeedbackTF (n = 2)',
    'simple_pid': 'simple-pid',
    'nadrc': 'this package, `simulate`',
    'nadrc_loop': 'this package, its compiled loop alone',
    'nadrc_plain': 'this package, plain Python',
    'c': 'the same loop in C by hand, `cc -O2`',
    'pyadrc': 'pyadrc in a Python loop',
    'python_control': 'python-control, `input_output_response`',
    'solve_ivp': 'scipy, `solve_ivp`',
}
Figures = Mapping[str, Any]


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table whose first column is text and whose others are figures."""
    head = list(head)
    lines = [head, ['---', *['---:'] * (len(head) - 1)], *rows]
    return '\n'.join('| ' + ' | '.join(map(shown, line)) + ' |' for line in lines)


def shown(cell: object) -> str:
    """Return a figure with the digits that it is worth."""
    if not isinstance(cell, float):
        return str(cell)
    return f'{cell:,.0f}' if abs(cell) >= 1000.0 else f'{cell:.3g}'


def compared(figures: Figures, base: str, key: str) -> list[tuple[str, float]]:
    """Return name and figure relative to that of ``base``."""
    return [(NAMES[name], row[key] / figures[base][key]) for name, row in figures.items()]


def step(figures: Figures) -> str:
    head = '', 'relative to pyadrc (1 = same, less is faster)', 'median us', 'p99 us'
    ratios = compared(figures, 'pyadrc_statespace', 'median_us')
    rows = [[*ratio, *own.values()] for ratio, own in zip(ratios, figures.values())]
    return table(head, rows)


def simulate(figures: Figures) -> str:
    head = '', 'relative to `simulate` (less is faster)', 'ns per step'
    ratios = compared(figures, 'nadrc', 'ns_per_step')
    return table(head, [[*ratio, *own.values()] for ratio, own in zip(ratios, figures.values())])


def batch(figures: Figures) -> str:
    def ratio(name: str, base: str) -> list[float]:
        return [figures[name] / figures[base]] if name in figures else []

    growth = {
        'one level instead of two': 'k1',
        'four levels': 'k4',
        'order 1 instead of 2': 'n1',
        'order 4': 'n4',
        'ten times the steps': '10x_steps',
        'ten times the runs': '10x_runs',
    }
    rows: list[list[object]] = [
        ['two cores against one', *ratio('runs_per_s_2core', 'runs_per_s_1core')],
        ['the same, the loop in C by hand', *ratio('c_per_s_2core', 'c_per_s_1core')],
        ['one core against the loop in C', *ratio('runs_per_s_1core', 'c_per_s_1core')],
        *(
            [f'time per run with {words}', *ratio(f'us_per_run_{case}', 'us_per_run_base')]
            for words, case in growth.items()
        ),
        ['runs per second on one core', figures['runs_per_s_1core']],
        ['runs per second on two cores', figures['runs_per_s_2core']],
        ['peak memory of 10^5 short runs, MB', figures['peak_mb']],
        *(
            [f'peak memory of runs with {name.split("_")[2]} steps, MB', value]
            for name, value in figures.items()
            if name.startswith('peak_mb_')
        ),
    ]
    return table(('', 'value'), [row for row in rows if len(row) == 2])


def ros_latency(figures: Figures) -> str:
    head = (
        *('', 'median, times echo', 'p99, times echo', 'CPU, times echo'),
        *('median ms', 'p99 ms', 'CPU %', 'missed %', 'echo: median ms', 'p99 ms', 'CPU %'),
        'missed %',
    )
    keys = 'median_ms', 'p99_ms', 'cpu_percent', 'missed'
    rows: list[list[object]] = []
    for rate, row in figures.items():
        own, echo = ([row[name][key] for key in keys] for name in ('nadrc', 'echo'))
        ratios = [a / b for a, b in zip(own[:3], echo[:3])]
        rows.append([f'{rate} Hz', *ratios, *own, *echo])
    return table(head, rows)


def axes(figures: Figures) -> str:
    head = (
        *('axes', 'missed %, above bare', 'CPU, times bare'),
        *('missed %', 'CPU %', 'bare: missed %', 'CPU %'),
    )
    keys = 'missed', 'cpu_percent'
    rows: list[list[object]] = []
    for count, own in figures.items():
        bare = own['echo']
        compared = [own['missed'] - bare['missed'], own['cpu_percent'] / bare['cpu_percent']]
        rows.append([count, *compared, *(each[key] for each in (own, bare) for key in keys)])
    return table(head, rows)


def start_up(figures: Figures) -> str:
    rows: list[list[object]] = [
        ['against a bare node', figures['first_command_s'] / figures['bare_node_s']],
        ['first command, median s', figures['first_command_s']],
        ['the fastest start s', figures['fastest_first_command_s']],
        ['the slowest start s', figures['slowest_first_command_s']],
        ['a bare node, median s', figures['bare_node_s']],
        ['of it our own imports s', figures['own_imports_s']],
    ]
    return table(('', 'value'), rows)


def page() -> str:
    """Return the page with its tables as they have to be."""
    figures = json.loads(FIGURES.read_text(encoding='utf-8'))
    return filled(PAGE, {part: globals()[part](figures[part]) for part in PARTS})


if __name__ == '__main__':
    if len(sys.argv) > 1:
        FIGURES.write_text(Path(sys.argv[1]).read_text(encoding='utf-8'), encoding='utf-8')
    PAGE.write_text(page(), encoding='utf-8')
