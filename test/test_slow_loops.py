"""Rates and magnitudes far from the usual: a step in minutes, and numbers as floats hold them."""

from __future__ import annotations

from math import isfinite
from typing import Any

import attrs
from hypothesis import given, settings
from hypothesis import strategies as st
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.adrc.settings import (
    ControllerSettings,
    FASTEST,
    HIGHEST,
    LEAST,
    LONGEST,
    SLOWEST,
    SLOWEST_RATE,
)
from nadrc_ros.adrc.structures import STRUCTURES
from nadrc_ros.ros.pacing import PacingSettings
from nadrc_ros.scenario import dump, loads
from nadrc_ros.simulation.simulate import simulate
import numpy as np
import pytest

FLOOR = """
plant: {name: thermal, power: 6000, capacity: 3e7, loss: 200, ambient: 5, heater_lag: 600,
  initial_state: [18, 0]}
reference: {signal: step, offset: 18, amplitude: 3, start_time: 7200}
disturbance: {signal: step, amplitude: -6e-5, start_time: 86400}
noise: {variance: 1e-4}
rate: 0.016666666666666666
duration: 172800
limits: {command_min: 0, command_max: 100}
controllers:
  nested: {inner_bandwidth: 0.001, outer_bandwidth: 0.0005, controller_bandwidth: 0.0003}
"""


def test_a_floor_is_heated_with_a_step_a_minute_and_settles_in_hours() -> None:
    scenario = loads(FLOOR)
    run = scenario.run('nested')
    error = run.reference - run.output
    assert len(run.time) == 2880
    assert np.abs(error[(run.time > 50_000) & (run.time < 86_400)]).max() < 0.03
    assert np.abs(error[run.time > 130_000]).max() < 0.03
    assert np.abs(error[run.time > 86_400]).max() > 0.05  # there was something to reject
    assert loads(dump(scenario)) == scenario
    fast = simulate(scenario.experiment, scenario.controllers['nested'], compiled=True)
    assert np.array_equal(fast.output, run.output)


def test_times_of_silence_are_some_periods_where_a_scenario_does_not_say_otherwise() -> None:
    settings = loads(FLOOR).controllers['nested']
    assert settings.measurement_timeout == pytest.approx(300.0)
    assert settings.max_dt == pytest.approx(600.0)
    said = FLOOR.replace('{inner', '{max_dt: 1000, measurement_timeout: 0, inner')
    settings = loads(said).controllers['nested']
    assert (settings.max_dt, settings.measurement_timeout) == (1000.0, 0.0)
    quick = loads(FLOOR.replace('0.016666666666666666', '100').replace('172800', '1'))
    defaults = ControllerSettings()
    assert quick.controllers['nested'].max_dt == defaults.max_dt
    assert quick.controllers['nested'].measurement_timeout == defaults.measurement_timeout


def test_the_dynamics_do_not_know_the_unit_of_time() -> None:
    """The same loop in seconds and in thousands of them: to rounding the same numbers."""
    base = 'plant: {{name: chain, order: 2, gain: {gain}}}\nreference: step\nrate: {rate}\n'
    base += 'duration: {end}\nlimits: {{command_min: -1e3, command_max: 1e3}}\ncontrollers:\n'
    base += '  nested: {{inner_bandwidth: {w}, outer_bandwidth: {w}, controller_bandwidth: {wc}}}'
    outputs = []
    for unit in (1.0, 1e3, 1e5):
        numbers = {'gain': unit**-2, 'rate': 100 / unit, 'end': 4 * unit, 'w': 20 / unit}
        scenario = loads(base.format(**numbers, wc=3 / unit))
        outputs.append(scenario.run('nested').output)
    assert outputs[0][-1] == pytest.approx(1.0, abs=1e-3)
    for output in outputs[1:]:
        assert np.allclose(output, outputs[0], rtol=0.0, atol=1e-9)


def test_a_plant_that_is_too_fast_for_the_rate_is_refused_and_not_run_wrong() -> None:
    slow = FLOOR.replace('heater_lag: 600', 'heater_lag: 0.001')
    with pytest.raises(SettingError, match=r'rate = 0.01666.*: must be at least 0\.4 Hz'):
        loads(slow)
    loads(slow.replace('rate: 0.016666666666666666', 'rate: 0.5'))


def test_a_run_that_fits_in_no_memory_is_refused_by_its_duration() -> None:
    scenario = loads(FLOOR.replace('172800', '1e9').replace('0.016666666666666666', '1'))
    with pytest.raises(UserError, match=r'duration = 1000000000\.0: must be at most 5e\+07 s'):
        scenario.run('nested')


def test_a_node_may_be_as_slow_as_a_scenario() -> None:
    assert PacingSettings(rate=SLOWEST_RATE).period == 1000.0
    with pytest.raises(SettingError):
        PacingSettings(rate=0.5 * SLOWEST_RATE)


def positive(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high) | st.sampled_from([low, high, (low * high) ** 0.5])


SIGNED = st.floats(-HIGHEST, HIGHEST) | st.sampled_from([0.0, LEAST, -HIGHEST, HIGHEST])
NUMBERS = st.fixed_dictionaries(
    {
        'plant_order': st.integers(1, 5),
        'structure': st.sampled_from(sorted(STRUCTURES)),
        'extended_states': st.integers(1, 5),
        'levels': st.integers(1, 6),
        'b0': positive(LEAST, HIGHEST),
        'inner_bandwidth': positive(SLOWEST, FASTEST),
        'outer_bandwidth': positive(SLOWEST, FASTEST),
        'controller_bandwidth': positive(SLOWEST, FASTEST),
        'feedback': st.sampled_from(['linear', 'fal']),
        'eso_delta': positive(LEAST, HIGHEST),
        'fal_delta': positive(LEAST, HIGHEST),
        'tracking_acceleration': st.sampled_from([0.0, 1e24]) | positive(LEAST, 1e24),
        'max_dt': st.just(LONGEST),
        'measurement_timeout': st.just(0.0),
        'error_based': st.booleans(),
        'command_min': st.sampled_from([-HIGHEST, -1.0]),
        'command_max': st.sampled_from([HIGHEST, 1.0]),
    }
)
SAMPLES = st.lists(st.tuples(SIGNED, SIGNED, positive(1e-9, LONGEST)), min_size=2, max_size=20)


@settings(max_examples=200)
@given(NUMBERS, SAMPLES)
def test_p02_whatever_is_declared_possible_gives_a_finite_command_within_its_limits(
    numbers: dict[str, Any], samples: list[tuple[float, float, float]]
) -> None:
    given_settings = ControllerSettings(**numbers)
    controller = Controller(given_settings)
    for y, r, dt in samples:
        u = controller.tick(measurement=y, dt=dt, reference=[r, r, -r])
        assert isfinite(u) and given_settings.command_min <= u <= given_settings.command_max
    controller.retune(attrs.evolve(given_settings, inner_bandwidth=40.0, b0=1.0))
    u = controller.tick(measurement=samples[0][0], dt=0.01)
    assert isfinite(u) and given_settings.command_min <= u <= given_settings.command_max
