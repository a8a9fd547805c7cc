"""The picture of the fault policy in docs/safety.md: states in a row, arcs between them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

WIDTH, HEIGHT, MIDDLE = 935, 305, 130
BOX, TALL, STEP, LEFT = 100, 46, 255, 35
# Between neighbours in the row, beyond a neighbour, back.
ABOVE, BELOW = 78, 52
INK, SOFT = '#1a1a1a', '#eef3f7'


def draw(names: Iterable[str], edges: Mapping[tuple[int, int], Iterable[str]]) -> str:
    """Return the SVG of states 0, 1, ... and the labelled transitions between them."""
    parts = [_state(i, name) for i, name in enumerate(names)]
    for (before, after), labels in sorted(edges.items()):
        parts += _edge(before, after, sorted(labels))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'width="{WIDTH}" height="{HEIGHT}" font-family="Helvetica, Arial, DejaVu Sans, '
        f'sans-serif" font-size="13" fill="{INK}" role="img">\n'
        '<title>States of the fault policy and what leads from one to another</title>\n'
        '<defs><marker id="tip" viewBox="0 0 10 10" refX="10" refY="5" markerWidth="8" '
        'markerHeight="8" orient="auto"><path d="M0 1 L10 5 L0 9 z"/></marker></defs>\n'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>\n'
        + '\n'.join(parts)
        + '\n</svg>\n'
    )


def _state(i: int, name: str) -> str:
    x, y = LEFT + i * STEP, MIDDLE - TALL / 2
    return (
        f'<rect x="{x}" y="{y:g}" width="{BOX}" height="{TALL}" rx="8" fill="{SOFT}" '
        f'stroke="{INK}" stroke-width="1.4"/>\n'
        f'<text x="{x + BOX / 2:g}" y="{MIDDLE + 5}" text-anchor="middle" font-size="15">'
        f'{name}</text>'
    )


def _edge(before: int, after: int, labels: list[str]) -> list[str]:
    """Return a line to the next state, an arc above to one beyond it, or an arc below back."""
    if after == before + 1:
        x, end, y = LEFT + before * STEP + BOX, LEFT + after * STEP, MIDDLE
        path = f'M{x} {y} L{end} {y}'
        return [_path(path), *_labels((x + end) / 2, y - 9, labels, upwards=True)]
    span = abs(after - before)
    x, end = (LEFT + i * STEP + BOX / 2 for i in (before, after))
    if after > before:
        y, top = MIDDLE - TALL / 2, MIDDLE - TALL / 2 - ABOVE
        path = f'M{x:g} {y:g} C{x:g} {top:g} {end:g} {top:g} {end:g} {y:g}'
        return [_path(path), *_labels((x + end) / 2, y - 0.75 * ABOVE - 7, labels, upwards=True)]
    y, depth = MIDDLE + TALL / 2, BELOW * span
    end += 14 * (2 - span)  # the arcs end side by side, and do not cross
    path = f'M{x:g} {y:g} C{x:g} {y + depth:g} {end:g} {y + depth:g} {end:g} {y:g}'
    return [_path(path), *_labels((x + end) / 2, y + 0.75 * depth + 16, labels, upwards=False)]


def _path(path: str) -> str:
    return (
        f'<path d="{path}" fill="none" stroke="{INK}" stroke-width="1.4" marker-end="url(#tip)"/>'
    )


def _labels(x: float, y: float, labels: list[str], *, upwards: bool) -> list[str]:
    first = y - 16 * (len(labels) - 1) if upwards else y
    return [
        f'<text x="{x:g}" y="{first + 16 * i:g}" text-anchor="middle">{label}</text>'
        for i, label in enumerate(labels)
    ]
