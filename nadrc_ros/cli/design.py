"""`nadrc design`: a first controller from requirements, with what theory expects of it."""

# ruff: noqa: UP045
from pathlib import Path
from typing import Annotated, Any, Optional, TYPE_CHECKING

from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.messages import note, say, warning
from nadrc_ros.cli.options import check_outputs, fields, in_options, takes
from nadrc_ros.tuning.design.requirements import Conflict, Requirements
import typer

if TYPE_CHECKING:
    from nadrc_ros.report.bode import Loop
    from nadrc_ros.tuning.design.candidates import Candidate
    from nadrc_ros.tuning.design.first_design import Expected, FirstDesign

_CURVE_POINTS = 800
# What one looks at first: the tuning, what it is good for, what it costs.
_FIRST_ROWS = 3


@takes(values=fields(Requirements, required='settling_time'))
def design(
    values: dict[str, Any],
    details: Annotated[
        bool, typer.Option('--details', help='Show all rows of the table, not three.')
    ] = False,
    out: Annotated[
        Optional[Path],
        typer.Option(help='Folder for design.yaml, scenario.yaml, bode.png and design.json.'),
    ] = None,
) -> None:
    """
    Design a first controller from requirements, and say how many observers are worth it.

    design.yaml holds the ROS parameters of a controller node, scenario.yaml the experiment for
    `nadrc simulate` with every design that was compared. How to choose: docs/choosing.md.

    Example: nadrc design --order 2 --settling-time 0.5 --rate 500 --noise-std 0.001 --out mine
    """
    check_outputs(out=out)
    with reporting():
        from nadrc_ros.adrc.fields import build
        from nadrc_ros.tuning.design.first_design import first_design

        try:
            found = first_design(build(Requirements, values))
            expected = found.expected()
        except Conflict as conflict:
            raise Conflict(in_options(str(conflict), Requirements)) from None
        _print(found, expected, details)
        if found.warning:
            warning(in_options(found.warning, Requirements))
        if out is not None:
            _write(out, found, expected)


def _print(found: 'FirstDesign', expected: 'dict[str, Expected]', details: bool) -> None:
    from nadrc_ros.cli.table import print_columns, print_text, Row
    from rich.text import Text

    heads = [
        Text(f'{c.name} *', 'bold') if c is found.chosen else c.name for c in found.candidates
    ]
    sine = found.wanted.disturbance_frequency
    columns = [_column(c, expected[c.name], sine) for c in found.candidates]
    rows = [Row(*about, _texts([column[about] for column in columns])) for about in columns[0]]
    print_columns(found.title, heads, rows if details else rows[:_FIRST_ROWS])
    more = f'; --details shows {len(rows) - _FIRST_ROWS} more rows, and how these were found'
    print_text(f'(* = chosen{"" if details else more})', 'dim')
    print_text(found.advice, 'bold')
    if details:
        print_text(in_options('\n'.join(found.rules), Requirements))
    pid = found.pid
    if pid is not None:
        kind = 'PI' if found.wanted.order == 1 else 'PID'
        gains = f'Kp {pid.kp:.4g}, Ki {pid.ki:.4g}' + (f', Kd {pid.kd:.4g}' if pid.kd else '')
        print_text(
            f'One observer is a filtered {kind} with {gains}, so its column also describes a '
            f'{kind} with the same noise.'
        )


def _texts(cells: 'list[str | float]') -> list[str]:
    """Return a row of the table: numbers with the same decimals."""
    from nadrc_ros.report.tables import shown_together

    if all(isinstance(cell, float) for cell in cells):
        return shown_together('', [float(cell) for cell in cells], plain=True)
    return list(map(str, cells))


def _column(
    candidate: 'Candidate', expected: 'Expected', sine: float
) -> 'dict[tuple[str, str], str | float]':
    """Return what is told of a candidate by the label of the row and what that means."""
    from math import degrees

    from nadrc_ros.adrc.design import bandwidths

    of = candidate.prediction
    margins = of.margins
    left = f'largest up to {sine:g} rad/s' if sine else 'integral of |y| after a step'
    observers = bandwidths(candidate.settings, candidate.levels)
    return {
        ('w [rad/s]', 'bandwidths of the observers'): ' / '.join(f'{w:.3g}' for w in observers),
        ('error', f'under the disturbance, {left}'): of.error,
        ('b / b0', 'gain margins'): f'{margins.gain_low:.2f} ... {margins.gain_high:.3g}',
        (
            'input gain [%]',
            'admissible error of b0, even a varying one',
        ): f'{100.0 * of.input_gain_margin:.0f}',
        ('phase [deg]', 'phase margin'): f'{degrees(margins.phase):.0f}',
        ('delay [ms]', 'delay margin'): 1e3 * margins.delay,
        ('modulus', 'distance of L from -1'): f'{margins.modulus:.2f}',
        ('settling [s]', 'time to stay within 2 %'): of.settling_time,
        ('noise', 'standard deviation of u'): of.command_noise,
        ('ITAE', 'of a step, then the disturbance'): expected.itae,
        ('ISU', 'of the same run'): expected.isu,
        ('noise ISU', 'of it by noise, on average'): expected.noise_isu,
        ('saturated [%]', 'share of the time'): f'{100.0 * expected.saturated:.1f}',
    }


def loops(found: 'FirstDesign') -> 'dict[str, Loop]':
    """Return the loops of all candidates, for a picture."""
    from math import pi

    from nadrc_ros.report.bode import Loop
    from nadrc_ros.tuning.design.prediction import curves
    import numpy as np

    wc, nyquist = found.chosen.settings.controller_bandwidth, pi * found.wanted.rate
    omega = np.geomspace(0.03 * wc, nyquist, _CURVE_POINTS)
    drawn = {}
    for candidate in found.candidates:
        m = candidate.prediction.margins
        responses = curves(candidate.settings, found.wanted, omega)
        gains = m.gain_low, m.gain_high
        drawn[candidate.name] = Loop(*responses, m.crossover, m.phase, gains)
    return drawn


def _write(out: Path, found: 'FirstDesign', expected: 'dict[str, Expected]') -> None:
    from nadrc_ros.atomic import write_json, write_whole
    from nadrc_ros.report.bode import draw_bode
    from nadrc_ros.report.style import render
    from nadrc_ros.scenario import dump
    from nadrc_ros.scenario.parameter_files import (
        about_reference,
        ANY_CONTROLLER,
        controller_parameters,
        parameter_text,
    )

    out.mkdir(parents=True, exist_ok=True)
    parameters = controller_parameters(found.chosen.settings, found.wanted.rate)
    band = found.wanted.disturbance_frequency
    figure = draw_bode(loops(found), found.chosen.name, found.title, band)
    write_whole(out / 'design.yaml', parameter_text({ANY_CONTROLLER: parameters}).encode())
    write_whole(out / 'scenario.yaml', dump(found.scenario).encode())
    write_whole(out / 'bode.png', render(figure, 'png'))
    write_json(out / 'design.json', 'design', found.document(expected))
    say(f'{out}: design.yaml, scenario.yaml, bode.png, design.json')
    if remark := about_reference(found.chosen.settings):
        note(f'{out / "design.yaml"}: {remark}')
