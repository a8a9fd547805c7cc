"""Faults on purpose: what each does to samples and commands, and that the loop outlives them."""

from __future__ import annotations

from itertools import pairwise
from math import inf, isnan
from typing import Any

import attrs
from hypothesis import given, settings
from hypothesis import strategies as st
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.faults import (
    COMMAND_KINDS,
    CommandFault,
    Faults,
    Injector,
    MEASUREMENT_KINDS,
    MeasurementFault,
    ONE_EACH,
)
from nadrc_ros.simulation.loop import Loop, ROW_WIDTH
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plants import PLANTS
from nadrc_ros.simulation.signals import make_signal
from nadrc_ros.simulation.simulate import Result, simulate
import numpy as np
import pytest

RATE = 100.0
# From period 3 up to, and without, period 7.
WINDOW: dict[str, Any] = {'start': 0.03, 'duration': 0.04}

Values = list[tuple[float, ...]]


def delivered(*faults: MeasurementFault, count: int = 10, seed: int = 0) -> Values:
    """Return what arrives in each period of a measurement that counts the periods."""
    injector = Injector(Faults(measurement=faults), RATE, seed)
    return [tuple(s.value for s in injector.deliver(k, float(k))) for k in range(count)]


def acted(fault: CommandFault, count: int = 10) -> list[float]:
    injector = Injector(Faults(command=(fault,)), RATE, 0)
    return [injector.act(k, float(k)) for k in range(count)]


def plain(count: int = 10) -> Values:
    return [(float(k),) for k in range(count)]


@pytest.mark.parametrize(
    ('kind', 'more', 'expected'),
    [
        ('silent', {}, [(), (), (), ()]),
        ('intermittent', {}, [(), (), (), ()]),
        ('stuck', {}, [(3.0,)] * 4),
        ('bias', {'size': -0.5}, [(2.5,), (3.5,), (4.5,), (5.5,)]),
        ('infinite', {'size': -1.0}, [(-inf,)] * 4),
        ('quantised', {'size': 4.0}, [(4.0,), (4.0,), (4.0,), (8.0,)]),
        ('delayed', {'time': 0.02}, [(), (), (3.0,), (4.0,)]),
        ('duplicated', {}, [(3.0, 3.0), (4.0, 4.0), (5.0, 5.0), (6.0, 6.0)]),
        ('reordered', {}, [(), (), (3.0,), (4.0,)]),
    ],
)
def test_a_fault_does_what_it_says_in_its_window_and_nothing_outside(
    kind: str, more: dict[str, float], expected: Values
) -> None:
    found = delivered(MeasurementFault(kind=kind, **WINDOW, **more))
    assert found[3:7] == expected
    assert found[:3] + found[7:] == plain()[:3] + plain()[7:]


def test_a_delayed_sample_is_stamped_when_it_is_sent_as_on_the_graph() -> None:
    """With the stamps of when they were taken ITAE was 5 to 7 % off that of the demo."""
    fault = MeasurementFault(kind='delayed', time=0.02, **WINDOW)
    injector = Injector(Faults(measurement=(fault,)), RATE, 1)
    stamps = [(s.stamp, s.number) for k in range(9) for s in injector.deliver(k, 0.0)]
    assert stamps == [(k, k) for k in range(3)] + [(5, 3), (6, 4)] + [(7, 7), (8, 8)]


@pytest.mark.parametrize('kind', ['none', 'silent', 'not_a_number', 'bias'])
def test_a_controller_that_saw_nothing_before_the_start_waits_for_good_samples(kind: str) -> None:
    """As on the graph: else the simulation began two samples earlier, and ITAE was 5 % less."""
    fault = MeasurementFault(kind=kind, size=0.5, duration=0.5)
    experiment = Experiment(
        plant=build(PLANTS['chain'], {'order': 1}),
        reference=make_signal('constant', {'offset': 1.0}),
        disturbance=make_signal('none', {}),
        noise=Noise(variance=0.0),
        initial_state=(0.0,),
        duration=1.0,
        rate=RATE,
        faults=Faults(measurement=(fault,)),
    )
    settings = ControllerSettings(plant_order=1, good_samples=4)
    command = simulate(experiment, settings).command
    assert experiment.faults.blind == (kind in ('silent', 'not_a_number'))
    began = int(np.flatnonzero(command)[0])
    # a command without a bump: the first sample after those that prove the sensor moves it
    assert began == (round(0.5 * RATE) + 4 if experiment.faults.blind else 1)


def test_random_values_are_of_the_size_that_was_asked_for() -> None:
    (garbage,) = zip(*delivered(MeasurementFault(kind='garbage', size=2.0), count=2000))
    assert -2.0 <= min(garbage) < -1.9 and 1.9 < max(garbage) <= 2.0
    (spiked,) = zip(*delivered(MeasurementFault(kind='spike', size=0.25), count=2000))
    offsets = [value - k for k, value in enumerate(spiked)]
    assert {-0.25, 0.25} == set(offsets)
    (lost,) = zip(*delivered(MeasurementFault(kind='not_a_number')))
    assert all(map(isnan, lost))


def test_a_lag_is_the_exact_one_of_a_held_input() -> None:
    found = delivered(MeasurementFault(kind='slow', time=0.03))
    y, share = 0.0, 1.0 - np.exp(-1.0 / (RATE * 0.03))
    for k, (value,) in enumerate(found):
        y += share * (k - y)
        assert value == pytest.approx(y, rel=1e-12)


@pytest.mark.parametrize('kind', ['intermittent', 'not_a_number', 'duplicated', 'spike'])
def test_the_share_of_hit_samples_is_the_probability_and_the_seed_says_which(kind: str) -> None:
    fault = MeasurementFault(kind=kind, probability=0.2)
    one, again, other = (str(delivered(fault, count=5000, seed=s)) for s in (1, 1, 2))
    assert one == again != other
    hit = sum(a != b for a, b in zip(delivered(fault, count=5000), plain(5000)))
    assert hit == pytest.approx(1000, abs=120)  # four standard deviations


def test_what_is_overtaken_comes_two_periods_late_after_newer_ones() -> None:
    injector = Injector(
        Faults(measurement=(MeasurementFault(kind='reordered', probability=0.3),)), RATE, 4
    )
    arrived = [sample.number for k in range(200) for sample in injector.deliver(k, 0.0)]
    late = [b for a, b in pairwise(arrived) if b < a]
    assert len(late) > 20
    assert len(set(arrived)) == len(arrived) >= 196


def test_p09_of_samples_that_come_together_the_newest_is_used() -> None:
    """Only where the fresh sample is held back too does a late one come alone, and is refused."""
    fault = MeasurementFault(kind='reordered', probability=0.3, start=BEGIN, duration=END - BEGIN)
    result = in_the_loop(measurement=(fault,))
    share = result.status_counts['bad_time_step'] / (200.0 * (END - BEGIN))
    assert share == pytest.approx(0.3 * 0.3, abs=0.05)


def test_a_clock_jump_is_one_of_the_stamps() -> None:
    jump = MeasurementFault(kind='clock_jump', time=0.5, **WINDOW)
    injector = Injector(Faults(measurement=(jump,)), RATE, 0)
    stamps = [injector.deliver(k, 0.0)[0].stamp for k in range(9)]
    assert stamps == [0, 1, 2, 53, 54, 55, 56, 7, 8]


def test_faults_act_one_after_the_other() -> None:
    bias = MeasurementFault(kind='bias', size=0.4)
    quantised = MeasurementFault(kind='quantised', size=1.0)
    assert delivered(bias, quantised) == plain()
    assert delivered(quantised, bias) == [(k + 0.4,) for k in range(10)]
    twice = MeasurementFault(kind='duplicated')
    assert delivered(twice, MeasurementFault(kind='silent', start=0.05)) == [
        *((float(k), float(k)) for k in range(5)),
        *[()] * 5,
    ]


@pytest.mark.parametrize(
    ('kind', 'size', 'expected'),
    [
        ('stuck', 1.0, [3.0, 3.0, 3.0, 3.0]),
        ('reversed', 1.0, [-3.0, -4.0, -5.0, -6.0]),
        ('limited', 4.5, [3.0, 4.0, 4.5, 4.5]),
        ('rate_limited', 25.0, [3.0, 3.25, 3.5, 3.75]),
        ('gain', 0.3, [0.3 * k for k in (3.0, 4.0, 5.0, 6.0)]),
    ],
)
def test_an_actuator_does_what_it_says_in_its_window(
    kind: str, size: float, expected: list[float]
) -> None:
    found = acted(CommandFault(kind=kind, size=size, **WINDOW))
    assert found[3:7] == expected
    assert found[:3] + found[7:] == [0.0, 1.0, 2.0, 7.0, 8.0, 9.0]


def test_a_window_of_any_length_is_a_whole_number_of_periods() -> None:
    for start, duration, hit in ((0.0299999, 0.0, 7), (0.03, 1e-9, 1), (0.031, 0.01, 1)):
        fault = MeasurementFault(kind='silent', start=start, duration=duration)
        assert delivered(fault).count(()) == hit


@given(
    st.sampled_from([kind for kind in MEASUREMENT_KINDS if kind in ONE_EACH]),
    st.floats(),
    st.floats(-1e12, 1e12).filter(lambda size: abs(size) > 1e-6),
)
@settings(max_examples=300)
def test_a_fault_of_the_value_never_raises_and_keeps_one_sample_each(
    kind: str, value: float, size: float
) -> None:
    injector = Injector(Faults(measurement=(MeasurementFault(kind=kind, size=size),)), RATE, 0)
    for k in range(3):
        (sample,) = injector.deliver(k, value)
        assert sample.stamp == k


def test_a_bad_fault_is_refused_by_name() -> None:
    with pytest.raises(SettingError, match=r"kind = 'of': must be one of none, silent"):
        MeasurementFault(kind='of')
    with pytest.raises(SettingError, match=r'f\.probability = 1\.5: must be a finite number'):
        build(MeasurementFault, {'probability': 1.5}, 'f')
    with pytest.raises(SettingError, match=r'size = 0\.0: .* not 0'):
        CommandFault(kind='gain', size=0.0)


# ---- in the loop ----

BEGIN, END = 3.0, 4.0
BAND = 0.02
LIMIT, RATE_LIMIT = 10.0, 400.0
STRENGTH: dict[str, dict[str, float]] = {
    'intermittent': {'probability': 0.5},
    'not_a_number': {'probability': 0.5},
    'duplicated': {'probability': 0.5},
    'reordered': {'probability': 0.3},
    'spike': {'probability': 0.05, 'size': 1.0},
    'garbage': {'size': 2.0},
    'bias': {'size': 0.2},
    'quantised': {'size': 0.05},
    'delayed': {'time': 0.02},
    'slow': {'time': 0.02},
    'clock_jump': {'time': 5.0},
}
# Longest time [s] from the end of the fault until the error stays in its band. Stuck and reversed
# drive an integrating plant away at full actuator, and the way back is as long.
BACK = {'silent': 2.0, 'infinite': 2.0, 'garbage': 3.0, 'bias': 2.0, 'quantised': 2.0}
BACK |= {'stuck': 10.0, 'spike': 2.0, 'clock_jump': 1.0}
BACK_FROM_ACTUATOR = {
    ('stuck', 1.0): 2.0,
    ('reversed', 1.0): 6.0,
    ('limited', 0.5): 3.0,
    ('rate_limited', 2.0): 2.0,
    ('gain', 0.3): 0.5,
    ('gain', 3.0): 0.5,
}


def in_the_loop(**faults: Any) -> Result:
    experiment = Experiment(
        plant=build(PLANTS['paper'], {'a3': 0.2}),
        reference=make_signal('cosine', {'frequency': 0.5}),
        disturbance=make_signal('sine', {'frequency': 1.0}),
        noise=Noise(variance=1e-6, seed=3),
        initial_state=(1.0, 0.0),
        faults=Faults(**faults),
        duration=16.0,
    )
    limits: dict[str, Any] = {
        'command_min': -LIMIT,
        'command_max': LIMIT,
        'command_rate_limit': RATE_LIMIT,
    }
    return simulate(experiment, ControllerSettings(**limits), compiled=False)


def assert_outlived(result: Result, back: float) -> None:
    assert np.all(np.isfinite(result.command))
    assert np.max(np.abs(result.command)) <= LIMIT
    # while samples are lost the limit counts over the time that passed
    assert np.max(np.abs(np.diff(result.command))) <= RATE_LIMIT / 200.0 * (1.0 + 1e-9)
    error = np.abs(result.reference - result.output)
    assert np.max(error[(result.time > 2.0) & (result.time < BEGIN)]) < BAND
    assert np.max(error[result.time > END + back]) < BAND


@pytest.mark.parametrize('kind', MEASUREMENT_KINDS)
def test_p04_the_loop_is_back_in_its_band_after_any_fault_of_the_measurement(kind: str) -> None:
    fault = MeasurementFault(
        kind=kind, start=BEGIN, duration=END - BEGIN, **STRENGTH.get(kind, {})
    )
    result = in_the_loop(measurement=(fault,))
    assert_outlived(result, BACK.get(kind, 0.0))
    statuses = {
        'silent': 'no_measurement',
        'not_a_number': 'no_measurement',
        'infinite': 'no_measurement',
        'reordered': 'bad_time_step',
        'clock_jump': 'restarted',
    }
    if kind in statuses:
        assert result.status_counts[statuses[kind]] > 0


@pytest.mark.parametrize(('kind', 'size'), BACK_FROM_ACTUATOR)
def test_p06_the_loop_is_back_in_its_band_after_any_fault_of_the_actuator(
    kind: str, size: float
) -> None:
    fault = CommandFault(kind=kind, size=size, start=BEGIN, duration=END - BEGIN)
    assert_outlived(in_the_loop(command=(fault,)), BACK_FROM_ACTUATOR[kind, size])


@pytest.mark.parametrize('late', (0.02, 0.2, 1.0))
def test_p09_late_samples_do_not_make_time_go_faster(late: float) -> None:
    faults = Faults(
        measurement=(MeasurementFault(kind='delayed', time=late, probability=0.2, start=1.0),)
    )
    experiment = Experiment(
        plant=build(PLANTS['paper'], {}),
        reference=make_signal('cosine', {}),
        disturbance=make_signal('none', {}),
        noise=Noise(seed=2),
        initial_state=(1.0, 0.0),
        faults=faults,
        duration=6.0,
    )
    loop = Loop(experiment, ControllerSettings())
    spans = []

    def tick(measurement: float, dt: float, **more: Any) -> float:
        spans.append(max(dt, 0.0))
        return Controller.tick(loop.controller, measurement, dt, **more)

    loop.controller.tick = tick  # type: ignore[method-assign, assignment]
    loop.run(np.empty((0, ROW_WIDTH)))
    assert sum(spans) == pytest.approx(6.0, abs=0.1)


def test_the_truth_knows_what_the_actuator_does() -> None:
    experiment = Experiment(
        plant=build(PLANTS['chain'], {'order': 1, 'damping': 0.0}),
        reference=make_signal('constant', {}),
        disturbance=make_signal('constant', {'offset': -2.0}),
        noise=Noise(),
        initial_state=(0.0,),
        faults=Faults(command=(CommandFault(kind='gain', size=0.5),)),
        duration=5.0,
    )
    settings = ControllerSettings(plant_order=1, b0=1.6)
    result = simulate(experiment, settings, compiled=False)
    # y' = 0.5 u - 2 at rest: u = 4, and L = y' - b0 u
    assert result.command[-1] == pytest.approx(4.0, rel=1e-6)
    assert result.total_disturbance[-1] == pytest.approx(-6.4, rel=1e-6)
    assert result.disturbance_estimate[-1] == pytest.approx(-6.4, rel=1e-6)


def test_every_kind_was_met_above() -> None:
    assert set(BACK) | set(STRENGTH) == set(MEASUREMENT_KINDS)
    assert {kind for kind, _ in BACK_FROM_ACTUATOR} == set(COMMAND_KINDS)


def test_a_fault_that_stays_as_it_was_goes_on_while_others_change() -> None:
    silent = MeasurementFault(kind='silent', duration=2.0 / RATE)
    stuck = MeasurementFault(kind='stuck')
    injector = Injector(Faults(measurement=(silent, stuck)), RATE, 0)

    def values(begin: int) -> list[list[float]]:
        return [[s.value for s in injector.deliver(k, float(k))] for k in (begin, begin + 1)]

    assert values(0) == [[], []]
    assert values(2) == [[2.0], [2.0]]
    gain = CommandFault(kind='gain', size=3.0)
    injector.change(Faults(measurement=(silent, stuck), command=(gain,)), 4)
    assert values(4) == [[2.0], [2.0]]
    assert injector.act(4, 1.0) == 3.0
    later = attrs.evolve(silent, start=1.0 / RATE)
    injector.change(Faults(measurement=(later, stuck), command=(gain,)), 6)
    assert values(6) == [[2.0], []]
    injector.change(Faults(), 8)
    assert values(8) == [[8.0], [9.0]]
    assert injector.act(8, 1.0) == 1.0


@pytest.mark.parametrize('kind', ('delayed', 'reordered', 'silent', 'not_a_number'))
def test_while_time_stands_still_nothing_is_late(kind: str) -> None:
    injector = Injector(
        Faults(measurement=(MeasurementFault(kind=kind, time=3.0 / RATE),)), RATE, 0
    )
    still = [injector.deliver(0, 5.0, still=True) for _ in range(100)]
    expected = {'silent': '[]', 'not_a_number': '[nan]'}.get(kind, '[5.0]')
    assert {str([s.value for s in samples]) for samples in still} == {expected}
    moving = [injector.deliver(k, 6.0) for k in range(1, 9)]
    assert max(map(len, moving)) <= 1
