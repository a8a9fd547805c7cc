"""The compiled loop: the bits of plain Python, whatever runs in it and whatever goes wrong."""

from __future__ import annotations

from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from math import inf, nan
import subprocess
import sys
from typing import Any

import attrs
from law_helpers import varied_settings
from nadrc_ros.adrc.fields import build
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.simulation import loop
from nadrc_ros.simulation.batch import run_metrics, simulate_batch
from nadrc_ros.simulation.compiled import announced
from nadrc_ros.simulation.experiment import Experiment, Retune
from nadrc_ros.simulation.faults import (
    COMMAND_KINDS,
    CommandFault,
    Faults,
    MEASUREMENT_KINDS,
    MeasurementFault,
)
from nadrc_ros.simulation.integrate import integrate, make_work
from nadrc_ros.simulation.kernel import fields_of, kernel_for
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plants import PLANTS
from nadrc_ros.simulation.signals import make_signal, SIGNALS
from nadrc_ros.simulation.simulate import Result, simulate
import numba
from numba.core.event import trigger_event
import numpy as np
import pytest

# Each is compiled anew; test_specialise goes through all of them in plain Python.
CHOSEN = 'cascade-1', 'error-td-fal', 'four levels', 'generalized-3', 'angle', 'table', 'error'
CASES = {name: varied_settings()[name] for name in CHOSEN} | {
    'nonlinear': {'structure': 'nonlinear', 'levels': 3, 'eso_delta': 1e-3},
    'startup': {'startup_time': 0.5},
    'no derivatives': {'reference_derivatives': 'none'},
    'differentiator': {'reference_derivatives': 'differentiator', 'tracking_acceleration': 3.0},
    'saturated': {'command_min': -0.2, 'command_max': 0.3},
    'stalled': {
        'command_min': -0.2,
        'command_max': 0.3,
        'stall_time': 0.3,
        'stall_action': 'fault',
    },
    'idle at safe': {'command_min': 0.0, 'stall_time': 0.3, 'stall_action': 'fault'},
    'order 5': {'plant_order': 5, 'levels': 3, 'command_min': -1e9, 'command_max': 1e9},
}


SHIFT: Any = np.array([0.0])


class Wild:
    """A plant as a user may write it, which runs away or fails when told to."""

    order = 2
    states = 3

    def __init__(self, growth: float = 0.0, bend: Any = (1.0, 0.5), fault_time: float = inf):
        self.growth = growth
        self.bend = list(bend)
        self.fault_time = fault_time
        self.zero = 0.0
        self.name = 'wild'

    @property
    def b0(self) -> float:
        return float(2.0 * self.bend[0])

    def derivative(self, t: float, x: Any, u: float, w: float, dx: Any) -> None:
        dx[0] = x[1]
        dx[1] = self.b0 * u - self.bend[1] * x[2] + self.growth * x[0] * x[0] * x[0] + w
        dx[2] = x[1] - x[2] + float(SHIFT[0])
        if t > self.fault_time:
            dx[2] = 1.0 / self.zero

    def output(self, x: Any) -> Any:
        return x[0]


@attrs.frozen
class Torn:
    """A reference that is no number for a while."""

    since: float = inf
    until: float = inf

    def derivatives(self, t: float, out: Any) -> None:
        for i in range(len(out)):
            out[i] = 0.0
        out[0] = 1.0
        if self.since <= t < self.until:
            out[0] = nan


class Helped(Wild):
    """A plant that numba cannot compile."""

    def derivative(self, t: float, x: Any, u: float, w: float, dx: Any) -> None:
        dx[:] = [x[1], 2.0 * float(f'{u:g}') + w, 0.0]


def chain(order: int = 2, **changes: Any) -> Experiment:
    values: dict[str, Any] = {
        'plant': build(PLANTS['chain'], {'order': order, 'damping': 0.5}),
        'reference': make_signal('cosine', {'frequency': 0.5}),
        'disturbance': make_signal('decaying_cosine', {'frequency': 3.0}),
        'noise': Noise(variance=1e-6, sample_time=0.007, seed=3),
        'initial_state': tuple(0.1 * i for i in range(order)),
        'duration': 3.0,
    }
    return Experiment(**values | changes)


def wild(plant: Wild, since: float = inf, until: float = inf, **changes: Any) -> Experiment:
    none = make_signal('none', {})
    return chain(
        plant=plant,
        reference=Torn(since, until),
        disturbance=none,
        initial_state=(0.0,) * 3,
        **changes,
    )


def assert_same(one: Result, other: Result) -> None:
    for field in attrs.fields(Result):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            assert a.shape == b.shape and a.dtype == b.dtype, field.name
            assert np.array_equal(a, b, equal_nan=True), field.name
            assert np.array_equal(np.signbit(a[~np.isnan(a)]), np.signbit(b[~np.isnan(b)]))
        else:
            assert a == b, field.name


def both(experiment: Experiment, **settings: Any) -> Result:
    """Run both ways, require the same bits, and that it was not plain Python twice."""
    assert kernel_for(experiment) is not None
    chosen = ControllerSettings(**settings)
    plain = simulate(experiment, chosen, compiled=False)
    assert_same(plain, simulate(experiment, chosen, compiled=True))
    return plain


@pytest.mark.parametrize('case', CASES)
def test_every_law_gives_the_same_bits(case: str) -> None:
    order = CASES[case].get('plant_order', 2)
    result = both(chain(order), **CASES[case])
    assert len(set(result.command)) > 5


@pytest.mark.parametrize(
    'changes',
    [
        {'rate': 1000.0 / 3.0},
        {'rate': 17.0, 'duration': 20.0},
        {'duration': 0.005},
        {'error': 'tracking'},
        {'noise': Noise(variance=0.0)},
        {'noise': Noise(variance=1e-2, sample_time=1e-4)},
        {'plant': build(PLANTS['chain'], {'gain': -3.0, 'load': 2.0})},
        {'reference': make_signal('cosine', {'amplitude': 1e6, 'frequency': 1e4})},
    ],
    ids=str,
)
def test_every_setting_of_the_experiment_gives_the_same_bits(changes: dict[str, Any]) -> None:
    both(chain(**changes), tracking_acceleration=5.0)


def test_retunes_give_the_same_bits() -> None:
    changes: list[dict[str, Any]] = [
        {'levels': 4, 'outer_bandwidth': 20.0},
        {'structure': 'conventional', 'b0': 1.5},
        {'structure': 'generalized', 'extended_states': 3, 'feedback': 'fal'},
        {'error_based': True},
        {'structure': 'cascade', 'error_based': False, 'tracking_acceleration': 8.0},
    ]
    times = [0.0, 0.5, 0.5001, 1.3, 2.995]
    retunes = tuple(Retune(time=t, settings=s) for t, s in zip(times, changes))
    result = both(chain(retunes=retunes))
    assert result.disturbances.shape[1] == 4
    assert np.isnan(result.disturbances[[10, 150, -1], 3]).tolist() == [False, True, False]


@pytest.mark.parametrize(
    ('rate', 'settings'),
    [
        (0.0, {}),
        (30.0, {'plant_order': 1}),
        (20.0, {'plant_order': 3, 'measurement_period': 1.5}),
        (20.0, {'reference_max': 0.9, 'max_dt': 0.1}),
        (20.0, {'reference_derivatives': 'topics'}),
    ],
    ids=str,
)
def test_a_reference_that_comes_alone_gives_the_same_bits(
    rate: float, settings: dict[str, Any]
) -> None:
    order = settings.get('plant_order', 2)
    faults = Faults(measurement=(MeasurementFault(kind='silent', start=0.5, duration=0.2),))
    retunes = (Retune(time=2.0, settings={'controller_bandwidth': 9.0}),)
    alone = chain(order, reference_alone=True, reference_rate=rate, faults=faults, retunes=retunes)
    settings = {'reference_derivatives': 'auto'} | settings
    result = both(alone, **settings)
    if rate:
        assert len(set(result.reference)) == rate * alone.duration
    without = simulate(alone, ControllerSettings(**settings | {'reference_derivatives': 'none'}))
    estimated = settings['reference_derivatives'] == 'auto'
    assert np.array_equal(without.command, result.command) == (not estimated)


@pytest.mark.parametrize('kind', MEASUREMENT_KINDS)
def test_faults_give_the_same_bits(kind: str) -> None:
    measurement = (
        MeasurementFault(kind=kind, time=0.2, probability=0.6, start=0.5, duration=0.7),
        MeasurementFault(kind='bias', size=0.01, start=1.0, duration=1.5),
    )
    command = tuple(
        CommandFault(kind=kind, size=0.5, start=0.3 + 0.6 * i, duration=0.4)
        for i, kind in enumerate(COMMAND_KINDS)
    )
    both(chain(faults=Faults(measurement=measurement, command=command)))


def test_the_blocks_that_a_long_run_is_cut_into_do_not_show(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = simulate(chain(), ControllerSettings(), compiled=False)
    for size in (1, 7, 599, 600):
        monkeypatch.setattr(loop, '_NOISE_BLOCK', size)
        for compiled in (False, True):
            assert_same(whole, simulate(chain(), ControllerSettings(), compiled=compiled))


def test_a_plant_of_ones_own_gives_the_same_bits() -> None:
    both(wild(Wild()), b0=2.0)
    both(wild(Wild(bend=(0.3, 2.0))), b0=1.0, error_based=True)


def test_a_plant_that_runs_away_gives_the_same_bits() -> None:
    result = both(wild(Wild(growth=5.0)), b0=2.0, command_min=-1.0, command_max=1.0)
    assert np.isnan(result.output[-1]) and not np.isnan(result.output[2])
    assert result.metrics.skipped > 0
    assert result.status_counts['no_measurement'] > 0


def test_a_reference_that_is_no_number_gives_the_same_bits() -> None:
    for since, until in ((0.0, 0.5), (1.0, 2.0), (1.0, inf), (0.0, inf)):
        result = both(wild(Wild(), since, until), b0=2.0, reference_timeout=0.2)
        assert result.status_counts['bad_reference'] > 90


def test_a_plant_that_fails_on_the_way_fails_alike() -> None:
    experiment = wild(Wild(fault_time=1.0))
    assert kernel_for(experiment) is not None
    for compiled in (False, True):
        with pytest.raises(ZeroDivisionError):
            simulate(experiment, ControllerSettings(), compiled=compiled)


def test_a_plant_that_does_not_compile_runs_in_plain_python() -> None:
    experiment = wild(Helped())
    assert kernel_for(experiment) is None
    plain, other = (simulate(experiment, ControllerSettings(), compiled=c) for c in (False, True))
    assert_same(plain, other)


def test_a_plant_whose_bits_differ_runs_in_plain_python() -> None:
    assert kernel_for(wild(Wild(growth=0.1))) is not None
    SHIFT[0] = 2.0  # numba took it for a constant
    assert kernel_for(wild(Wild(growth=0.2))) is None
    SHIFT[0] = 0.0


@pytest.mark.parametrize('signal', SIGNALS)
def test_every_plant_and_signal_gives_the_same_bits(signal: str) -> None:
    names = list(PLANTS)
    plant = build(PLANTS[names[list(SIGNALS).index(signal) % len(names)]], {})
    w = make_signal(signal, {'start_time': 0.0123})
    derivative, derivatives = type(plant).derivative, type(w).derivatives
    plain = trajectory(derivative, derivatives, plant, w, list, plant.states)
    compiled = numba.njit(derivative), numba.njit(derivatives)  # integrate is so in each loop
    assert trajectory(*compiled, fields_of(plant), fields_of(w), np.array, plant.states) == plain


def trajectory(
    derivative: Any, derivatives: Any, plant: Any, w: Any, vector: Any, states: int
) -> list[Any]:
    """Return all that comes of 100 steps of a plant under a disturbance."""
    x, out, one, orders = (vector([0.0] * n) for n in (states, states, 1, 6))
    x[:] = vector([0.1 * i for i in range(states)])
    work = vector(make_work(states))
    found = []
    for k in range(100):
        t = k * 1e-3
        derivatives(w, t, orders)
        derivatives(w, t, one)
        derivative(plant, t, x, 0.7, one[0], work[0])
        integrate(derivative, plant, derivatives, w, t, x, 0.7, 1e-3, 2, work, one, out, states)
        x, out = out, x
        found.append([*map(float, x), *map(float, orders)])
    return found


def test_many_runs_give_the_figures_of_the_single_ones() -> None:
    experiment = chain()
    settings = [ControllerSettings(), ControllerSettings(structure='conventional')]
    singles = [
        simulate(
            attrs.evolve(experiment, noise=attrs.evolve(experiment.noise, seed=seed)),
            one,
            compiled=False,
        ).metrics.as_dict()
        for one in settings
        for seed in (5, 6, 7)
    ]
    own = simulate_batch(experiment, settings, (5, 6, 7), compiled=True)
    assert [{k: v for k, v in run.as_dict().items() if k in singles[0]} for run in own] == singles
    assert own == simulate_batch(experiment, settings, (5, 6, 7), compiled=False)
    executors: list[Executor] = [ThreadPoolExecutor(1), ProcessPoolExecutor(2)]
    for executor in executors:
        with executor:
            assert own == simulate_batch(experiment, settings, range(5, 8), executor=executor)
    assert simulate_batch(experiment, settings, ()) == []


@pytest.mark.parametrize('case', ['error', 'four levels', 'generalized-3'])
def test_what_the_levels_leave_is_measured(case: str) -> None:
    experiment, settings = chain(), ControllerSettings(**CASES[case])
    result = simulate(experiment, settings, compiled=True)
    found = run_metrics(experiment, settings, experiment.noise.seed, compiled=True).remainder_itae
    known = result.disturbance_estimate - result.disturbances.sum(axis=1)  # r^(n), error-based
    estimates = np.cumsum(result.disturbances, axis=1) + known[:, None]
    left = result.total_disturbance[:, None] - estimates
    itae = experiment.period * (result.time[:, None] * np.abs(left)).sum(axis=0)
    assert found == pytest.approx(itae.tolist(), rel=1e-9)
    assert len(found) == result.disturbances.shape[1]


def test_a_short_run_does_not_wait_for_numba() -> None:
    code = (
        'import sys, test_compiled as t\n'
        "for name in [n for n in sys.modules if n.startswith('numba')]: del sys.modules[name]\n"
        'from nadrc_ros.simulation.simulate import simulate\n'
        't.simulate(t.chain(), t.ControllerSettings())\n'
        "assert 'numba' not in sys.modules"
    )
    subprocess.run(
        [sys.executable, '-c', code], check=True, env={'PYTHONPATH': ':'.join(sys.path)}
    )


def test_without_numba_it_runs_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = simulate(chain(), ControllerSettings(), compiled=False)
    monkeypatch.setitem(sys.modules, 'nadrc_ros.simulation.kernel', None)
    assert_same(plain, simulate(chain(), ControllerSettings(), compiled=True))


def test_a_compilation_is_announced_once_and_for_its_own_loop_only() -> None:
    kernel, said = kernel_for(chain()), list[str]()
    assert kernel is not None
    with announced(kernel.compiled, said.append):
        for dispatcher in (kernel.compiled, numba.njit(chain)):
            with trigger_event('numba:compile', data={'dispatcher': dispatcher}):
                pass
    assert len(said) == 1 and 'compiling' in said[0]
