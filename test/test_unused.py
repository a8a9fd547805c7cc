"""Parameters that are said to be ignored have no effect, and the others have one."""

from __future__ import annotations

from math import sin
from typing import Any

import attrs
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.report.unused import unused
import pytest

# What is tried for each parameter, beside its default.
OTHER: dict[str, Any] = {
    'outer_bandwidth': 17.0,
    'levels': 4,
    'bandwidth_ratio': 0.37,
    'extended_states': 3,
    'eso_delta': 0.1,
    'fal_gains': (3.0, 2.0),
    'fal_exponents': (0.3, 0.6),
    'fal_delta': 0.5,
    'b0_source': 'reference',
}


def commands(settings: ControllerSettings) -> list[float]:
    controller = Controller(settings)
    return [
        controller.tick(sin(0.3 * k), 0.01, reference=[2.0 * sin(0.1 * k), 0.0, 0.0])
        for k in range(60)
    ]


@pytest.mark.parametrize(
    'given',
    [
        {'structure': 'conventional'},
        {'structure': 'nested', 'levels': 1},
        {'structure': 'nested', 'levels': 2},
        {'structure': 'cascade', 'levels': 3},
        {'structure': 'printed', 'feedback': 'fal'},
        {'structure': 'generalized', 'b0_table': (0.0, 1.0, 1.0, 2.0)},
        {'structure': 'nonlinear', 'levels': 3},
    ],
    ids=str,
)
def test_what_is_ignored_changes_no_command_and_the_rest_does(given: dict[str, Any]) -> None:
    settings = ControllerSettings(**given, command_min=-1e6, command_max=1e6)
    ignored, usual = unused(attrs.asdict(settings)), commands(settings)
    for name, value in OTHER.items():
        same = commands(attrs.evolve(settings, **{name: value})) == usual
        assert same == (name in ignored), name


def test_of_other_nodes_nothing_is_known() -> None:
    assert unused({}) == unused({'structure': 'nested', 'levels': 'two'}) == set()
    assert 'stall_action' in unused(attrs.asdict(ControllerSettings()))
    assert 'stall_action' not in unused(attrs.asdict(ControllerSettings(stall_time=1.0)))
