"""Cascades in a scenario: read and written, simulated, compiled, swept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import attrs
from nadrc_ros.adrc.cascade import Cascade, CascadeSettings, loops_of
from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.scenario import dump, loads, Scenario
from nadrc_ros.scenario.sweep import run_range, Sweep
from nadrc_ros.simulation.batch import run_metrics
from nadrc_ros.simulation.kernel import kernel_for
from nadrc_ros.simulation.loop import sample_reference
from nadrc_ros.simulation.simulate import Result, simulate
import numpy as np
import pytest
import yaml

ROOT = Path(__file__).parents[1]
CASCADE: dict[str, Any] = {
    'controller_bandwidth': 3.0,
    'inner_bandwidth': 12.0,
    'inner': {'controller_bandwidth': 12.0, 'structure': 'conventional'},
}
SCENARIO: dict[str, Any] = {
    'plant': {'name': 'chain', 'order': 2, 'damping': 0.5, 'initial_state': [0.2, -1.0]},
    'reference': {'signal': 'cosine', 'frequency': 2.0},
    'disturbance': {'signal': 'decaying_cosine', 'frequency': 3.0},  # compiled for other tests too
    'noise': {'variance': 1e-6, 'derivative_variances': [1e-4]},
    'seed': 5,
    'rate': 100,
    'duration': 2.0,
    'limits': {'command_min': -4.0, 'command_max': 4.0},
    'controllers': {'single': None, 'cascade': CASCADE},
}


def scenario(cascade: dict[str, Any] | None = None, **changes: Any) -> Scenario:
    controllers = {'single': None, 'cascade': {**CASCADE, **(cascade or {})}}
    return loads(yaml.safe_dump({**SCENARIO, 'controllers': controllers, **changes}), ROOT)


def bits(result: Result) -> list[Any]:
    columns = [v for v in attrs.asdict(result, recurse=False).values() if hasattr(v, 'tobytes')]
    columns += [column for loop in result.inner for column in attrs.asdict(loop).values()]
    return [column.tobytes() for column in columns] + [result.metrics, result.status_counts]


def test_the_orders_and_gains_of_the_loops_make_those_of_the_plant() -> None:
    outer, inner = loops_of(scenario().controllers['cascade'])
    assert (outer.plant_order, outer.b0, inner.plant_order, inner.b0) == (1, 1.0, 1, 1.0)
    assert (outer.command_max, inner.command_max) == (100.0, 4.0)
    higher = scenario(plant={'name': 'chain', 'order': 3}).controllers['cascade']
    assert loops_of(higher)[1] == attrs.evolve(inner, plant_order=2)
    deep = {'inner': {**CASCADE, 'command_max': 7.0}}
    three = loops_of(scenario(deep, plant={'name': 'chain', 'order': 3}).controllers['cascade'])
    assert [each.plant_order for each in three] == [1, 1, 1]
    assert [each.command_max for each in three] == [100.0, 7.0, 4.0]
    assert {each.max_dt for each in loops_of(scenario(rate=10).controllers['cascade'])} == {1.0}


def test_a_cascade_reads_back_as_it_was_written() -> None:
    original = scenario()
    again = loads(dump(original), ROOT)
    assert again.controllers == original.controllers
    assert type(again.controllers['cascade']) is CascadeSettings
    assert again.noise == original.noise
    assert dump(again) == dump(original)


@pytest.mark.parametrize(
    ('cascade', 'changes', 'complaint'),
    [
        ({'plant_order': 2}, {}, r'controllers\.cascade\.plant_order = 2: .*less than the order'),
        ({'inner': {'plant_order': 2}}, {}, r'cascade\.inner\.plant_order = 2: .*1, the order'),
        (
            {'inner': {'inner_bandwith': 2.0}},
            {},
            r'cascade\.inner\.inner_bandwith: .*did you mean',
        ),
        ({'inner': 3.0}, {}, r'controllers\.cascade\.inner = 3.0'),
        ({'inner': {'reference_max': 9.0}}, {}, r'cascade\.command_max = 100.0: .*reference_max'),
        ({'inner': {'max_dt': 0.001}}, {}, r'controllers\.cascade\.inner\.max_dt = 0.001'),
        ({}, {'retune': [{'time': 1.0, 'b0': 2.0}]}, r'retune\[0\]: controllers\.cascade is a'),
        ({}, {'noise': {'derivative_variances': [-1.0]}}, r'noise\.derivative_variances = '),
    ],
)
def test_a_cascade_that_cannot_be_is_refused_by_the_name_of_what_is_wrong(
    cascade: dict[str, Any], changes: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(UserError, match=complaint):
        scenario(cascade, **changes)


def by_hand(one: Scenario) -> list[float]:
    """Return the commands of a cascade around the plant, one tick after the other."""
    settings = one.controllers['cascade']
    cascade, plant = Cascade(settings, checked=True), one.experiment.plant_run()
    orders = [each.plant_order for each in loops_of(settings)]
    commands = []
    for k in range(one.experiment.steps):
        measured = [plant.measurement]
        for i in range(1, len(orders)):
            m = sum(orders[:i])
            measured.append(plant.measured_derivative(m))
        r = sample_reference(one.experiment.reference, k, one.rate)
        commands.append(cascade.tick(measured, one.period, reference=r))
        plant.advance(commands[-1])
    return commands


@pytest.mark.parametrize(
    ('cascade', 'order'),
    [
        ({}, 2),
        ({'tracking_acceleration': 20.0, 'command_rate_limit': 30.0, 'command_max': 1.0}, 2),
        ({'inner': {'feedback': 'fal', 'error_based': True, 'command_rate_limit': 50.0}}, 2),
        ({'plant_order': 2, 'levels': 3, 'inner': {'plant_order': 1, 'structure': 'nested'}}, 3),
        ({'inner': CASCADE}, 3),
    ],
    ids=['position and velocity', 'limits', 'fal', 'two of order 3', 'three loops'],
)
def test_p18_python_plain_and_compiled_give_the_same_bits(
    cascade: dict[str, Any], order: int
) -> None:
    one = scenario(cascade, plant={'name': 'chain', 'order': order, 'damping': 0.5})
    settings, experiment = one.controllers['cascade'], one.experiment
    plain = simulate(experiment, settings, compiled=False)
    assert plain.command.tolist() == by_hand(one)
    assert np.ptp(plain.command) > 0.1
    assert bits(simulate(experiment, settings, compiled=True)) == bits(plain)
    # The single loop and the cascade are two compiled ones; three loops run in plain Python.
    kernel = kernel_for(experiment)
    assert kernel is not None and kernel._cascade_believed(experiment)


def test_what_the_compiled_loop_leaves_out_comes_from_plain_python() -> None:
    faults = {
        'measurement': [{'kind': 'spike', 'size': 5.0, 'start': 0.5, 'duration': 0.1}],
        'command': [{'kind': 'stuck', 'start': 1.0, 'duration': 0.3}],
    }
    narrow = {'reference_max': 0.6, 'inner': {'reference_max': 1.0}, 'command_max': 1.0}
    one = scenario(narrow, faults=faults)
    settings = one.controllers['cascade']
    plain = simulate(one.experiment, settings, compiled=False)
    assert bits(simulate(one.experiment, settings, compiled=True)) == bits(plain)
    assert plain.inner[0].reference.max() <= 1.0


def test_each_loop_has_noise_of_its_own_and_what_it_follows_is_kept() -> None:
    one = scenario(duration=10.0)
    result = one.run('cascade')
    (inner,) = result.inner
    noise = np.array([result.measurement - result.output, inner.measurement - inner.output])
    assert noise.std(axis=1) == pytest.approx([1e-3, 1e-2], rel=0.1)
    assert abs(np.corrcoef(noise)[0, 1]) < 0.1
    slope = np.gradient(result.output, result.time)[1:-1]
    assert inner.output[1:-1] == pytest.approx(slope, abs=0.05)
    assert inner.reference[500:] == pytest.approx(inner.output[500:], abs=0.6)
    # The noise of the output is what it was without any on the speed.
    single = scenario(duration=10.0, noise={'variance': 1e-6}).run('single')
    assert single.measurement - single.output == pytest.approx(noise[0], abs=1e-12)
    assert one.run('single').inner == ()


def test_a_sweep_varies_the_inner_loop_by_its_dotted_path(tmp_path: Path) -> None:
    path = 'controllers.cascade.inner.controller_bandwidth'
    sweep = Sweep(scenario=SCENARIO, folder=str(tmp_path), vary={path: (6.0, 12.0)}, seeds=[5])
    assert sweep.check().runs == 4
    slow, own = (run_range(sweep, i, i + 1, False)[0] for i in (1, 3))
    assert own == run_metrics(scenario().experiment, scenario().controllers['cascade'], 5, False)
    assert slow.rmse > own.rmse
    with pytest.raises(SettingError, match='innner'):
        attrs.evolve(sweep, vary={path.replace('inner', 'innner'): (1.0,)}).check()
