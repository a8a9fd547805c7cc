"""The block diagrams of figures 1 and 2 of the paper, as SVG."""

from __future__ import annotations

from collections.abc import Iterable

Point = tuple[float, float]
INK, SOFT, OUTER = '#1a1a1a', '#eef3f7', '#fdf3e1'
MAIN = 96.0  # height of the row from reference to output


def c_adrc() -> str:
    """Return figure 1: C-ADRC."""
    parts = [*_main_row(inner_label='v'), *_box(380, 190, 600, 250, 'LESO', '(3)')]
    parts += _wire((648, MAIN), (648, 208), (600, 208)) + _dot(648, MAIN)
    parts += _wire((830, MAIN), (830, 234), (600, 234)) + _dot(830, MAIN)
    parts += _wire((520, 190), (520, MAIN + 12)) + _text(526, 165, 'x̂₃') + _text(504, 122, '−')
    parts += _wire((380, 220), (215, 220), (215, MAIN + 12)) + _text(290, 212, 'x̂₁, x̂₂')
    parts += _text(199, 122, '−')
    return _document(900, 275, 'Block diagram of C-ADRC: one extended state observer', parts)


def n_adrc() -> str:
    """Return figure 2: N-ADRC, with the outer LESO fed by v'."""
    parts = [*_main_row(inner_label="v'")]
    parts += _circle(420) + _wire((350, MAIN), (408, MAIN)) + _text(374, MAIN - 8, 'v')
    parts += _box(500, 190, 620, 250, 'inner LESO', '(3)')
    parts += _box(380, 315, 620, 375, 'outer LESO', "(20) with v'", OUTER)
    parts += _wire((648, MAIN), (648, 208), (620, 208)) + _dot(648, MAIN)
    parts += _wire((830, MAIN), (830, 234), (620, 234)) + _dot(830, MAIN)
    parts += _wire((830, 234), (830, 345), (620, 345)) + _dot(830, 234)
    parts += _wire((520, 190), (520, MAIN + 12)) + _text(526, 165, 'x̂₃') + _text(504, 122, '−')
    parts += _wire((462, MAIN), (462, 315)) + _dot(462, MAIN) + _text(468, 285, "v'")
    parts += _wire((420, 315), (420, MAIN + 12)) + _text(396, 285, 'ẑ₃') + _text(404, 122, '−')
    parts += _wire((380, 345), (215, 345), (215, MAIN + 12)) + _text(290, 337, 'ẑ₁, ẑ₂')
    parts += _text(199, 122, '−')
    return _document(900, 400, 'Block diagram of N-ADRC: two nested observers', parts)


def _main_row(inner_label: str) -> list[str]:
    """Return reference, differentiator, feedback, the last sum, 1/b0 and the plant."""
    parts = [*_text(14, MAIN + 5, 'r'), *_wire((28, MAIN), (70, MAIN))]
    parts += _box(70, MAIN - 26, 150, MAIN + 26, 'TD', '(1)')
    parts += _wire((150, MAIN), (203, MAIN)) + _text(157, MAIN - 8, 'r₁, r₂') + _circle(215)
    parts += _wire((227, MAIN), (262, MAIN)) + _text(236, MAIN - 8, 'e')
    parts += _box(262, MAIN - 26, 350, MAIN + 26, 'NLSEF', 'fal')
    start = 350 if inner_label == 'v' else 432
    parts += _wire((start, MAIN), (508, MAIN)) + _circle(520)
    parts += _text(480, MAIN - 8, inner_label)
    parts += _wire((532, MAIN), (566, MAIN)) + _box(566, MAIN - 22, 616, MAIN + 22, '1/b₀')
    parts += _wire((616, MAIN), (690, MAIN)) + _text(652, MAIN - 8, 'u')
    parts += _box(690, MAIN - 30, 790, MAIN + 30, 'plant', '(26)')
    parts += _wire((740, 26), (740, MAIN - 30)) + _text(748, 38, 'w')
    parts += _wire((790, MAIN), (878, MAIN)) + _text(882, MAIN + 5, 'y')
    return parts


def _document(width: int, height: int, title: str, parts: Iterable[str]) -> str:
    body = '\n'.join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" font-family="Helvetica, Arial, DejaVu Sans, '
        f'sans-serif" font-size="15" fill="{INK}" role="img">\n<title>{title}</title>\n'
        '<defs><marker id="tip" viewBox="0 0 10 10" refX="10" refY="5" markerWidth="8" '
        'markerHeight="8" orient="auto"><path d="M0 1 L10 5 L0 9 z"/></marker></defs>\n'
        f'<rect width="{width}" height="{height}" fill="#fff"/>\n{body}\n</svg>\n'
    )


def _box(
    left: float,
    top: float,
    right: float,
    bottom: float,
    name: str,
    note: str = '',
    fill: str = SOFT,
) -> list[str]:
    middle, half = (left + right) / 2.0, (top + bottom) / 2.0
    parts = [
        f'<rect x="{left:g}" y="{top:g}" width="{right - left:g}" height="{bottom - top:g}" '
        f'rx="4" fill="{fill}" stroke="{INK}" stroke-width="1.4"/>',
        f'<text x="{middle:g}" y="{half + (-2 if note else 5):g}" text-anchor="middle">'
        f'{name}</text>',
    ]
    if note:
        parts.append(
            f'<text x="{middle:g}" y="{half + 17:g}" text-anchor="middle" font-size="12.5" '
            f'fill="#555">{note}</text>'
        )
    return parts


def _wire(*points: Point) -> list[str]:
    path = ' '.join(f'{x:g},{y:g}' for x, y in points)
    return [
        f'<polyline points="{path}" fill="none" stroke="{INK}" stroke-width="1.4" '
        'marker-end="url(#tip)"/>'
    ]


def _circle(x: float) -> list[str]:
    return [
        f'<circle cx="{x:g}" cy="{MAIN:g}" r="12" fill="#fff" stroke="{INK}" stroke-width="1.4"/>',
        f'<text x="{x:g}" y="{MAIN + 5:g}" text-anchor="middle">Σ</text>',
    ]


def _dot(x: float, y: float) -> list[str]:
    return [f'<circle cx="{x:g}" cy="{y:g}" r="3"/>']


def _text(x: float, y: float, text: str) -> list[str]:
    return [f'<text x="{x:g}" y="{y:g}" font-style="italic">{text}</text>']
