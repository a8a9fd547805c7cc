"""What a figure writes, and where: that it is text, and that neither label nor line covers it."""

from __future__ import annotations

from itertools import combinations
from typing import Any
from unittest.mock import patch

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cbook import STEP_LOOKUP_MAP
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.text import Text
import numpy as np

# Boxes of texts may touch: they are as high as the font, whatever is written [px].
_TOUCH = 1.0


def drawn(figure: Figure) -> list[tuple[str, Any]]:
    """Return each text that is drawn, with its box [px]."""
    found: list[tuple[str, Any]] = []
    draw = Text.draw

    def note(text: Text, renderer: Any) -> None:
        if text.get_visible() and text.get_text().strip():
            found.append((text.get_text(), text.get_window_extent(renderer)))
        draw(text, renderer)

    canvas = FigureCanvasAgg(figure)
    with patch.object(Text, 'draw', note):
        canvas.draw()
    assert found
    return found


def flaws(figure: Figure) -> list[str]:
    """Return what is wrong with the texts: markup, on top of another, under a line, cut off."""
    texts = drawn(figure)
    wrong = [f'markup: {text}' for text, _ in texts if '$' in text or '\\' in text]
    width, height = figure.bbox.width, figure.bbox.height
    wrong += [
        f'cut off: {text}'
        for text, box in texts
        if box.x0 < -_TOUCH or box.y0 < -_TOUCH or box.x1 > width + 1 or box.y1 > height + 1
    ]
    for (one, box), (other, second) in combinations(texts, 2):
        across = min(box.x1, second.x1) - max(box.x0, second.x0)
        up = min(box.y1, second.y1) - max(box.y0, second.y0)
        if across > _TOUCH and up > _TOUCH:
            wrong.append(f'{one} covers {other} by {across:.0f} x {up:.0f} px')
    return wrong + _crossed(figure)


def _crossed(figure: Figure) -> list[str]:
    """Return the texts of legends that lines of their panel run through."""
    found = []
    for axes in figure.axes:
        legend = axes.get_legend()
        for text in legend.get_texts() if legend else ():
            for line in axes.get_lines():
                corners = STEP_LOOKUP_MAP[line.get_drawstyle()](*line.get_data(orig=False))
                path = Path(np.column_stack(corners)).transformed(line.get_transform())
                if len(path) and path.intersects_bbox(text.get_window_extent(), filled=False):
                    found.append(f'{text.get_text()} is crossed by line {line.get_label()}')
    return found
