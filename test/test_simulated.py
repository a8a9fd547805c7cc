"""A simulated run as one that was recorded: its figures to the bit, and all that happened."""

from __future__ import annotations

from pathlib import Path

from nadrc_ros.cli.app import app
from nadrc_ros.records.history import Change
from nadrc_ros.records.simulated import recorded
from nadrc_ros.scenario import loads, Scenario
from nadrc_ros.simulation.simulate import Result
import numpy as np
import pytest
from typer.testing import CliRunner

TEXT = """
plant: {name: paper, a3: 0.2}
reference: cosine
disturbance: sine
rate: 100
duration: 3
units: {output: rad, command: V}
limits: {command_min: -20, command_max: 20}
faults: {measurement: [{kind: silent, start: 1, duration: 0.8}]}
controllers: {mine: {inner_bandwidth: 12, b0: 2, measurement_timeout: 0.1, hold_time: 0.2}}
retune: [{time: 2.5, inner_bandwidth: 15}]
"""


@pytest.fixture(scope='module')
def made() -> tuple[Scenario, Result]:
    scenario = loads(TEXT)
    return scenario, scenario.run('mine')


def test_its_figures_are_those_of_the_simulation_to_the_bit(made: tuple[Scenario, Result]) -> None:
    scenario, result = made
    run = recorded(Path('mine.yaml'), scenario, 'mine', result)
    assert run.metrics == result.metrics
    np.testing.assert_array_equal(run.total_disturbance, result.total_disturbance)
    assert run.referred and run.units == scenario.units and run.gap_time == 0.0
    assert run.gaps == 80


def test_what_the_controller_did_is_known_with_its_times(made: tuple[Scenario, Result]) -> None:
    scenario, result = made
    run = recorded(Path('mine.yaml'), scenario, 'mine', result)
    states = [(each.begin, each.state) for each in run.states]
    told = ['in control', 'holding', 'ramping', 'safe', 'in control']
    assert [state for _, state in states] == told
    begins = [begin for begin, _ in states]
    # nothing came at 1.0 s for the first time, after the sample of 0.99 s
    assert begins[:3] == pytest.approx([0.0, 1.09, 1.29], abs=0.0101)
    assert begins[-1] == pytest.approx(1.81, abs=0.0101)  # two good samples
    faults = [(each.time, each.message) for each in run.events if each.kind == 'fault']
    assert faults == [(1.0, 'measurement silent'), (1.8, 'none')]
    assert run.changes == [Change(2.5, '/mine/controller', 'inner_bandwidth', 12, 15)]


def test_simulate_writes_a_page(tmp_path: Path) -> None:
    (tmp_path / 'mine.yaml').write_text(TEXT)
    page = tmp_path / 'page.html'
    done = CliRunner().invoke(app, ['simulate', str(tmp_path / 'mine.yaml'), '--page', str(page)])
    assert done.exit_code == 0 and f'report {page}' in done.output
    text = page.read_text(encoding='utf-8')
    for part in ('ITAE [rad', 'holding: no valid measurement', 'fault &#34;measurement silent'):
        assert part in text, part
