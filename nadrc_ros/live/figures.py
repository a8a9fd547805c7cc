"""The plots of the live page, as figures of Bokeh that its scripts fill."""

from __future__ import annotations

from collections.abc import Iterable
import json
from typing import Any

from bokeh.document import Document
from bokeh.models import ColumnDataSource, LogAxis, Range1d
from bokeh.plotting import figure
from nadrc_ros.report.canvas import axis_look, base, line_look, WHITE
from nadrc_ros.report.roles import (
    COLOURS,
    DARK,
    GREY,
    GRID,
    INK,
    level_looks,
    Look,
    REFERENCE,
    STATES,
    TRUTH,
)

# As many levels as an observer can have.
_LEVELS = 6
_OWN = Look(COLOURS[0], 'solid')
# Lines of each plot over time: what the page calls them, in words, their look and width.
_LINES = {
    'output y': [
        ('measurement', 'measured y', Look(GREY, 'solid'), 0.8),
        ('reference', 'reference r', Look(REFERENCE, 'dotted'), 1.6),
        ('tracking', 'followed r1', Look(REFERENCE, 'dashdot'), 1.2),
        ('output_estimate', 'estimate of y', Look(COLOURS[1], 'dashed'), 1.1),
        ('output', 'true y', Look(TRUTH, 'solid'), 1.0),
        ('y', 'output y', _OWN, 1.6),
    ],
    'error e': [
        ('before', 'pinned before', Look(GREY, 'solid'), 1.4),
        ('error', 'error r − y', _OWN, 1.5),
    ],
    'command u': [
        ('limit_low', 'limits of the command', Look(INK, 'dotted'), 1.0),
        ('limit_high', '', Look(INK, 'dotted'), 1.0),
        ('applied', 'what acted', Look(GREY, 'dotted'), 1.3),
        ('command', 'command u', _OWN, 1.5),
    ],
    'disturbance': [
        ('truth', 'true disturbance', Look(TRUTH, 'solid'), 2.2),
        *(
            (f'level_{k}', f'level {k}', look, 1.1)
            for k, look in enumerate(level_looks(_LEVELS), 1)
        ),
        ('disturbance', 'estimate', _OWN, 1.5),
    ],
}
_HEIGHTS = {'output y': 200, 'error e': 130, 'command u': 140, 'disturbance': 170}
_SPECTRUM_HEIGHT = 230


def plots() -> str:
    """
    Return all that the page draws with as JSON.

    ``document`` has the figures in order, ``plots`` what they are called, which lines they have
    and whether they are over time, ``dark`` each color on a dark background.
    """
    time = Range1d(start=-10.0, end=0.0)
    made = [_timed(name, time) for name in _LINES]
    for each in made[:-1]:  # one axis serves all
        each.xaxis.major_label_text_font_size = '0px'
        each.xaxis.axis_label = None
    made[-1].xaxis.axis_label = 'time since this page\u2019s server began [s]'
    spectrum = _spectrum()
    document = Document()
    for each in (*made, spectrum):
        document.add_root(each)
    content: dict[str, Any] = {
        'document': document.to_json(deferred=False),
        'plots': [
            *({'name': name, 'timed': True, 'lines': _told(_LINES[name])} for name in _LINES),
            {
                'name': 'spectrum of u',
                'timed': False,
                'lines': _told([('spectrum', 'density of u', _OWN, 1.5)]),
            },
        ],
        'states': STATES,
        'dark': {WHITE: DARK[WHITE], **DARK},
    }
    return json.dumps(content, allow_nan=False, separators=(',', ':'))


def _told(lines: Iterable[tuple[str, str, Look, float]]) -> list[dict[str, Any]]:
    return [
        {'name': name, 'text': text, 'color': look.colour, 'dash': look.dash}
        for name, text, look, _ in lines
    ]


def _timed(name: str, time: Range1d) -> figure:
    """Return a figure over time: states and gaps behind its lines, marks of changes over them."""
    made = base(name, '', x_range=time, y_range=Range1d(start=-1.0, end=1.0))
    made.height = _HEIGHTS[name]
    shaded = ColumnDataSource({'left': [], 'right': [], 'color': []})
    made.quad(
        left='left', right='right', top=1.0, bottom=0.0, fill_color='color', fill_alpha=0.5,
        line_color=None, source=shaded, y_range_name='share', level='underlay', name='states',
    )  # fmt: skip
    gaps = ColumnDataSource({'left': [], 'right': []})
    made.quad(
        left='left', right='right', top=1.0, bottom=0.0, fill_color=GRID, fill_alpha=0.5,
        hatch_pattern='/', hatch_color=GREY, hatch_alpha=0.5, hatch_weight=0.5, line_color=None,
        source=gaps, y_range_name='share', level='underlay', name='gaps',
    )  # fmt: skip
    for line, _, look, width in _LINES[name]:
        _line(made, line, look, width)
    _marks(made)
    return made


def _spectrum() -> figure:
    """Return a figure over the frequency, with letters where the bandwidths are."""
    made = base(
        'density of u',
        'frequency [rad/s]; above: [Hz]',
        x_range=Range1d(start=1.0, end=1000.0),
        y_range=Range1d(start=1e-6, end=1.0),
        x_axis_type='log',
        y_axis_type='log',
    )
    made.height = _SPECTRUM_HEIGHT
    made.extra_x_ranges = {'hertz': Range1d(start=1.0, end=1000.0)}
    made.add_layout(LogAxis(x_range_name='hertz', **axis_look()), 'above')
    _line(made, 'spectrum', _OWN, 1.5)
    _marks(made)
    return made


def _line(made: figure, name: str, look: Look, width: float) -> None:
    source = ColumnDataSource({'x': [], 'y': []})
    made.line('x', 'y', source=source, name=name, **line_look(look, width))


def _marks(made: figure) -> None:
    marks = ColumnDataSource({'x': [], 'number': []})
    made.segment(
        x0='x', x1='x', y0=0.0, y1=1.0, line_color=INK, line_dash='dotted', source=marks,
        y_range_name='share', name='marks',
    )  # fmt: skip
    made.text(
        x='x', y=1.0, text='number', text_baseline='top', x_offset=3, text_color=INK,
        text_font_size='12px', background_fill_color=WHITE, background_fill_alpha=0.8,
        source=marks, y_range_name='share', name='numbers',
    )  # fmt: skip
