"""The report of a commissioning: each step with what was said, and plots of what was seen."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import attrs
from bokeh.embed import components
from bokeh.layouts import column
from bokeh.model import Model
from bokeh.models import BoxZoomTool, PanTool, ResetTool
from bokeh.resources import INLINE
from nadrc_ros.report.canvas import base, line_look
from nadrc_ros.report.roles import looks
from nadrc_ros.tuning.commission.machine import Samples
import numpy as np

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.2rem; margin-top: 2rem; }
p { margin: .3rem 0; overflow-wrap: anywhere; }
.plot { background: #fff; margin: .5rem 0; }
"""


@attrs.frozen(kw_only=True)
class Step:
    """One step: its title, what was said in it, and what was seen, in as many parts as it had."""

    title: str
    lines: Sequence[str]
    samples: Sequence[Samples] = ()


def page(title: str, steps: Sequence[Step]) -> str:
    """Return the whole page, which needs nothing else, not even a network."""
    plots: dict[str, Model] = {
        f'{i}': column(*map(_plots, step.samples), sizing_mode='stretch_width')
        for i, step in enumerate(steps)
        if any(len(samples.time) for samples in step.samples)
    }
    script, divisions = components(plots) if plots else ('', {})
    parts = []
    for i, step in enumerate(steps):
        said = ''.join(f'<p>{escape(line)}</p>' for line in step.lines)
        drawn = divisions.get(f'{i}', '')
        head = f'<h2>{escape(step.title)}</h2>'
        parts.append(f'<section>{head}{said}<div class="plot">{drawn}</div></section>')
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{escape(title)}</title><style>{_STYLE}</style>'
        f'<script>{INLINE.js_raw[0]}</script>'  # of its parts none but the plots
        '<script>Bokeh.logger.set_level("error")</script></head>'
        f'<body><main><h1>{escape(title)}</h1>{"".join(parts)}</main>{script}</body></html>'
    )


def _plots(samples: Samples) -> Any:
    """Return the output above the command, with one time axis."""
    time = samples.time - (samples.time[0] if len(samples.time) else 0.0)
    look = looks(['run'])['run']
    drawn = [('output', samples.measurement)]
    if np.isfinite(samples.command).any():
        drawn.append(('command', samples.command))
    figures: list[Any] = []
    for name, values in drawn:
        more = {'x_range': figures[0].x_range} if figures else {}
        figure = base(name, 'time [s]', **more)
        figure.add_tools(PanTool(), BoxZoomTool(), ResetTool())
        figure.toolbar_location, figure.toolbar.logo = 'above', None
        figure.toolbar.active_drag = None  # or a finger could not scroll the page
        known = np.isfinite(values)
        draw = figure.step if name == 'command' else figure.line
        mode = {'mode': 'after'} if name == 'command' else {}
        draw(time[known], values[known], **line_look(look), **mode)
        figures.append(figure)
    return column(*figures, sizing_mode='stretch_width')
