"""A reference on its topic alone, on a real graph and in lockstep."""

from __future__ import annotations

from pathlib import Path

from nadrc_ros.scenario import load
from nadrc_ros.testing import scenario_loop
import numpy as np
import pytest

SCENARIO = Path(__file__).parents[2] / 'examples' / 'loops' / 'reference.yaml'


@pytest.mark.realtime
def test_on_a_graph_it_is_followed_with_the_derivatives_that_it_shows() -> None:
    scenario = load(SCENARIO).changed(duration=2.5)
    with scenario_loop(scenario, 'auto') as loop:
        assert loop.controller.count_publishers('reference/rate') == 0
        result = loop.finish()
    off = np.sqrt(np.mean((result.reference - result.output) ** 2))
    offline = scenario.run('none')
    without = np.sqrt(np.mean((offline.reference - offline.output) ** 2))
    assert off < 0.3 * without


@pytest.mark.parametrize('name', ('auto', 'none'))
def test_p18_in_lockstep_it_gives_the_bits_of_the_simulation(name: str) -> None:
    scenario = load(SCENARIO).changed(duration=1.5)
    with scenario_loop(scenario, name, lockstep=True) as loop:
        result = loop.finish()
    offline = scenario.run(name)
    assert [x.hex() for x in result.command] == [x.hex() for x in offline.command]
    assert result.status_counts == offline.status_counts
