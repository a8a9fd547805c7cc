"""Units of output and command: in scenarios, in records, on axes and in tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.demo.loop_parameters import node_parameters
from nadrc_ros.nodes.recorder_settings import unit_fields
from nadrc_ros.records.history import ABOUT
from nadrc_ros.records.read_run import read_runs
from nadrc_ros.records.source import Source
from nadrc_ros.report.page import page
from nadrc_ros.scenario import dump, loads
from nadrc_ros.scenario.parameter_files import parameter_text
from nadrc_ros.scenario.units import Units
from page_helpers import unpacked
import pytest
from report_helpers import describe, record

SCENARIO = 'plant: paper\nreference: cosine\ncontrollers: {mine: {}}\n'


def test_a_scenario_has_units_which_its_recorders_are_told(tmp_path: Path) -> None:
    scenario = loads(SCENARIO + "units: {output: rad, command: '%'}\n")
    assert scenario.units == Units(output='rad', command='%')
    assert loads(dump(scenario)) == scenario
    assert 'units' not in dump(loads(SCENARIO))
    told = node_parameters(scenario, 'mine', tmp_path, lockstep=True)['recorder']
    assert {name: told[name] for name in unit_fields()} == {
        'units.output': 'rad',
        'units.command': '%',
    }


@pytest.mark.parametrize('unit', ['N', 'n', 'y', 'Y'])
def test_a_unit_that_ros_would_take_for_a_truth_value_is_quoted(unit: str) -> None:
    assert f"'{unit}'" in parameter_text({'/recorder': {'units.command': unit}})


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ('{outputs: rad}', 'units.outputs'),
        ('{output: 1}', 'units.output = 1: must be text'),
        ('{command: "V\\n"}', 'units.command'),
        ('{command: "of which there are too many"}', 'at most 20 printable characters'),
        ('rad', 'units'),
    ],
)
def test_what_is_no_unit_is_refused_by_name(given: str, message: str) -> None:
    with pytest.raises(UserError) as caught:
        loads(f'{SCENARIO}units: {given}\n')
    assert message in str(caught.value)


def test_units_follow_from_those_of_output_and_command() -> None:
    units = Units(output='m/s', command='V')
    assert [units.of(name) for name in ('output', 'error', 'command', 'truth')] == [
        *('m/s', 'm/s', 'V', ''),
    ]
    assert units.of('truth', 1) == '(m/s)/s' and units.of('level_2', 2) == '(m/s)/s²'
    figures = [units.of_figure(name) for name in ('itae', 'isu', 'rmse', 'saturated_fraction')]
    assert figures == ['m/s·s²', 'V²·s', 'm/s', '']
    nothing = Units()
    assert not any(nothing.of(name, 2) for name in ('output', 'command', 'truth'))
    assert not any(nothing.of_figure(name) for name in ('itae', 'iae', 'isu', 'max_command'))


@pytest.mark.parametrize('told', [{'output': 'rad', 'command': 'V'}, {'output': 7}, ['rad']])
def test_units_of_a_record_are_on_every_axis_and_in_the_table(told: Any, tmp_path: Path) -> None:
    run = record(tmp_path)
    describe(run, '/mine', b0=2.0)
    about = json.loads((run / ABOUT).read_text())
    (run / ABOUT).write_text(json.dumps(about | {'units': told}))
    text = page(read_runs([run]))
    drawn = unpacked(text, 'data').decode()
    good = told == {'output': 'rad', 'command': 'V'}
    for label in ('output y [rad]', 'error e [rad]', 'command u [V]', 'disturbance [rad/s²]'):
        assert (json.dumps(label)[1:-1] in drawn) == good, label
    for label in ('ITAE [rad·s²]', 'max |u| [V]', '<span class="unit">rad</span>'):
        assert (label in text) == good, label


def test_units_in_the_headings_of_a_csv_file_are_those_of_its_run(tmp_path: Path) -> None:
    log = tmp_path / 'log.csv'
    rows = ''.join(f'{k / 100},{k},{-k},1\n' for k in range(9))
    log.write_text(f't [s],angle [rad],torque (N m),r [rad]\n{rows}')
    (run,) = read_runs(
        [log], Source(signals={'measurement': 'angle', 'command': 'torque'})
    ).values()
    assert run.units == Units(output='rad', command='N m')
    assert 'ISU [(N m)²·s]' in page({'log': run})
    log.write_text(f't,y [the one that was filtered],u,r\n{rows}')
    (run,) = read_runs([log]).values()
    assert run.units == Units()
