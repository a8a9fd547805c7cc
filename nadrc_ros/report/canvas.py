"""What all interactive plots have in common: the look of axes, lines and marks."""

from __future__ import annotations

from typing import Any, Literal

from bokeh.models import LinearScale, Range1d
from bokeh.models.annotations import Label, Span
from bokeh.plotting import figure
from nadrc_ros.report.roles import GREY, GRID, INK, Look

HEIGHT = 240  # px
LEFT, RIGHT = 76, 14  # px: the same, so that the times lie above each other
WHITE = '#ffffff'


def base(y: str, x: str, **ranges: Any) -> figure:
    """Return an empty figure in the style of the house."""
    made = figure(
        height=HEIGHT, sizing_mode='stretch_width', tools='', toolbar_location=None,
        min_border_left=LEFT, min_border_right=RIGHT, outline_line_color=None,
        background_fill_color=WHITE, border_fill_color=WHITE, **ranges,
    )  # fmt: skip
    made.extra_y_ranges = {'share': Range1d(start=0.0, end=1.0)}
    made.extra_y_scales = {'share': LinearScale()}
    made.xaxis.axis_label, made.yaxis.axis_label = x, y
    for axis in made.axis:
        axis.update(**axis_look())
    made.grid.grid_line_color = GRID
    return made


def axis_look() -> dict[str, Any]:
    """Return the properties of an axis."""
    return {
        'axis_line_color': GREY,
        'axis_label_text_color': INK,
        'axis_label_text_font_style': 'normal',
        'axis_label_text_font_size': '12px',
        'axis_label_standoff': 4,
        'major_tick_line_color': GREY,
        'minor_tick_line_color': None,
        'major_label_text_color': GREY,
        'major_label_text_font_size': '12px',
    }


def line_look(look: Look, width: float = 1.5) -> dict[str, Any]:
    """Return the properties of a line."""
    return {'line_color': look.colour, 'line_dash': look.dash, 'line_width': width}


def across(place: float, dimension: Literal['width', 'height']) -> Span:
    """Return a dotted line at a place of one axis."""
    return Span(
        location=place, dimension=dimension, line_color=INK, line_dash='dotted', line_width=1
    )


def letter(place: float, text: str) -> Label:
    """Return a short text at the top of a figure, right of a place."""
    return Label(
        x=place, y=1.0, y_range_name='share', text=text, text_baseline='top', x_offset=3,
        text_color=INK, text_font_size='12px', background_fill_color=WHITE,
        background_fill_alpha=0.8,
    )  # fmt: skip
