"""Known poles and known frequencies: the poles of the observers, exact rejection, gaps, steps."""

from __future__ import annotations

from math import pi
import random
from typing import Any

import attrs
from law_helpers import design_of, Law, NAMES, ORDERS
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.internal_model import place_known, take_feedback
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.theory.known import feedback_gains, known_poles
from nadrc_ros.theory.loop import chain as linear_chain
from nadrc_ros.theory.system import Array, zero_order_hold
from nadrc_ros.tuning.design.requirements import Requirements
import numpy as np
import pytest
from scipy import linalg

H = 0.005
WIDE: dict[str, Any] = {'command_min': -1e9, 'command_max': 1e9}


def random_design(rng: random.Random, n: int, w: float, frequencies: int) -> Design:
    """Poles and frequencies from far below to ten times the bandwidth."""
    poles = [rng.choice((0.0, -w * 10.0 ** rng.uniform(-2.0, 1.0))) for _ in range(n)]
    known = [w * 10.0 ** rng.uniform(-1.0, 1.0) for _ in range(frequencies)]
    return design_of(
        structure=rng.choice(('nested', 'generalized')),
        plant_order=n,
        extended_states=rng.randint(1, 3),
        inner_bandwidth=w,
        outer_bandwidth=0.6 * w,
        plant_poles=[*poles[1:], -0.1 * w],
        disturbance_frequencies=known or [0.0],
    )


@pytest.mark.parametrize('frequencies', range(4))
@pytest.mark.parametrize('n', ORDERS)
def test_the_observer_has_the_poles_that_were_asked_for(n: int, frequencies: int) -> None:
    """By the characteristic polynomial on circles around 1, for w h from 1e-3 to 2."""
    rng = random.Random(10 * n + frequencies)
    for _ in range(12):
        h = 10.0 ** rng.uniform(-4.0, -1.0)
        design = random_design(rng, n, 10.0 ** rng.uniform(-3.0, 0.3) / h, frequencies)
        state = blank_state(design)
        place_known(design, h, 1.0, state)
        scale = h ** np.arange(float(design.states))
        model = np.array(state.transition)[:-1, :-1] * scale[:, None] / scale
        gain = np.array(state.scratch[0]) * scale
        matrix = model - np.outer(gain, np.eye(design.states)[0] + model[0])  # minus 1
        _, asked = known_poles(design, 0, h)
        for radius in (1.0, 3.0 * design.bandwidths[0] * h):
            for point in radius * np.exp(1j * np.linspace(0.1, 3.0, 5)):
                found = np.linalg.det(point * np.eye(design.states) - matrix)
                expected = np.prod(point - np.expm1(asked * h))
                size = np.prod(abs(point) + np.abs(np.expm1(asked * h)))
                assert abs(found - expected) < 1e-9 * size


class Shaken:
    """A plant of real poles under a sinusoid, over steps of any length: exact."""

    def __init__(self, poles: tuple[float, ...], w: float, b0: float = 1.0) -> None:
        self.n = n = len(poles)
        plant = linear_chain(n, b0, np.poly(poles)[:0:-1].tolist())
        self.a = np.zeros((n + 3, n + 3))
        self.a[:n, :n], self.a[:n, -1:], self.a[n - 1, n] = plant.a, plant.b, 1.0
        self.a[n, n + 1], self.a[n + 1, n] = w, -w
        self.x = np.zeros(n + 3)
        self.x[n + 1] = 1.0
        self.known: dict[float, Array] = {}

    @property
    def y(self) -> float:
        return float(self.x[0])

    @property
    def disturbance(self) -> float:
        return float(self.x[self.n])

    def advance(self, u: float, h: float) -> None:
        self.x[-1] = u
        if h not in self.known:
            self.known[h] = np.asarray(linalg.expm(self.a * h))
        self.x = self.known[h] @ self.x


def left(design: Design, poles: tuple[float, ...], w: float) -> tuple[float, float]:
    """Return what a sinusoid leaves in y at the samples, and in the estimate of it."""
    plant, law, ys, ds = Shaken(poles, w), Law(design), [], []
    for k in range(3000):
        u = law.step([0.0], plant.y, H)
        if k > 2800:
            ys.append(abs(plant.y))
            estimate = sum(level[design.order] for level in law.state.levels)
            ds.append(abs(plant.disturbance - estimate))
        plant.advance(u, H)
    return max(ys), max(ds)


@pytest.mark.parametrize('n', (1, 2, 3))
@pytest.mark.parametrize('structure', NAMES)
def test_a_known_vibration_is_gone_from_the_samples(structure: str, n: int) -> None:
    """To rounding, in any structure, also behind a known lag; without it much is left."""
    poles = (-15.0, *[0.0] * (n - 1))
    values = {'structure': structure, 'plant_order': n, 'eso_delta': 10.0, **WIDE}
    plain = left(design_of(**values, plant_poles=poles), poles, 30.0)
    known = design_of(**values, plant_poles=poles, disturbance_frequencies=(30.0,))
    found = left(known, poles, 30.0)
    assert plain[1] > 0.5
    assert found[0] < 1e-9 * plain[0] and found[1] < 1e-9 * plain[1]


@pytest.mark.parametrize('delay', (2.0 * H, 3.4 * H))
def test_so_it_is_behind_a_dead_time(delay: float) -> None:
    """The command is that for the vibration of the time when it arrives."""
    design = design_of(
        disturbance_frequencies=(30.0,), input_delay=delay, plant_poles=(-15.0, 0.0), **WIDE
    )
    plant, law, ys, late = Shaken((-15.0, 0.0), 30.0), Law(design), [], [0.0] * 5
    whole = int(delay / H + 1e-9)
    part = delay - whole * H
    for _ in range(4000):
        ys.append(abs(plant.y))
        late = [law.step([0.0], plant.y, H), *late[:-1]]
        if part > 1e-9:
            plant.advance(late[whole + 1], part)
        plant.advance(late[whole], H - part)
    assert max(ys[3800:]) < 1e-9 * max(ys)


def test_three_vibrations_of_which_one_is_there() -> None:
    design = design_of(disturbance_frequencies=(50.0, 30.0, 11.0), **WIDE)
    assert left(design, (0.0, 0.0), 30.0)[1] < 1e-6


@pytest.mark.parametrize('seed', range(3))
def test_lost_samples_cost_no_accuracy(seed: int) -> None:
    """The model knows what the vibration did in a gap, also in one longer than half a turn."""
    rng, w = random.Random(seed), 30.0
    design = design_of(disturbance_frequencies=(w,), plant_poles=(-15.0, 0.0), **WIDE)
    plant, law, largest = Shaken((-15.0, 0.0), w), Law(design), 0.0
    for k in range(6000):
        steps = 1 if rng.random() > 0.05 else rng.choice((2, 3, 5, 21, 40))
        u = law.u
        plant.advance(u, H * steps)
        u = law.step([0.0], plant.y, H * steps)
        if k > 4000:
            estimate = sum(level[2] for level in law.state.levels)
            largest = max(largest, abs(plant.disturbance - estimate))
    assert largest < 1e-6


def step_response(design: Design, poles: tuple[float, ...], ticks: int = 1500) -> Array:
    plant, law, ys = Shaken(poles, 0.0), Law(design), []
    plant.x[plant.n + 1] = 0.0
    for _ in range(ticks):
        ys.append(plant.y)
        plant.advance(law.step([1.0], plant.y, H), H)
    return np.array(ys)


LAGGED: tuple[tuple[tuple[float, ...], dict[str, Any]], ...] = (
    ((-5.0,), {}),
    ((-20.0,), {}),
    ((-20.0, 0.0), {}),
    ((-3.0, -0.5), {}),
    ((-2.0, -2.0, 0.0), {}),
    ((-20.0, 0.0), {'structure': 'cascade'}),
    ((-20.0, 0.0), {'structure': 'conventional'}),
    ((-20.0, 0.0), {'structure': 'printed', 'inner_bandwidth': 30.0}),
)


@pytest.mark.parametrize(('poles', 'values'), LAGGED)
def test_a_step_does_not_overshoot_behind_a_known_lag(
    poles: tuple[float, ...], values: dict[str, Any]
) -> None:
    """As behind none; of these, told half or twice as long, by less than 6 %; no general bound."""
    design = design_of(plant_order=len(poles), plant_poles=poles, **WIDE, **values)
    found = step_response(design, poles)
    ideal = step_response(design_of(plant_order=len(poles), **WIDE), (0.0,) * len(poles))
    assert found[-1] == pytest.approx(1.0, abs=1e-6)
    assert found.max() < 1.001
    assert np.abs(found - ideal).max() < 1e-3 + np.abs(ideal[1:] - ideal[:-1]).max()
    for wrong in (0.5, 2.0):
        poles_taken = [wrong * p for p in poles]
        design = design_of(plant_order=len(poles), plant_poles=poles_taken, **WIDE, **values)
        assert step_response(design, poles).max() < 1.06


@pytest.mark.parametrize('poles', [(-390.0,), (-300.0, 0.0), (-390.0, 0.0, 0.0), (-390.0, -60.0)])
def test_nor_behind_one_that_is_fast_for_the_rate(poles: tuple[float, ...]) -> None:
    """Up to p h = 1.95; fed back as in continuous time, that of order 2 overshot by 3.6 %."""
    design = design_of(plant_order=len(poles), plant_poles=poles, **WIDE)
    found = step_response(design, poles)
    assert found[-1] == pytest.approx(1.0, abs=1e-6) and found.max() < 1.0 + 1e-9


@pytest.mark.parametrize('n', ORDERS)
def test_feedback_places_the_poles_of_the_plant_under_a_held_command(n: int) -> None:
    """By the characteristic polynomial, of what the law and of what theory says."""
    rng = random.Random(n)
    for _ in range(20):
        h = 10.0 ** rng.uniform(-4.0, -1.0)
        wc = 10.0 ** rng.uniform(-3.0, 0.0) / h
        poles = [rng.choice((0.0, 0.3 * wc, -wc * 10.0 ** rng.uniform(-2.0, 1.0)))]
        poles = [max(p, -2.0 / h) for p in (*poles * (n - 1), -wc)]
        design = design_of(
            plant_order=n, plant_poles=poles, controller_bandwidth=wc, measurement_timeout=0.0
        )
        state = blank_state(design)
        place_known(design, h, 1.0, state)
        take_feedback(design, state)
        plant = zero_order_hold(linear_chain(n, 1.0, design.damping), h)
        scale = h ** np.arange(float(n))
        for gains in (np.array(state.feedback), feedback_gains(design, h)):
            away = plant.a - plant.b * (gains - np.array(design.damping)) - np.eye(n)
            away *= scale[:, None] / scale
            for point in 3.0 * wc * h * np.exp(1j * np.linspace(0.1, 3.0, 5)):
                expected = (point - np.expm1(-wc * h)) ** n
                found = np.linalg.det(point * np.eye(n) - away)
                assert abs(found - expected) < 1e-8 * abs(expected)
        assert feedback_gains(design, 1e-9 * h) == pytest.approx(design.feedback_gains, rel=1e-4)


def test_without_poles_the_feedback_is_that_of_the_chain() -> None:
    design = design_of(disturbance_frequencies=(12.0,))
    state = blank_state(design)
    place_known(design, H, 1.0, state)
    take_feedback(design, state)
    assert state.feedback == design.feedback_gains == feedback_gains(design, H).tolist()


@pytest.mark.parametrize('structure', NAMES)
def test_at_rest_it_stays_at_rest(structure: str) -> None:
    """Where the plant needs a command to stay: d_1 begins as a_0 y - b0 u."""
    poles = (-2.0, -3.0)
    design = design_of(structure=structure, plant_poles=poles, b0=2.0, **WIDE)
    plant, law = Shaken(poles, 0.0, b0=2.0), Law(design, y=5.0, u=15.0)
    plant.x[:] = 5.0, 0.0, 0.0, 0.0, 15.0
    for _ in range(200):
        u = law.step([5.0], plant.y, H)
        assert u == pytest.approx(15.0, abs=1e-9)
        plant.advance(u, H)


@pytest.mark.parametrize('retuned', (33.0, 30.0))
def test_p12_a_vibration_that_changes_its_frequency_is_followed(retuned: float) -> None:
    """Size and phase of the estimate go over, as the derivatives are of the new frequency."""
    settings = ControllerSettings(disturbance_frequencies=(30.0,), **WIDE)
    controller, plant = Controller(settings, checked=True), Shaken((0.0, 0.0), 30.0)
    for k in range(6000):
        if k == 4000:
            plant.a[plant.n, plant.n + 1], plant.a[plant.n + 1, plant.n] = retuned, -retuned
            plant.known.clear()
            controller.retune(attrs.evolve(settings, disturbance_frequencies=(retuned,)))
        u = controller.tick(plant.y, H, reference=[0.0])
        error = abs(plant.disturbance - controller.total_disturbance)
        assert k < 3900 or error < (1e-9 if k < 4000 or retuned == 30.0 else 0.2)
        plant.advance(u, H)
    assert error < 1e-6


def moved_by_another_b0(
    settings: ControllerSettings, after: float, told: float, enabled: bool = True
) -> tuple[float, float]:
    """Return the largest |y|, and error of the estimate, from a change of b0 on."""
    poles = settings.known_poles
    controller, plant = Controller(settings, enabled=enabled, checked=True), Shaken(poles, 30.0)
    sent = [0.0] * round(settings.input_delay / H)
    largest = away = 0.0
    for k in range(4000):
        if k == 3500:
            controller.retune(attrs.evolve(settings, b0=after))
        y, variable = plant.y, 0.0 if k < 3600 else told
        sent.append(controller.tick(y, H, reference=[0.0], gain_variable=variable))
        if k >= 3500:
            largest = max(largest, abs(y))
            away = max(away, abs(plant.disturbance - controller.total_disturbance))
        plant.advance(sent.pop(0), H)
    return largest, away


@pytest.mark.parametrize(
    ('structure', 'n'), [('nested', 1), ('nested', 3), *((name, 2) for name in NAMES)]
)
def test_p12_another_b0_moves_nothing_under_a_known_vibration(structure: str, n: int) -> None:
    """What the command cancels is to the estimates as large as b0; it moved an output by 0.014."""
    settings = ControllerSettings(
        structure=structure,
        plant_order=n,
        inner_bandwidth=20.0,
        outer_bandwidth=20.0,
        plant_poles=(-15.0,) if n > 1 else (0.0,),
        disturbance_frequencies=(30.0, 7.0),
        **WIDE,
    )
    assert moved_by_another_b0(settings, 1.7, 0.0)[0] < 1e-9
    if structure != 'nested':
        return
    table = attrs.evolve(settings, b0_table=(0.0, 1.0, 1.0, 0.6), b0_source='topic')
    assert moved_by_another_b0(table, 1.0, 1.0)[0] < 1e-9
    late = attrs.evolve(settings, input_delay=0.015)
    assert moved_by_another_b0(late, 1.7, 0.0)[0] < 2e-5


def test_p12_nor_the_estimate_of_a_vibration_that_no_command_cancels() -> None:
    """Nothing of it is in what the command did, which does nothing while the loop is open."""
    settings = ControllerSettings(disturbance_frequencies=(30.0,), **WIDE)
    assert moved_by_another_b0(settings, 1.7, 0.0, enabled=False)[1] < 1e-9


@pytest.mark.parametrize('n', (2, 3, 5))
def test_poles_that_are_left_out_are_integrators(n: int) -> None:
    """One lag is one lag, whatever the order, and no known pole is a chain."""
    for few in ((-20.0,), (-20.0, -3.0), (0.0,)):
        every = few + (0.0,) * (n - len(few))
        assert design_of(plant_order=n, plant_poles=few) == design_of(
            plant_order=n, plant_poles=every
        )
        assert Requirements(order=n, plant_poles=few).poles == every
    assert design_of(plant_order=n, plant_poles=(-20.0,)).plant_poles.count(-20.0) == 1


def test_what_makes_no_sense_is_refused() -> None:
    for values, name in (
        ({'plant_poles': (-1.0, -2.0, -3.0)}, 'plant_poles'),
        ({'disturbance_frequencies': (1.0, 2.0, 3.0, 4.0)}, 'disturbance_frequencies'),
        ({'disturbance_frequencies': (2.0, 2.0)}, 'disturbance_frequencies'),
        ({'plant_poles': (-1.0, -2.0), 'measurement_period': 2.0 * pi}, 'plant_poles'),
    ):
        with pytest.raises(SettingError) as caught:
            ControllerSettings(**values)
        assert caught.value.name == name
        assert f'{name} = [' in str(caught.value)  # as it is written
    for poles in ((-1.0, 0.0), (-1.0,)):
        ControllerSettings(plant_poles=poles, measurement_period=2.0 * pi)
    fast = ControllerSettings(plant_poles=(-200.0, 0.0), disturbance_frequencies=(157.0, 0.0))
    fast.check_rate(100.0)
    with pytest.raises(SettingError, match='plant_poles'):
        attrs.evolve(fast, plant_poles=(-210.0,)).check_rate(100.0)
    with pytest.raises(SettingError, match='disturbance_frequencies'):
        attrs.evolve(fast, disturbance_frequencies=(158.0,)).check_rate(100.0)
