"""The picture of the floors in docs/architecture.md: an import may only point down."""

from __future__ import annotations

from pathlib import Path

INK, WITH_ROS, PURE, PLAIN = '#1a1a1a', '#dce9f5', '#e3f1e3', '#f4f4f4'
WIDTH, TALL, GAP, LEFT = 860, 46, 8, 34
# Floors from the top: name, what lives there, and the colour of what it may know.
FLOORS = (
    (
        ('cli', 'the nadrc command line', WITH_ROS),
        ('testing', "loops in a user's pytest", WITH_ROS),
    ),
    (('commission', 'from an unknown machine to a tuned loop', WITH_ROS),),
    (
        ('demo', 'a scenario as processes on the graph', WITH_ROS),
        ('live', 'a running loop on a page: see it, tune it', WITH_ROS),
    ),
    (
        ('nodes', 'controller, plant, reference, recorder', WITH_ROS),
        ('tuning', 'design, search, identification', PLAIN),
    ),
    (
        ('report', 'runs as tables, figures and pages', PLAIN),
        ('export', 'a controller as C for machines without ROS', PLAIN),
    ),
    (
        ('ros', 'what nodes share: parameters, topics, time', WITH_ROS),
        ('records', 'what is kept of runs, and reading it', PLAIN),
    ),
    (
        ('scenario', 'an experiment as YAML', PLAIN),
        ('theory', 'bounds, norms, margins', PLAIN),
    ),
    (('simulation', 'plants, signals, faults, the closed loop, figures of merit', PURE),),
    (('wiring', "a number inside a message's bytes, and its address", PURE),),
    (('adrc', 'the law under its fault policy', PURE),),
)
LEGEND = (
    (WITH_ROS, 'may know ROS 2'),
    (PLAIN, 'files, but no ROS'),
    (PURE, 'no ROS, clock, file or output'),
)


def draw() -> str:
    """Return the SVG."""
    parts, y = [], 12.0
    for floor in FLOORS:
        parts += _floor(floor, y)
        y += TALL + GAP
    parts += _arrow(12.0, y - GAP)
    height = y + 30
    for i, (colour, meaning) in enumerate(LEGEND):
        x = LEFT + 210 * i
        parts += [
            f'<rect x="{x}" y="{y + 4:g}" width="16" height="14" fill="{colour}" stroke="{INK}"/>',
            f'<text x="{x + 23}" y="{y + 15:g}" font-size="12">{meaning}</text>',
        ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:g}" '
        f'width="{WIDTH}" height="{height:g}" font-family="Helvetica, Arial, DejaVu Sans, '
        f'sans-serif" font-size="13" fill="{INK}" role="img">\n'
        '<title>The floors of the package: an import may only point down</title>\n'
        '<defs><marker id="tip" viewBox="0 0 10 10" refX="10" refY="5" markerWidth="8" '
        'markerHeight="8" orient="auto"><path d="M0 1 L10 5 L0 9 z"/></marker></defs>\n'
        f'<rect width="{WIDTH}" height="{height:g}" fill="#fff"/>\n'
        + '\n'.join(parts)
        + '\n</svg>\n'
    )


def _floor(floor: tuple[tuple[str, str, str], ...], y: float) -> list[str]:
    parts = []
    wide = (WIDTH - LEFT - 12 - GAP * (len(floor) - 1)) / len(floor)
    for i, (name, what, colour) in enumerate(floor):
        x = LEFT + i * (wide + GAP)
        parts += [
            f'<rect x="{x:g}" y="{y:g}" width="{wide:g}" height="{TALL}" rx="5" fill="{colour}" '
            f'stroke="{INK}" stroke-width="1.2"/>',
            f'<text x="{x + 12:g}" y="{y + 20:g}" font-size="15" font-weight="bold">{name}</text>',
            f'<text x="{x + 12:g}" y="{y + 37:g}" font-size="12">{what}</text>',
        ]
    return parts


def _arrow(top: float, bottom: float) -> list[str]:
    return [
        f'<path d="M16 {top:g} L16 {bottom:g}" stroke="{INK}" stroke-width="1.4" '
        'marker-end="url(#tip)"/>'
    ]


if __name__ == '__main__':
    Path(__file__).with_name('layers.svg').write_text(draw(), encoding='utf-8')
