"""The palette of roles: told apart, seen on either background, and the same in every tool."""

from __future__ import annotations

from itertools import combinations, pairwise
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

from nadrc_ros.report import roles
import numpy as np
import pytest

CONFIG = Path(__file__).resolve().parents[1] / 'config'
LINES = (*roles.COLOURS, *roles.LEVELS, roles.INK, roles.GREY)
OF_TOPICS = {
    '/reference': roles.REFERENCE,
    '/measurement': roles.MEASUREMENT,
    '/plant/output': roles.COLOURS[0],
    '/command': roles.COLOURS[0],
    '/controller/output_estimate': roles.COLOURS[1],
    '/plant/total_disturbance': roles.TRUTH,
    '/controller/total_disturbance': roles.COLOURS[0],
    '/controller/level_1/disturbance': roles.LEVELS[0],
    '/controller/level_2/disturbance': roles.LEVELS[1],
}


def luminance(colour: str) -> float:
    """Return the relative luminance of WCAG 2.1."""
    share = np.array([int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)])
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


def contrast(one: str, other: str) -> float:
    low, high = sorted(map(luminance, (one, other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize('colour', LINES)
def test_every_line_is_seen_on_white_and_on_a_dark_page(colour: str) -> None:
    least = 4.5 if colour in (roles.INK, roles.GREY) else 3.0
    assert contrast(colour, '#ffffff') >= least
    assert contrast(roles.DARK[colour], roles.DARK['#ffffff']) >= least


def test_states_can_be_written_on() -> None:
    for colour in roles.STATES.values():
        assert contrast(colour, roles.INK) >= 4.5
        assert contrast(roles.DARK[colour], roles.DARK[roles.INK]) >= 4.5


def test_twelve_runs_look_different_and_neighbours_differ_in_grey() -> None:
    looks = roles.looks(f'run {k}' for k in range(18))
    assert len(set(looks.values())) == 18
    light = [luminance(look.colour) ** (1 / 3) for look in looks.values()][:6]
    assert all(abs(a - b) > 0.05 for a, b in pairwise(light))
    assert len({luminance(c) for c in LINES}) == len(LINES)
    assert all(a != b for a, b in combinations(roles.level_looks(6), 2))


def runs(*colors: int) -> Any:
    return {
        f'{k:02}': SimpleNamespace(color=c, path=Path(f'{k:02}')) for k, c in enumerate(colors)
    }


def test_a_run_keeps_its_color_whatever_runs_it_is_beside() -> None:
    every = runs(3, 0, 7, 5, 1, 9)  # 9 and 3, 7 and 1 are of one colour
    whole = roles.looks_of(every)
    for name, run in every.items():
        assert roles.looks_of({name: run})[name] == whole[name]
    assert roles.looks_of(dict(reversed(every.items()))) == whole
    assert len(set(whole.values())) == 6 and whole['00'].colour == whole['05'].colour


def test_runs_of_one_color_differ_in_their_dashes_then_in_color() -> None:
    alike = [*roles.looks_of(runs(*[4] * 18)).values()]
    assert len(set(alike)) == 18
    assert {each.colour for each in alike[:3]} == {roles.COLOURS[4]}


def test_live_plots_have_the_colours_of_the_roles() -> None:
    root = ElementTree.parse(CONFIG / 'plotjuggler.xml').getroot()
    for curve in root.iter('curve'):
        topic = curve.attrib['name'].removesuffix('/data')
        assert curve.attrib['color'] == OF_TOPICS[topic], topic
    layout = json.loads((CONFIG / 'foxglove.json').read_text(encoding='utf-8'))
    for panel in layout['configById'].values():
        for path in panel.get('paths', []):
            topic = path['value'].removesuffix('.data')
            assert path['color'] == roles.DARK[OF_TOPICS[topic]], topic
