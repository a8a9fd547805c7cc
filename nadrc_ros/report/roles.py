"""
The colours of what is drawn: one for each role, in every picture, page and layout of a live plot.

A colour is named by what it is on white; :data:`DARK` has the same one for a dark background.
Lines differ from either background by a contrast of 3, inks by 4.5.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import cycle, islice, product
from typing import NamedTuple

from nadrc_ros.records.recorded_run import RecordedRun

INK, GREY, GRID = '#1a1a1a', '#6b7075', '#e4e4e4'
# Of runs. Neighbours differ in lightness too, for the colour-blind and for print in grey.
COLOURS = ('#005EA8', '#C97B00', '#00453A', '#C4569A', '#B5370A', '#3A9AD9')
LEVELS = ('#6A3D9A', '#6B7300', '#8A5A3C')
REFERENCE = TRUTH = INK
MEASUREMENT = GREY
# What a controller is doing, as a colour behind lines and of a strip.
STATES = {
    'in control': '#CFE8DC',
    'holding': '#FFE08A',
    'ramping': '#FFB98A',
    'safe': '#F29A9A',
    'off': '#D5D9DD',
}
DARK = {
    '#ffffff': '#16191d',
    INK: '#e8eaed',
    GREY: '#a2a9b0',
    GRID: '#32373d',
    **dict(zip(COLOURS, ('#4C9BE8', '#FFB733', '#24B59B', '#F29BCB', '#FF7847', '#A9DDFF'))),
    **dict(zip(LEVELS, ('#B89AE8', '#C5CC4A', '#D9A98A'))),
    **dict(zip(STATES.values(), ('#1F4636', '#665010', '#74401A', '#7A2A2A', '#454B52'))),
}
# The names that both matplotlib and Bokeh know.
_DASHES = ('solid', 'dashed', 'dashdot')


class Look(NamedTuple):
    """How the lines of one run look, wherever they are drawn."""

    colour: str
    dash: str


# Lines in the colour of their run, beside its command.
JOINED_LOOKS = {'applied': Look(GREY, 'dotted'), 'feed_forward': Look(GREY, 'dashed')}


def looks(names: Iterable[str]) -> dict[str, Look]:
    """Return the look of each run, in this order: the first 18 differ."""
    return dict(zip(names, cycle(Look(c, dash) for dash, c in product(_DASHES, COLOURS))))


def looks_of(runs: Mapping[str, RecordedRun]) -> dict[str, Look]:
    """
    Return the look of each run; its colour is its own, whatever runs it is beside.

    Runs of one colour differ in their dashes; only of more than three some get another colour.
    """
    every = [Look(c, dash) for dash, c in product(_DASHES, COLOURS)]
    numbers = {name: run.color % len(every) for name, run in runs.items()}
    found: dict[str, Look] = {}
    for name in sorted(runs, key=lambda name: (numbers[name], str(runs[name].path))):
        look = every[numbers[name]]
        alike = (each for each in every if each.colour == look.colour)
        free = (each for each in (look, *alike, *every) if each not in found.values())
        found[name] = next(free, look)
    return {name: found[name] for name in runs}


def level_looks(count: int) -> list[Look]:
    """Return the looks of the levels of an observer, the innermost first."""
    dashes = product(('dashed', 'dotted', 'dashdot'), LEVELS)
    return [Look(colour, dash) for dash, colour in islice(dashes, count)]
