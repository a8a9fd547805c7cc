"""What a log tells about its plant: b0 with an honest interval, or a refusal."""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from pathlib import Path
from typing import Any

import attrs
from bench.identify import answer, figures, PLANTS, Shipped
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.history import Change, History
from nadrc_ros.records.recorded_run import RecordedRun, window
from nadrc_ros.records.recording import RecordingError
from nadrc_ros.scenario import find_scenario, load, Scenario
from nadrc_ros.scenario.files import loads
from nadrc_ros.simulation.plants import Chain
from nadrc_ros.tuning import LEAST_MODULUS
from nadrc_ros.tuning.identification.advice import (
    advise,
    limits_of,
    reference_text,
    running_controller,
    scenario_of,
)
from nadrc_ros.tuning.identification.estimate import Estimate, robust_error
from nadrc_ros.tuning.identification.fit import fit_direct
from nadrc_ros.tuning.identification.identify import identify
from nadrc_ros.tuning.identification.log import is_one_sine, log_of, noise_deviation
from nadrc_ros.tuning.identification.predictor import Array, Form, Log, plant_polynomials
import numpy as np
import pytest
from scipy.signal import lfilter

SEEDS = 3
LAG = """
plant: {name: chain, order: 1, gain: 5, damping: 2, load: 1}
reference: {signal: square, frequency: 1}
disturbance: {signal: sine, amplitude: 2, frequency: 0.7}
noise: {variance: 1e-4}
rate: 100
duration: 20
controllers: {it: {structure: conventional, inner_bandwidth: 15}}
"""


def run_of(scenario: Scenario) -> RecordedRun:
    result = scenario.run(next(iter(scenario.controllers)))
    names = ('time', 'reference', 'measurement', 'command')
    columns = {name: getattr(result, name) for name in names}
    return RecordedRun(
        path=Path('run'),
        rate=scenario.rate,
        stop=float(columns['time'][-1]),
        columns=columns,
        summary={},
    )


@pytest.fixture(scope='module')
def lag() -> RecordedRun:
    return run_of(loads(LAG))


def with_columns(run: RecordedRun, **columns: Array) -> RecordedRun:
    return attrs.evolve(run, columns=run.columns | columns)


@pytest.mark.parametrize('order', [1, 2, 3])
@pytest.mark.parametrize('late', ['', 'lag'])
def test_the_sampled_model_is_the_plant_under_a_held_command(order: int, late: str) -> None:
    h, tau, rng = 0.02, 0.05, np.random.default_rng(order)
    a = np.array([-3.0, -2.0, -1.5])[:order]
    u = rng.normal(size=60)
    dense = np.repeat(u, 200)
    states, y = np.zeros(order + bool(late)), []
    for k, value in enumerate(dense):
        if k % 200 == 0:
            y.append(states[0])
        drive = value + a @ states[:order]
        top = (drive - states[-1]) / tau if late else drive
        states = states + h / 200 * np.append(states[1:], top)
    parameters = np.append(a, tau) if late else a
    poles, zeros = plant_polynomials(Form(order=order, late=late), parameters, h)
    predicted = lfilter(zeros, poles, u)
    np.testing.assert_allclose(predicted, y, atol=2e-3 * np.abs(y).max())


@pytest.mark.parametrize('delay', (0.0, 0.037))
def test_without_noise_the_estimate_is_the_gain(delay: float) -> None:
    """Nor is there backlash, which only rounding would make of it."""
    still = loads(LAG.replace('disturbance:', '#').replace('1e-4', '0'))
    late = attrs.evolve(still, input_delay=delay)
    plant = identify(log_of(run_of(late)))
    assert (plant.order, plant.dry, plant.late) == (1, '', 'delay' if delay else '')
    assert plant.b0.value == pytest.approx(5.0, rel=1e-4)
    assert plant.damping.value == pytest.approx(2.0, rel=1e-3)
    assert plant.noise < 1e-7
    # No plant is quite as its model is, however little noise there is.
    assert plant.b0.error == pytest.approx(0.005 * plant.b0.value, rel=0.02)


def test_noise_damping_and_order_are_found(lag: RecordedRun) -> None:
    plant = identify(log_of(lag))
    assert plant.order == 1 and plant.late == '' and plant.instruments
    assert plant.noise == pytest.approx(1e-2, rel=0.05)
    assert plant.damping.low < 2.0 < plant.damping.high
    assert plant.unexplained[1] == 1.0 and plant.unexplained[2] > 1.1
    assert not plant.doubts


def test_a_command_that_comes_late_is_seen_as_that(lag: RecordedRun) -> None:
    early = np.roll(lag.columns['command'], -7)[:-7]
    cut = {name: values[:-7] for name, values in lag.columns.items()}
    plant = identify(log_of(attrs.evolve(lag, columns=cut | {'command': early})), 1)
    assert plant.late == 'delay' and plant.lateness is not None
    assert plant.lateness.value == pytest.approx(0.07, abs=5e-3)
    assert plant.b0.value == pytest.approx(5.0, rel=0.02)
    advice = advise(plant, log_of(lag))
    assert advice.limit == 'the delay' and advice.margins.modulus >= LEAST_MODULUS
    scenario = scenario_of(plant, log_of(lag), advice.settings)
    assert scenario.input_delay == advice.settings.input_delay
    assert scenario.input_delay == pytest.approx(0.07, abs=5e-3)
    assert scenario.run('identified').status_counts['ok'] > 0


def test_a_delay_may_be_a_fraction_of_a_period(lag: RecordedRun) -> None:
    log = log_of(lag)
    plant = identify(log, 1)
    for late in (0.0049, 0.01003, 0.0701):
        lateness = Estimate(value=late, error=1e-4)
        delayed = attrs.evolve(plant, late='delay', lateness=lateness)
        scenario = scenario_of(delayed, log, advise(plant, log).settings)
        assert scenario.input_delay == late


@pytest.mark.parametrize('rate', [5.0, 1.0])
def test_a_slow_log_is_no_other_one(rate: float) -> None:
    """Timeouts of an oven, which is sampled once per second, are those of its periods."""
    text = LAG.replace('rate: 100', f'rate: {rate:g}').replace('damping: 2', 'damping: 0.05')
    text = text.replace('duration: 20', 'duration: 600').replace(
        'frequency: 1}', 'frequency: 0.05}'
    )
    text = text.replace('frequency: 0.7', 'frequency: 0.03').replace(
        'inner_bandwidth: 15',
        'inner_bandwidth: 0.3, controller_bandwidth: 0.06, measurement_timeout: 5, max_dt: 5',
    )
    log = log_of(run_of(loads(text)))
    plant = identify(log)
    assert plant.b0.low < 5.0 < plant.b0.high
    settings = advise(plant, log).settings
    settings.check_rate(rate)
    assert scenario_of(plant, log, settings).rate == rate


def test_a_run_that_was_not_recorded_at_the_rate_of_its_sensor_is_refused(
    lag: RecordedRun,
) -> None:
    stamps = 7.0 + lag.columns['time']
    log_of(with_columns(lag, measurement_stamp=1.01 * stamps))
    with pytest.raises(
        RecordingError, match='5 times as dense: record with the rate of the sensor'
    ):
        log_of(with_columns(lag, measurement_stamp=0.2 * stamps))


def test_the_limits_are_those_of_the_controller_that_ran_or_a_guess(lag: RecordedRun) -> None:
    """Not the range seen: an arm that moved gently could then not hold its load."""
    log = log_of(lag)
    running = ControllerSettings(command_min=-7.0, command_max=255.0)
    assert limits_of(log, running) == (-7.0, 255.0)
    for shift, low, high in ((1e4, 0.0, 2e4), (-1e4, -2e4, 0.0)):
        heater = attrs.evolve(log, command=0.1 * log.command + shift)
        assert limits_of(heater, None) == pytest.approx((low, high), rel=1e-3)
    saturated = attrs.evolve(log, command=np.clip(log.command, 0.0, 1.0))
    assert limits_of(saturated, None) == (0.0, 1.0)


def test_noise_of_a_twentieth_of_the_range_of_the_command_is_what_a_design_may_cost(
    lag: RecordedRun,
) -> None:
    log = log_of(lag)
    found = identify(log, 1)
    running = ControllerSettings(plant_order=1, command_min=-10.0, command_max=30.0)
    quiet, noisy = (advise(attrs.evolve(found, noise=x), log, running) for x in (1e-5, 3.0))
    assert (quiet.limit, noisy.limit) == ('the rate', 'the noise')
    for advice in (quiet, noisy):
        wanted, chosen = advice.design.wanted, advice.design.chosen
        assert wanted.command_noise == 2.0 and wanted.command_limit == 10.0
        assert wanted.reference_step == 2.0  # of the square
        assert chosen.prediction.command_noise <= 2.0
    assert noisy.design.chosen.prediction.command_noise > 1.9
    assert noisy.design.wanted.settling_time > 2.0 * quiet.design.wanted.settling_time


def test_the_controller_that_ran_is_the_one_in_the_log() -> None:
    values = attrs.asdict(ControllerSettings(b0=3.0, command_max=12.0)) | {'rate': 50.0}
    of_plant = {'plant': 'chain', 'order': 2}
    history = History(parameters={'/controller': values, '/plant': of_plant})
    running = running_controller(history)
    assert running is not None and (running.b0, running.command_max) == (3.0, 12.0)
    history.changes.append(Change(1.0, '/controller', 'b0', 3.0, 4.0))
    changed = running_controller(history)
    assert changed is not None and changed.b0 == 4.0
    assert running_controller(attrs.evolve(history, parameters={'/plant': of_plant})) is None
    both = {'/a/controller': values, '/b/controller': values}
    assert running_controller(History(parameters=both)) is None
    other = History(parameters={'/controller': values | {'structure': 'of tomorrow'}})
    assert running_controller(other) is None


def test_lost_rows_are_filled_in_and_change_little(lag: RecordedRun) -> None:
    kept = np.arange(len(lag.columns['time'])) % 40 != 7
    thin = attrs.evolve(lag, columns={k: v[kept] for k, v in lag.columns.items()})
    log = log_of(thin)
    assert len(log.command) == len(lag.columns['time'])
    assert log.command[7] == lag.columns['command'][6]
    assert identify(log, 1).b0.value == pytest.approx(5.0, rel=0.02)


def test_a_tenth_of_the_periods_may_have_been_missed(lag: RecordedRun) -> None:
    kept = np.random.default_rng(1).random(len(lag.columns['time'])) > 0.08
    missed = attrs.evolve(lag, columns={k: v[kept] for k, v in lag.columns.items()})
    plant = identify(log_of(missed), 1)
    assert plant.b0.low < 5.0 < plant.b0.high and plant.b0.value == pytest.approx(5.0, rel=0.05)


def test_without_a_reference_there_is_a_result_and_a_doubt(lag: RecordedRun) -> None:
    unknown = with_columns(lag, reference=np.full(len(lag.columns['time']), nan))
    plant = identify(log_of(unknown), 1)
    assert not plant.instruments and 'no reference' in plant.doubts[0]
    assert plant.b0.value == pytest.approx(5.0, rel=0.05)


def test_the_error_of_correlated_terms_is_larger() -> None:
    white = np.random.default_rng(3).normal(size=(100, 4000))
    found = np.mean([robust_error(terms) for terms in white])
    assert found == pytest.approx(1.3 * np.sqrt(4000), rel=0.05)  # the widest of several lags
    ten_alike = np.mean([robust_error(np.repeat(terms[:400], 10)) for terms in white])
    assert ten_alike == pytest.approx(np.sqrt(10.0) * found, rel=0.1)


def constant(run: RecordedRun) -> RecordedRun:
    return with_columns(run, command=np.full(len(run.columns['time']), 2.0))


def saturated(run: RecordedRun) -> RecordedRun:
    return with_columns(run, command=np.where(run.columns['time'] < 19.0, 3.0, 1.0))


def short(run: RecordedRun) -> RecordedRun:
    return attrs.evolve(run, columns={k: v[:100] for k, v in run.columns.items()})


def still(run: RecordedRun) -> RecordedRun:
    noise = np.random.default_rng(1).normal(size=len(run.columns['time']))
    return with_columns(run, measurement=noise)


def lossy(run: RecordedRun) -> RecordedRun:
    return attrs.evolve(run, columns={k: v[::2] for k, v in run.columns.items()})


def unrelated(run: RecordedRun) -> RecordedRun:
    walk = np.cumsum(np.random.default_rng(2).normal(size=len(run.columns['time'])))
    return with_columns(run, measurement=walk)


def silent(run: RecordedRun) -> RecordedRun:
    return with_columns(run, command=np.full(len(run.columns['time']), nan))


@pytest.mark.parametrize(
    ('spoil', 'said'),
    [
        (constant, 'the command is 2 all the time'),
        (saturated, 'the command is at 3 for 95 % of the time'),
        (short, 'only 100 samples with a command, and it takes 200'),
        (still, 'the output does not move'),
        (lossy, r'50 % of the periods have no measurement.*: record at a lower rate'),
        (unrelated, 'b0 may be anything from'),
        (silent, 'only 0 samples'),
    ],
)
def test_data_that_cannot_tell_are_refused_with_what_is_missing(
    spoil: Callable[[RecordedRun], RecordedRun], said: str, lag: RecordedRun
) -> None:
    with pytest.raises(UserError, match=said) as caught:
        identify(log_of(spoil(lag)), 1)
    assert ': ' in str(caught.value) and '\n' not in str(caught.value)


def test_the_longest_part_without_a_gap_is_proposed(lag: RecordedRun) -> None:
    silent = (lag.columns['time'] >= 4.0) & (lag.columns['time'] < 10.0)
    gap = attrs.evolve(lag, columns={k: v[~silent] for k, v in lag.columns.items()})
    with pytest.raises(UserError, match=r'30 % of the periods.*--from 10 --to 19\.99 has no gap'):
        log_of(gap)
    assert len(log_of(window(gap, 10.0, 19.99)).command) == 1000


def test_a_run_that_tells_little_has_a_wide_interval_and_a_doubt() -> None:
    """One slow move with a load step in it."""
    scenario = load(find_scenario('motor_speed'))
    truth: Any = scenario.plant.make()
    plant = identify(log_of(run_of(scenario)), 1)
    assert plant.b0.low < truth.b0 < plant.b0.high
    assert 'the interval is wide' in plant.doubts[-1]


def test_the_models_of_noise_and_of_the_reference_give_the_same_gain(lag: RecordedRun) -> None:
    assert fit_direct(log_of(lag), Form(order=1)).gain == pytest.approx(5.0, rel=0.05)


def test_a_row_of_the_reference_is_written_where_it_changes() -> None:
    reference = np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, -1.0, 0.5])
    log = Log(measurement=reference, command=reference, reference=reference, h=0.5)
    rows = '0,0', '1,1', '2,0', '3,-1', '3.5,0.5'
    assert reference_text(log) == '\n'.join(('time,reference', *rows, ''))


def test_a_motion_as_large_as_the_noise_is_one(lag: RecordedRun) -> None:
    t = lag.columns['time']
    noise = np.random.default_rng(4).normal(size=len(t))
    for motion in (1.0, 0.0):
        moving = with_columns(lag, measurement=motion * np.sqrt(2.0) * np.sin(t) + noise)
        if motion:
            assert np.std(log_of(moving).measurement) > 1.35
        else:
            with pytest.raises(RecordingError, match='the output does not move'):
                log_of(moving)


def test_a_reference_of_one_sine_is_known_as_that() -> None:
    t = np.arange(2000) * 0.01
    assert is_one_sine(2.0 + np.sin(3.0 * t))
    assert not is_one_sine(np.sin((0.5 + 0.1 * t) * t))
    assert not is_one_sine(np.sign(np.sin(3.0 * t)))
    # What counts is power, the square of an amplitude.
    assert is_one_sine(np.sin(3.0 * t) + 0.2 * np.sin(7.0 * t))
    assert not is_one_sine(np.sin(3.0 * t) + 0.5 * np.sin(7.0 * t))


def test_the_noise_of_a_moving_output_is_that_around_it() -> None:
    t: Array = 0.005 * np.arange(5000, dtype=np.float64)
    noise = np.random.default_rng(4).normal(scale=3e-3, size=5000)
    log = Log(measurement=10.0 * np.sin(4.0 * t) + noise, command=t, reference=t, h=0.005)
    assert noise_deviation(log.measurement) == pytest.approx(3e-3, rel=0.1)


def test_the_scenario_to_go_on_from_repeats_the_experiment(
    lag: RecordedRun, tmp_path: Path
) -> None:
    log = log_of(lag)
    plant = identify(log, 1)
    advice = advise(plant, log)
    reference = tmp_path / 'reference.csv'
    reference.write_text(reference_text(log))
    scenario = scenario_of(plant, log, advice.settings, reference)
    result = scenario.run('identified')
    assert scenario.duration == pytest.approx(20.0, abs=0.011)
    shared = min(len(result.reference), len(log.reference))
    assert np.array_equal(result.reference[:shared], log.reference[:shared])
    made = scenario.plant.make()
    assert isinstance(made, Chain)
    assert made.gain == pytest.approx(5.0, rel=0.02)
    assert scenario.noise.variance == pytest.approx(1e-4, rel=0.1)
    assert scenario.rate == 100.0 and advice.settings.inner_bandwidth <= 30.0
    # the load of 1 and the sine of 2 are what the gain and the damping do not explain
    assert scenario.disturbance.values['offset'] == pytest.approx(-1.0, abs=0.3)
    assert scenario.disturbance.values['amplitude'] == pytest.approx(2.0, rel=0.15)
    assert scenario.disturbance.values['frequency'] == pytest.approx(0.7, abs=0.05)
    followed = scenario_of(plant, log, advice.settings).reference.values
    assert followed['frequency'] == pytest.approx(1.0, abs=0.1)
    assert followed['offset'] == pytest.approx(log.measurement.mean(), abs=0.01)
    error = log.reference - log.measurement
    assert result.metrics.rmse < np.sqrt(np.mean(error**2))


def test_nearly_all_intervals_hold_the_true_b0_and_are_narrow() -> None:
    held = 0.0
    for name in ('paper', 'chain', 'motor', 'pendulum'):
        plant = PLANTS[name]
        assert isinstance(plant, Shipped)
        if name in ('paper', 'chain'):
            plant = Shipped(plant.scenario.changed(rate=50.0))
        answers = [answer(plant, seed, 'given' if seed else 'open') for seed in range(SEEDS)]
        found = figures(plant, answers)
        assert found['answers'] == SEEDS and found['held'] >= SEEDS - 1, (name, found)
        assert found['widest'] < 20.0, (name, found)
        assert answers[0].order == plant.order, (name, answers[0])
        held += found['held']
        if name == 'motor':  # that of tau y'' + y' = b0 u + a y is K / (J R), as it declares
            assert abs(found['bias']) < 1.0 and found['widest'] < 3.0
    assert held >= 4 * SEEDS - 1
