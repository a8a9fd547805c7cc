"""Symptoms of docs/troubleshooting.md on a cart, and whether the remedy of the page helps."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from nadrc_ros.scenario import load, loads
import numpy as np
import pytest

SCENARIO = """
plant: {{name: chain, order: 2, gain: 2.0, input_delay: {delay}}}
reference: {{signal: step, amplitude: {step}, start_time: 0.5}}
{more}
noise: {{variance: {noise}}}
rate: 200
duration: {duration}
limits: {{command_min: -{limit}, command_max: {limit}}}
controllers:
  cart: {{structure: conventional, controller_bandwidth: {wc}, inner_bandwidth: {wo}, {settings}}}
"""


class Late(NamedTuple):
    """The second half of a run: rms and mean of the error, and how much the command moved."""

    error: float
    mean: float
    moved: float


def late(
    settings: str = 'b0: 2.0',
    wc: float = 8.0,
    wo: float = 40.0,
    more: str = '',
    delay: float = 0.0,
    step: float = 1.0,
    noise: float = 0.0,
    limit: float = 50.0,
    duration: float = 6.0,
) -> Late:
    run = loads(SCENARIO.format(**locals())).run('cart')
    half = len(run.time) // 2
    error, command = (run.reference - run.output)[half:], run.command[half:]
    moved = np.abs(np.diff(command)).sum()
    return Late(float(np.sqrt(np.mean(error**2))), float(error.mean()), float(moved))


def test_a_cart_that_is_known_has_none_of_the_symptoms() -> None:
    assert late().error < 1e-4


def test_it_oscillates_fast_with_an_unknown_delay() -> None:
    assert late(delay=0.04).error > 0.1
    assert late(delay=0.04, wo=24.0).error > 0.1, 'a slower observer alone hardly helps'
    assert late(delay=0.04, wc=4.0).error < 1e-3
    assert late('b0: 2.0, input_delay: 0.04', delay=0.04).error < 1e-3


def test_it_oscillates_fast_with_a_b0_that_is_too_small() -> None:
    small = late('b0: 0.4')
    assert small.error > 0.01
    assert late('b0: 0.4', wo=20.0).error > 3.0 * small.error, 'a slower observer is worse'


def test_it_oscillates_slowly_with_a_b0_that_is_too_large() -> None:
    assert late('b0: 12.0', duration=12.0).error > 0.3


@pytest.mark.parametrize(('acceleration', 'most'), [(0.0, 99.0), (20.0, 99.0), (3.9, 0.01)])
def test_steps_within_limits_take_a_tracking_acceleration_that_they_allow(
    acceleration: float, most: float
) -> None:
    settings = f'b0: 2.0, tracking_acceleration: {acceleration}'
    found = late(settings, step=10.0, limit=2.0, duration=12.0)
    assert found.error < most and (most < 1.0 or found.error > 1.0)


def test_it_swings_ever_wider_where_the_actuator_is_slow() -> None:
    def behind(speed: float, settings: str) -> float:
        slow = f'faults: {{command: [{{kind: rate_limited, start: 0.0, size: {speed}}}]}}'
        return late(f'b0: 2.0, {settings}', more=slow).error

    assert behind(200.0, 'command_rate_limit: 0.0') > 1.0
    assert behind(200.0, 'command_rate_limit: 200.0') < 1e-3
    assert behind(50.0, 'command_rate_limit: 50.0') > 1.0
    assert behind(50.0, 'command_rate_limit: 50.0, tracking_acceleration: 4.0') < 1e-3


def test_it_hunts_at_a_coarse_sensor() -> None:
    """Without friction, where a deadband makes it worse; examples/loops/rest.yaml has some."""
    coarse = 'faults: {measurement: [{kind: quantised, start: 0.0, size: 0.01}]}'
    hunting = late(more=coarse)
    assert hunting.moved > 30.0
    assert late('b0: 2.0, error_deadband: 0.04', more=coarse).moved > 1.5 * hunting.moved
    assert late(wc=4.0, wo=20.0, more=coarse).moved < 0.3 * hunting.moved


def test_it_drifts_by_the_bias_of_a_sensor() -> None:
    biased = 'faults: {measurement: [{kind: bias, start: 0.0, size: 0.05}]}'
    assert late(more=biased).mean == pytest.approx(0.05, rel=0.01)


def test_it_buzzes_with_noise() -> None:
    buzzing = late(wo=60.0, noise=1e-4)
    assert late(wo=24.0, noise=1e-4).moved < 0.2 * buzzing.moved
    half = late('b0: 2.0, observer_gain_factor: 0.5', wo=60.0, noise=1e-4)
    assert half.moved < 0.6 * buzzing.moved
    assert late('b0: 1.0', wo=60.0, noise=1e-4).moved > 1.5 * buzzing.moved


def test_it_buzzes_at_one_frequency() -> None:
    ripple = 'disturbance: {signal: sine, amplitude: 5.0, frequency: 25.0}'
    unknown, known = late(more=ripple), late('b0: 2.0, disturbance_frequencies: [25]', more=ripple)
    assert known.error < 0.02 * unknown.error and known.moved > 0.5 * unknown.moved


def test_a_machine_with_friction_stops_hunting_with_a_deadband() -> None:
    scenario = load(Path(__file__).parents[1] / 'examples' / 'loops' / 'rest.yaml')
    for name, most in (('without', np.inf), ('error_deadband', 0.0)):
        run = scenario.run(name)
        at_rest = (run.time > 3.0) & (run.time < 6.0)
        moved = float(np.abs(np.diff(run.command[at_rest])).sum())
        assert moved <= most and (most == 0.0 or moved > 1.0)
