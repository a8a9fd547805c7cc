"""What theory and `nadrc design` say of loops with known poles and vibrations is what they do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import attrs
from hypothesis import assume, given
from hypothesis import strategies as st
from law_helpers import at_least, design_of, noise
from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.recorded_run import modelled
from nadrc_ros.scenario import PlantSpec
from nadrc_ros.scenario.files import load, loads
from nadrc_ros.theory.delayed import command_variance, delayed_loop
from nadrc_ros.theory.loop import chain, loop_growth
from nadrc_ros.theory.margins import margins
from nadrc_ros.theory.model import residual
from nadrc_ros.tuning import LARGEST_OVERSHOOT
from nadrc_ros.tuning.design.bandwidths import settling_factor
from nadrc_ros.tuning.design.candidates import candidates
from nadrc_ros.tuning.design.first_design import expect, first_design
from nadrc_ros.tuning.design.limits import conflict, pole_overshoot
from nadrc_ros.tuning.design.prediction import Prediction
from nadrc_ros.tuning.design.requirements import Conflict, Requirements
from nadrc_ros.tuning.identification.advice import known_dynamics
from nadrc_ros.tuning.identification.estimate import Estimate
from nadrc_ros.tuning.identification.identify import identify
from nadrc_ros.tuning.identification.log import log_of
from nadrc_ros.tuning.search.score import Judge
from nadrc_ros.tuning.search.settings import TuneSettings
import numpy as np
import pytest
from scipy import optimize
from test_identify import LAG, run_of
from test_internal_model import left
from theory_helpers import LINEAR, Loop, response, simulated_stable, WIDE

LOOPS = Path(__file__).parents[1] / 'examples' / 'loops'
H = 0.005
LAGGED = Requirements(
    order=2,
    b0=20.0,
    settling_time=0.5,
    rate=200.0,
    noise_std=1e-3,
    plant_poles=(-20.0, 0.0),
    disturbance_frequencies=(60.0,),
)


@st.composite
def loops(draw: st.DrawFn) -> Any:
    n = draw(st.integers(1, 3))
    rates = st.sampled_from((0.0, -0.5, -8.0, -40.0, 2.0))
    actual = [draw(rates) for _ in range(n)]
    wrong = draw(st.sampled_from((0.5, 1.0, 1.0, 2.0)))
    design = design_of(
        structure=draw(st.sampled_from(LINEAR)),
        plant_order=n,
        inner_bandwidth=draw(st.floats(10.0, 80.0)),
        outer_bandwidth=draw(st.floats(10.0, 80.0)),
        controller_bandwidth=draw(st.floats(1.0, 15.0)),
        levels=draw(st.integers(1, 3)),
        extended_states=draw(st.integers(1, 3)),
        feedback_level=draw(st.sampled_from(('inner', 'outer'))),
        error_based=draw(st.booleans()),
        observer_gain_factor=draw(st.sampled_from((1.0, 1.0, 0.5))),
        plant_poles=[wrong * p for p in actual],
        disturbance_frequencies=draw(st.sampled_from(((0.0,), (20.0,), (90.0,), (11.0, 45.0)))),
        input_delay=draw(st.sampled_from((0.0, 0.0, 2.0 * H, 3.4 * H))),
        **WIDE,
    )
    gain = draw(st.floats(0.3, 4.0))
    return design, chain(n, gain, np.poly(actual)[:0:-1].tolist())


@at_least(15)
@given(loops())
def test_stable_by_theory_is_stable_as_it_runs(loop: Any) -> None:
    design, plant = loop
    delay = design.input_delay
    growth = loop_growth(design, plant, H, delay)
    assume(abs(growth - 1.0) > 4e-3)
    assert simulated_stable(design, plant, H, abs(growth - 1.0), delay) == (growth < 1.0)


@pytest.fixture(scope='module')
def nested() -> tuple[Prediction, Design]:
    """Return what is expected of two nested observers, and their design without limits."""
    candidate = next(c for c in candidates(LAGGED) if c.name == 'nested_2')
    design = make_design(candidate.settings)
    return candidate.prediction, attrs.evolve(design, command_min=-1e9, command_max=1e9)


def test_the_margins_of_a_design_are_where_it_becomes_unstable(
    nested: tuple[Prediction, Design],
) -> None:
    prediction, design = nested
    for gain, stable in ((0.95, True), (1.05, False)):
        plant = chain(2, 20.0 * prediction.margins.gain_high * gain, [0.0, 20.0])
        distance = abs(loop_growth(design, plant, H) - 1.0)
        assert simulated_stable(design, plant, H, distance) is stable


def test_the_noise_of_a_design_is_that_of_its_run(nested: tuple[Prediction, Design]) -> None:
    prediction, design = nested
    loop, commands = Loop(design, chain(2, 20.0, [0.0, 20.0]), H, start=0.0), []
    for v in noise(3, 15_000, LAGGED.noise_std):
        u = loop.law.step([0.0], loop.output + v, H)
        loop.x = [
            sum(a * x for a, x in zip(row, loop.x)) + b * u for row, b in zip(loop.a, loop.b)
        ]
        commands.append(u)
    assert np.std(commands[1000:]) == pytest.approx(prediction.command_noise, rel=0.05)


def test_a_first_design_of_a_lagged_plant_settles_in_time() -> None:
    quiet = attrs.evolve(LAGGED, noise_std=0.0)
    found = first_design(quiet)
    assert found.scenario.plant.name == 'lags' and found.pid is None
    for candidate in found.candidates:
        assert candidate.prediction.settling_time == pytest.approx(0.5, rel=0.03)
        result = found.scenario.run(candidate.name)
        alone = result.time < found.scenario.disturbance.values['start_time']
        assert result.output[alone].max() < 1.001 * result.reference.max()
        assert expect(found.scenario, candidate).saturated == 0.0
    with pytest.raises(SettingError, match='plant_poles'):
        Requirements(order=2, plant_poles=(-1.0, -2.0, -3.0))
    with pytest.raises(SettingError, match='disturbance_frequencies'):
        Requirements(rate=10.0, disturbance_frequencies=(60.0,))


@pytest.mark.parametrize(
    ('n', 'pole', 'yes'), ((1, -5.0, True), (2, -5.0, True), (2, -7.0, False))
)
def test_a_step_bears_poles_that_are_wrong_by_two_where_a_design_says_nothing(
    n: int, pole: float, yes: bool
) -> None:
    """The observer is faster for it, up to 10 wc. As simulated, and else it is said."""
    settling = settling_factor(n)
    asked = Requirements(
        order=n, settling_time=settling, rate=50.0, plant_poles=(pole,), reference_step=1.0
    )
    found = first_design(asked)
    assert ('with one observer of order 1 and b0 = 0.1429' in found.warning) is not yes
    assert ('poles of the plant' in found.warning) is not yes
    for name, factor in (('half', 0.5), ('twice', 2.0)):
        plant = {'poles': [factor * p for p in asked.poles], 'gain': 1.0}
        actual = attrs.evolve(found.scenario, plant=PlantSpec(name='lags', values=plant))
        result = attrs.evolve(actual, duration=2.1 * settling).run(found.chosen.name)
        over = max(result.output.max() - 1.0, 0.0)
        assert over < (LARGEST_OVERSHOOT if yes else 0.1)
        told = pole_overshoot(found.chosen.settings, asked, factor)
        assert over == pytest.approx(told, abs=2e-3)
        assert (
            f'{name} as fast as given, a step overshoots by {100.0 * told:.2g} %'
            in found.rules[-1]
        )
    if not yes:
        lower = first_design(
            attrs.evolve(
                asked, order=1, b0=-1.0 / pole, plant_poles=(0.0,), structure='conventional'
            )
        ).chosen.settings
        for factor in (0.5, 1.0, 2.0):
            lagged = attrs.evolve(asked, plant_poles=(factor * pole,))
            assert pole_overshoot(lower, lagged, 1.0) < 0.03


def test_a_design_says_that_poles_that_are_wrong_make_it_unstable() -> None:
    asked = Requirements(order=3, settling_time=2.0, rate=100.0, plant_poles=(-30.0, 0.0, 0.0))
    found = first_design(attrs.evolve(asked, structure='nested'))
    loop = make_design(found.chosen.settings)
    for factor in (0.5, 2.0):
        plant = chain(3, 1.0, np.poly(factor * np.array(asked.poles))[:0:-1].tolist())
        assert loop_growth(loop, plant, 0.01) > 1.0
    assert found.warning.count('as given, the loop is unstable') == 2
    assert found.warning.endswith('or take one observer')
    plain = first_design(attrs.evolve(asked, structure='conventional'))
    assert 'the poles of the plant' not in plain.warning


def test_a_vibration_behind_a_delay_is_refused_by_its_name_and_what_is_possible_is() -> None:
    """It said that 20 s were too short, where 1.6 s settle, and that there is no settling time."""
    slow = Requirements(
        settling_time=100.0, rate=100.0, delay=0.02, disturbance_frequencies=(60.0,)
    )
    with pytest.raises(Conflict, match=r'frequencies = \(60.0,\) leaves .* at most') as caught:
        first_design(slow)
    possible = float(str(caught.value).rsplit('at most ', 1)[1].split()[0])
    assert not conflict(attrs.evolve(slow, settling_time=possible))
    assert conflict(attrs.evolve(slow, settling_time=1.05 * possible))
    near = first_design(attrs.evolve(slow, settling_time=1.6, delay=0.1))
    assert 'or no disturbance_frequencies' in near.warning


@pytest.mark.parametrize('n', (1, 2))
def test_at_equal_noise_a_plain_observer_leaves_a_thousand_times_more(n: int) -> None:
    poles, w = (-10.0, *[0.0] * (n - 1)), 30.0
    known = design_of(
        structure='conventional',
        plant_order=n,
        plant_poles=poles,
        disturbance_frequencies=(w,),
        **WIDE,
    )

    def plain(bandwidth: float) -> Any:
        return design_of(
            structure='conventional',
            plant_order=n,
            plant_poles=poles,
            inner_bandwidth=bandwidth,
            **WIDE,
        )

    plant = chain(n, 1.0, np.poly(poles)[:0:-1].tolist())

    def variance(design: Any) -> float:
        return float(command_variance(delayed_loop(design, plant, H)))

    wider = optimize.brentq(lambda v: variance(plain(v)) - variance(known), 20.0, 400.0)
    assert wider > 41.0
    assert left(known, poles, w)[0] < 1e-3 * left(plain(wider), poles, w)[0]


@pytest.mark.parametrize('structure', LINEAR)
def test_no_level_leaves_anything_at_a_known_frequency(structure: str) -> None:
    design = design_of(structure=structure, disturbance_frequencies=(30.0, 7.0))
    left_over = np.abs(response(residual(design), np.array([7.0, 30.0, 18.0]))[:, 0, 0])
    assert left_over[0] < 1e-9 and left_over[1] < 1e-9 < left_over[2]


def test_the_truth_of_a_record_is_that_of_the_model_or_unknown() -> None:
    time, y, truth = np.arange(3.0), np.array([1.0, 2.0, 3.0]), np.array([0.5, 0.5, 0.5])
    plain = ControllerSettings(plant_order=1)
    lagged = attrs.evolve(plain, plant_poles=(-4.0,))
    found = modelled(time, y, truth, [(0.0, plain), (1.5, lagged)])
    assert found.tolist() == [0.5, 0.5, 12.5]
    second = ControllerSettings(plant_poles=(-4.0, 0.0))  # its y' is in no record
    assert np.isnan(modelled(time, y, truth, [(0.0, second)])).all()


def test_a_search_judges_the_margins_with_the_poles_that_are_known() -> None:
    """Around a chain the damping that the law takes away would be missing."""
    lagged = load(LOOPS / 'known_dynamics.yaml')
    found = Judge(lagged, 'known', build(TuneSettings, {}), compiled=False).margins(
        lagged.controllers['known']
    )
    design = make_design(lagged.controllers['known'])
    expected = margins(design, chain(2, 20.0, [0.0, 20.0]), H)
    assert found.gain_high == pytest.approx(expected.gain_high, rel=1e-3)
    assert found.modulus == pytest.approx(expected.modulus, rel=1e-2)


def test_a_pole_that_was_found_may_be_told_to_the_controller() -> None:
    plant = identify(log_of(run_of(loads(LAG))), 1)
    settings = ControllerSettings(plant_order=1, b0=5.0, controller_bandwidth=4.0)
    said = known_dynamics(plant, settings)
    assert 'damping may be given' in said and f'--plant-poles {-plant.damping.value:.3g}.' in said
    for wc, w in ((40.0, 200.0), (0.2, 1.0)):  # hardly felt, and hardly seen
        other = attrs.evolve(settings, controller_bandwidth=wc, inner_bandwidth=w)
        assert known_dynamics(plant, other) == ''
    late = attrs.evolve(plant, late='lag', lateness=Estimate(value=0.05, error=1e-3))
    said = known_dynamics(late, settings)
    assert said.startswith('The damping and the lag, here taken for a delay, may be given')
    assert 'plant_order 2, b0 100, plant_poles [-20.0, -' in said
