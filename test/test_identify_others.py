"""Logs of plants that the estimator was not built on: one of each kind, from the bench."""

from __future__ import annotations

import attrs
from bench.identify import figures, refusals, study
from bench.other_plants import CASES
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.tuning.identification.candidates import (
    _poles_of,
    candidates,
    direction,
    dry_of,
    is_lag,
    rate_of,
    simplest,
    with_ways,
)
from nadrc_ros.tuning.identification.estimate import (
    _orthonormal,
    answers,
    is_open,
    outside_space,
    refine,
)
from nadrc_ros.tuning.identification.fit import bounds, Fit, fit_direct, likely_delays
from nadrc_ros.tuning.identification.identify import identify, in_the_best_band, Plant
from nadrc_ros.tuning.identification.log import log_of, noise_deviation
from nadrc_ros.tuning.identification.predictor import _hastened, Form, Log
import numpy as np
import pytest


def plant_of(name: str, order: int | None) -> Plant:
    """Return what is found of one log, of which the interval must hold the truth."""
    plant = identify(log_of(CASES[name].log(seed=0)), order)
    assert plant.b0.low <= CASES[name].b0[plant.order] <= plant.b0.high
    return plant


@pytest.mark.parametrize(
    ('name', 'order', 'delay'),
    [
        ('heater, dead time', None, 3.0),
        ('pump, no history', None, 0.17),
        ('conveyor, 300 periods late', 1, 60.0),
    ],
)
def test_dead_time_is_found_before_it_can_pass_for_an_order(
    name: str, order: int | None, delay: float
) -> None:
    plant = plant_of(name, order)
    assert (plant.order, plant.late) == (1, 'delay')
    assert plant.lateness is not None and plant.lateness.value == pytest.approx(delay, rel=0.03)
    assert plant.b0.half_width < 0.15


@pytest.mark.parametrize('periods', [0, 7, 150])
def test_all_delays_are_tried_at_once(periods: int) -> None:
    """Under a periodic command, a delay of a period more is as good; the first is taken."""
    rng = np.random.default_rng(periods)
    command = np.tile(np.repeat(rng.normal(size=20), 25), 6)
    late = np.concatenate((np.zeros(periods), command))[: len(command)]
    output = np.concatenate(([0.0], np.cumsum(0.01 * late)[:-1]))
    output += rng.normal(scale=1e-4, size=len(output))
    log = Log(measurement=output, command=command, reference=command, h=0.01)
    found = [start.delay / log.h for start in likely_delays(log, 1)]
    assert min((abs(k - periods) for k in found), default=0) <= 2


def test_no_filter_of_the_search_for_dead_time_grows() -> None:
    still = np.random.default_rng(1).normal(size=2000)
    log = Log(measurement=still, command=still, reference=still, h=0.01)
    with np.errstate(over='raise', invalid='raise'):
        likely_delays(log, 2)


def test_without_noise_the_disturbance_is_as_fast_as_can_be_told() -> None:
    """What was not foreseen is all of it, and remembered for no longer than a period."""
    rng = np.random.default_rng(1)
    command = np.repeat(rng.normal(size=40), 25)
    steps = 0.01 * (5.0 * command + rng.normal(size=1000).cumsum())
    output = np.append(0.0, steps.cumsum()[:-1])
    log = Log(measurement=output, command=command, reference=command, h=0.01)
    fit = fit_direct(log, Form(order=1))
    assert fit.gain == pytest.approx(5.0, rel=0.1)
    assert 2.0 < fit.bandwidth * log.h < np.pi


def test_a_lag_is_not_capped() -> None:
    plant = plant_of('oven, lag', 1)
    assert plant.late == 'lag' and plant.lateness is not None
    assert plant.lateness.value == pytest.approx(6.0, rel=0.05)
    assert plant.b0.half_width < 0.05


def test_a_slow_lag_is_of_the_next_order_where_other_orders_are_compared() -> None:
    log = log_of(CASES['oven, lag'].log(seed=0))
    lags = {
        open_order: [
            fit.parameters[-1] for fit in candidates(log, 1, None, open_order) if fit.form.lagging
        ]
        for open_order in (False, True)
    }
    assert lags[False] == pytest.approx([6.0] * 3, rel=0.05) and not lags[True]


def test_no_pole_settles_within_a_period_and_no_lag_takes_a_tenth_of_the_record() -> None:
    """Settled is a twentieth, e^-3."""
    still = np.zeros(500)
    log = Log(measurement=still, command=still, reference=still, h=0.01)
    _, fast = bounds(log, Form(order=1))
    assert np.exp(-fast * log.h) == pytest.approx(0.05, rel=0.01)
    _, (*_, slow) = bounds(log, Form(order=2, late='lag'))
    assert slow == pytest.approx(0.5)


def test_delay_and_lag_are_told_apart() -> None:
    plant = plant_of('oven, lag and dead time', 1)
    assert plant.late == 'delay and lag' and plant.lateness is not None
    assert plant.lateness.value == pytest.approx(15.0, rel=0.06)


@pytest.mark.parametrize('name', ['standing reference', 'speed hold, reference stands'])
def test_a_loop_whose_reference_stands_is_refused(name: str) -> None:
    with pytest.raises(UserError, match='the reference stands at'):
        identify(log_of(CASES[name].log(seed=0)), CASES[name].order)


@pytest.mark.parametrize('name', ['arm, dry friction', 'cart, dry friction, moves'])
def test_dry_friction_is_allowed_for(name: str) -> None:
    plant = plant_of(name, 2)
    assert plant.dry == 'friction' and plant.b0.half_width < 0.15


def test_friction_that_a_square_hides_is_in_the_interval() -> None:
    assert plant_of('slide, dry friction, square', 2).b0.half_width < 0.15


def test_first_rows_in_which_older_commands_act_do_not_count_in_a_model_without_delay() -> None:
    """With them b0 was five times too large, +-17 %."""
    with pytest.raises(UserError, match='b0 may be anything'):
        identify(log_of(CASES['heater, one step from cold'].log(seed=0)))


def test_small_backlash_is_no_order() -> None:
    assert plant_of('slide, small backlash', None).order == 2


def test_backlash_that_no_order_explains_is_refused() -> None:
    """Behind a lag, order 3 explains it best, with a b0 a hundred times too large."""
    with pytest.raises(UserError, match=r'explain too little of the output.* --order'):
        identify(log_of(CASES['arm, wide backlash'].log(seed=0)))


def test_a_pole_that_is_fast_against_the_noise_is_a_lag() -> None:
    found = {
        pole: is_lag(
            Fit(
                form=Form(order=2),
                bandwidth=10.0,
                parameters=np.array([0.0, -pole]),
                gain=1.0,
                innovation=1.0,
            )
        )
        for pole in (5.0, 15.0, 30.0)
    }
    assert found == {5.0: False, 15.0: False, 30.0: True}


def test_coloured_noise_leaves_an_answer() -> None:
    assert plant_of('slide, coloured noise', 2).b0.half_width < 0.4


def test_a_reference_that_comes_at_odd_times_costs_little() -> None:
    assert plant_of('axis, 30 % of reference late', 2).b0.half_width < 0.03


@pytest.mark.parametrize('name', ['arm, wide backlash', 'oven, coarse sensor', 'servo, encoder'])
def test_backlash_and_coarse_sensors_are_in_the_interval(name: str) -> None:
    assert plant_of(name, CASES[name].order).b0.half_width < 0.06


def test_what_a_slower_band_tells_otherwise_widens_the_interval() -> None:
    """By as much as noise alone would not leave between the two."""
    log = log_of(CASES['tank, open loop'].log(seed=0))
    chosen = simplest(candidates(log, 1, None, False))
    fit, (b0, *_) = in_the_best_band(log, chosen)
    own, slow = (
        refine(log, attrs.evolve(fit, bandwidth=ratio * fit.bandwidth))[1][0]
        for ratio in (1.0, 0.5)
    )
    assert own.error > slow.error and abs(own.value - slow.value) > 2.0 * slow.error
    assert b0.error > abs(own.value - slow.value)


def test_an_open_loop_needs_no_reference() -> None:
    plant = plant_of('tank, open loop', 1)
    assert plant.instruments and not plant.doubts


@pytest.mark.parametrize(
    'name', ['tank, open loop', 'exchanger, open loop', 'wheel, saturated', 'servo, encoder']
)
def test_an_answer_of_the_command_is_known_as_that(name: str) -> None:
    log = log_of(CASES[name].log(seed=0))
    found = is_open(log, fit_direct(log, Form(order=CASES[name].order)))
    assert found == name.endswith('open loop')


@pytest.mark.parametrize(
    ('share', 'rows', 'late', 'known'),
    [
        (0.5, 4000, 0, True),
        (0.5, 4000, 3, True),
        (0.5, 4000, 4, False),
        (0.3, 1000, 0, True),
        (0.12, 4000, 0, False),  # not much
        (0.3, 100, 0, False),  # not certain
    ],
)
def test_an_answer_is_soon_and_related_and_certain(
    share: float, rows: int, late: int, known: bool
) -> None:
    rng = np.random.default_rng(5)
    surprise, other = rng.normal(size=(2, rows))
    changes = share * np.roll(surprise, late) + np.sqrt(1.0 - share**2) * other
    log = Log(measurement=other, command=np.cumsum(changes), reference=other, h=0.01)
    assert answers(log, surprise) == known


def test_a_command_that_changes_now_and_then_answers_nothing() -> None:
    surprise = np.random.default_rng(5).normal(size=400)
    command = np.repeat([0.0, 1.0, 0.5, 2.0], 100)
    log = Log(measurement=surprise, command=command, reference=command, h=0.01)
    assert not answers(log, surprise)


def test_friction_and_backlash_are_allowed_for_where_the_direction_of_motion_is_known() -> None:
    """Of a plant of order 1, whose measurement is what moves, friction goes by its sign."""
    signs = np.ones(9)
    for way, side, of_order_1, of_order_2 in (
        (None, None, (), ()),
        (signs, None, ('backlash',), ('friction', 'backlash')),
        (signs, signs, ('friction', 'backlash'), ('friction', 'backlash')),
    ):
        log = Log(measurement=signs, command=signs, reference=signs, h=0.01, way=way, side=side)
        assert (dry_of(log, 1), dry_of(log, 2)) == (of_order_1, of_order_2)


def test_the_side_of_zero_tells_where_the_output_is_on_both() -> None:
    moving = np.sin(0.1 * np.arange(400))
    for offset, both in ((0.0, True), (2.0, False)):
        log = Log(measurement=moving + offset, command=moving, reference=moving, h=0.01)
        side = with_ways(log).side
        assert (side is not None) == both
        if side is not None:
            assert side.min() == -1.0 and side.max() == 1.0


def test_friction_hastened_by_the_lag_is_friction_again_behind_it() -> None:
    """The lag of the command is sampled exactly: a step has come to 1 - 1 / e after tau."""
    h, tau = 0.01, 0.2
    way = np.sign(np.sin(0.1 * np.arange(400)))
    hastened = _hastened(Form(order=2, late='lag'), np.array([0.0, 0.0, tau]), way, h)
    behind, lagged = 0.0, []
    for value in hastened:
        behind += (1.0 - np.exp(-h / tau)) * (value - behind)
        lagged.append(behind)
    np.testing.assert_allclose(lagged, way, atol=1e-9)
    assert _hastened(Form(order=2), np.zeros(2), way, h) is way


def test_filters_of_the_instruments_change_the_phase_and_nothing_else() -> None:
    """Laguerre's: behind a lag all-pass filters, which leave the energy of a signal."""
    reference = np.where(np.arange(4000) < 200, 0.0, 1.0)
    log = Log(measurement=reference, command=reference, reference=reference, h=0.01)
    space = outside_space(log, Form(order=1), bandwidth=10.0, open_loop=False)
    assert space is not None
    _, *stages = np.linalg.norm(space, axis=0)
    for energy in np.reshape(stages, (3, -1)):
        assert energy == pytest.approx(energy[0], rel=1e-6)


def test_a_reference_that_excites_less_than_there_are_parameters_is_no_error() -> None:
    rng = np.random.default_rng(3)
    command = np.repeat(rng.normal(size=20), 25)
    output = np.append(0.0, np.cumsum(0.05 * command)[:-1] + rng.normal(scale=1e-3, size=499))
    reference = np.append(np.zeros(499), 1.0)
    log = Log(measurement=output, command=command, reference=reference, h=0.01)
    _, (b0, *_) = refine(log, fit_direct(log, Form(order=2)))
    assert np.isfinite(b0.error)


def test_instruments_that_say_the_same_or_nothing_count_once_or_not() -> None:
    x = np.sin(np.arange(50.0))
    found = _orthonormal(np.column_stack([x, np.zeros(50), -3.0 * x]))
    assert found.shape == (50, 1)
    np.testing.assert_allclose(np.abs(found[:, 0]), np.abs(x) / np.linalg.norm(x), atol=1e-12)


def test_poles_are_the_roots_of_the_model() -> None:
    log = log_of(CASES['tank, open loop'].log(seed=0))
    fit = fit_direct(log, Form(order=2))
    poles = _poles_of(attrs.evolve(fit, parameters=np.array([-6.0, -5.0])))
    assert sorted(poles.real) == pytest.approx([-3.0, -2.0])


def test_kinks_of_the_motion_are_no_noise() -> None:
    rng = np.random.default_rng(2)
    steps = np.repeat([0.0, 1.0, -0.5, 0.3, 1.2, 0.0, 0.9, -1.0], 100)
    noise = rng.normal(scale=1e-3, size=len(steps))
    assert noise_deviation(steps + noise) == pytest.approx(1e-3, rel=0.15)


def test_a_coarse_sensor_has_noise() -> None:
    t = 0.01 * np.arange(5000)
    assert 0.01 < noise_deviation(0.1 * np.round(np.sin(t) / 0.1)) < 0.1


def test_the_way_is_told_where_noise_leaves_it() -> None:
    t = 0.01 * np.arange(2000)
    noise = np.random.default_rng(1).normal(size=len(t))
    moving = rate_of(np.sin(t) + 1e-4 * noise, 0.01)
    assert moving is not None
    fast = np.abs(np.cos(t)) > 0.1
    np.testing.assert_array_equal(direction(*moving)[fast], np.sign(np.cos(t))[fast])
    assert rate_of(np.sin(t) + 3.0 * noise, 0.01) is None


def test_a_rate_is_smoothed_over_a_tenth_of_the_log_at_most() -> None:
    """Quiet enough is the noise over 17 rows, and not yet that over 11."""
    t = 0.01 * np.arange(170)
    moving = 0.25 * np.sin(4.0 * t) + np.random.default_rng(1).normal(scale=0.005, size=len(t))
    assert rate_of(moving, 0.01) is not None
    assert rate_of(moving[:-1], 0.01) is None


def test_the_bench_counts_intervals_and_names_refusals() -> None:
    names = ('tank, open loop', 'standing reference')
    found = study(names, seeds=1)
    for order in ('given', 'open'):
        tank, standing = (figures(CASES[name], found[name, order]) for name in names)
        assert tank['held'] == tank['answers'] == 1 and not refusals(found[names[0], order])
        assert standing['answers'] == 0
        assert refusals(found[names[1], order]).startswith('1 x the reference stands at ..')
