"""What a live page compares, predicts and breaks: without ROS."""

from __future__ import annotations

from math import nan

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.live.comparison import figure_settings, figures, same_stretch
from nadrc_ros.live.plant_faults import FAULTS, listed, PlantFaults
from nadrc_ros.live.prediction import prediction
from nadrc_ros.live.saving import saved
import numpy as np
from numpy.typing import NDArray
import pytest
import yaml

Array = NDArray[np.float64]
SIGNALS = ('reference', 'measurement', 'command', 'output')


def record(*, until: float = 40.0, jitter: float = 4e-4) -> Array:
    """Return rows of a sine of 5 s, with an error that is smaller from 20 s on."""
    rng = np.random.default_rng(1)
    t = np.arange(0.0, until, 0.005)
    t[1:] += rng.uniform(-jitter, jitter, len(t) - 1)
    r = np.sin(2.0 * np.pi * t / 5.0)
    y = r - np.where(t < 20.0, 0.1, 0.03) * np.cos(2.0 * np.pi * t / 5.0)
    return np.column_stack([t, r, y, 2.0 * r, np.full(len(t), nan)])


def test_the_latest_stretch_with_the_same_reference_is_found() -> None:
    rows = record()
    begin, why = same_stretch(rows[:, :2], 3.0, 13.0, 20.0)
    assert not why and begin == pytest.approx(28.0, abs=0.01)


def test_a_short_hole_in_the_reference_is_bridged_and_a_long_one_is_in_no_stretch() -> None:
    rows = record()
    rows[[1000, 4200, 7000], 1] = nan  # at 5, 21 and 35 s
    begin, why = same_stretch(rows[:, :2], 3.0, 8.0, 20.0)
    assert not why and begin == pytest.approx(33.0, abs=0.01)
    rows[5900:6000, 1] = rows[6800:, 1] = nan
    begin, why = same_stretch(rows[:, :2], 3.0, 8.0, 20.0)
    assert not why and begin == pytest.approx(23.0, abs=0.01)
    rows[900:1000, 1] = nan
    assert 'not kept whole' in same_stretch(rows[:, :2], 3.0, 8.0, 20.0)[1]


@pytest.mark.parametrize(
    ('part', 'why'),
    [
        (record(until=25.0), 'are needed'),
        (np.vstack([record()[:4000], record()[4000:] * [1, 0.5, 1, 1, 1]]), 'not been the same'),
        (record()[4000:], 'not kept'),
    ],
)
def test_what_is_not_comparable_says_why(part: Array, why: str) -> None:
    begin, said = same_stretch(part[:, :2], 3.0, 13.0, 20.0)
    assert begin != begin and why in said


def test_a_reference_whose_steps_come_a_sample_earlier_or_later_is_the_same() -> None:
    rows, late = record(), np.random.default_rng(2).integers(0, 2, 20)
    edge = np.cumsum(np.full(20, 2.0)) + 0.005 * late - 0.003
    rows[:, 1] = np.searchsorted(edge, rows[:, 0]) % 2
    begin, why = same_stretch(rows[:, :2], 3.0, 13.0, 20.0)
    assert not why and begin == pytest.approx(27.0, abs=0.02)
    rows[rows[:, 0] > 20.0, 1] *= 1.05
    assert same_stretch(rows[:, :2], 3.0, 13.0, 20.0)[1]


def test_a_held_reference_is_always_the_same() -> None:
    rows = record()
    rows[:, 1] = 1e6
    begin, why = same_stretch(rows[:, :2], 3.0, 8.0, 20.0)
    assert not why and begin + 5.0 == pytest.approx(rows[-1, 0], abs=0.02)


def test_the_figures_are_those_of_the_stretch() -> None:
    rows = record(jitter=0.0)
    part = rows[(rows[:, 0] >= 5.0) & (rows[:, 0] < 15.0)]
    told = {'command_min': -1.9, 'command_max': 2.0, 'structure': 'nested', 'inner_bandwidth': 9.0}
    found = figures(SIGNALS, part, 15.0, {}, told)
    assert found['rmse'] == pytest.approx(0.1 / 2**0.5, rel=1e-3)
    assert found['max_error'] == pytest.approx(0.1, rel=1e-3)
    assert found['itae'] == pytest.approx(50.0 * 0.1 * 2.0 / np.pi, rel=0.02)
    assert found['max_command'] == pytest.approx(2.0, rel=1e-6)


def test_settings_of_figures_that_make_no_sense_are_left_out() -> None:
    assert figure_settings({'error': 7}) == figure_settings({})
    assert figure_settings({'error': 'tracking', 'rate': 200.0}).error == 'tracking'


def test_a_prediction_compares_now_and_pending() -> None:
    settings = ControllerSettings(controller_bandwidth=8.0)
    found = prediction(settings, {'b0': 2.0 * settings.b0, 'inner_bandwidth': 20}, 200.0)
    now, pending = found['now'], found['pending']
    assert found['ok'] and now['stable']
    assert now['period_product'] == pytest.approx(40.0 / 200.0)
    assert pending['period_product'] == pytest.approx(30.0 / 200.0)
    assert pending['command_noise'] < now['command_noise']
    higher = prediction(settings, {'b0': 2.0 * settings.b0}, 200.0)['pending']['gain_margin'][1]
    assert higher == pytest.approx(2.0 * now['gain_margin'][1], rel=0.01)


@pytest.mark.parametrize(
    'values', [{'b0': 0.0}, {'b0': 'x'}, {'inner_bandwidth': 1e9}, {'levels': [2]}, {'b0': None}]
)
def test_a_prediction_of_what_is_refused_says_why(values: dict[str, object]) -> None:
    found = prediction(ControllerSettings(), values, 200.0)
    assert not found['ok'] and next(iter(values)) in found['text']


def test_a_prediction_needs_settings_and_a_rate() -> None:
    assert not prediction(None, {}, 200.0)['ok']
    assert not prediction(ControllerSettings(), {}, None)['ok']


PLANT = {
    'disturbance': 'sine',
    'disturbance_offset': 0.0,
    'fault.measurement.kind': 'none',
    'fault.command.kind': 'none',
    'fault.command.size': 1.0,
}


def test_a_fault_comes_and_goes_and_leaves_what_was_before() -> None:
    faults, plant = PlantFaults(), dict(PLANT)
    step = faults.values('disturbance', True, 2.5, plant)
    assert step == {'disturbance': 'constant', 'disturbance_offset': 2.5}
    plant |= step
    assert [each['name'] for each in listed(plant) if each['on']] == ['disturbance']
    plant |= faults.values('silent', True, None, plant)
    plant |= faults.values('spikes', True, None, plant)
    assert plant['fault.measurement.kind'] == 'spike'
    assert faults.values('silent', False, None, plant) == {}
    plant |= faults.values('spikes', False, None, plant)
    plant |= faults.values('disturbance', False, None, plant)
    assert (plant['disturbance'], plant['fault.measurement.kind']) == ('sine', 'none')
    assert not any(each['on'] for each in listed(plant))


@pytest.mark.parametrize(
    ('name', 'value', 'said'),
    [('heat', None, 'must be'), ('delay', -1.0, '0.001 to 10'), ('gain', 0.0, '0.01')],
)
def test_a_fault_that_there_is_not_is_refused(name: str, value: float | None, said: str) -> None:
    with pytest.raises(UserError, match=said):
        PlantFaults().values(name, True, value, PLANT)


def test_a_disturbance_of_the_users_own_stays() -> None:
    assert {each['name'] for each in listed(PLANT | {'disturbance': 'wind.py'})} == {*FAULTS} - {
        'disturbance'
    }


def test_a_saved_file_has_all_but_what_is_for_one_run() -> None:
    values = {'b0': 2.0, 'trace': 'run.jsonl', 'pole_ratios': [1.0]}
    found = saved('/arm/controller', values, {'b0': 1.0, 'gone': 3})
    assert found['difference'] == [{'name': 'b0', 'from': 1.0, 'to': 2.0}]
    assert found['name'] == 'arm_controller.yaml' and found['text'].startswith('1 parameter')
    content = yaml.safe_load(found['yaml'])
    assert content == {'/**/controller': {'ros__parameters': {'b0': 2.0, 'pole_ratios': [1.0]}}}
    assert '/arm/left:' in saved('/arm/left', values, {})['yaml']
