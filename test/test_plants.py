"""Plants keep the convention, integrate at order 4, and a wrong one is refused with a reason."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, exp, inf, isnan, log, nan, pi, sin, sqrt, tanh
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.simulation.integrate import (
    fastest_rate,
    Integrator,
    substeps_for,
)
from nadrc_ros.simulation.plants import PLANTS
from nadrc_ros.simulation.protocols import check_plant, Plant, total_disturbance
from nadrc_ros.simulation.signals import make_signal
import pytest

NOTHING = make_signal('none', {})


def slope(plant: Plant, t: float, x: list[float], u: float, w: float) -> list[float]:
    dx = [nan] * plant.states
    plant.derivative(t, x, u, w, dx)
    return dx


def unexplained(plant: Plant, b0: float, *at: Any) -> float:
    return total_disturbance(type(plant).derivative, plant, b0, *at)


def run(
    plant: Plant, x: list[float], u: float, end: float, steps: int, w: Any = NOTHING
) -> list[float]:
    integrator, out = Integrator(plant, w), [0.0] * plant.states
    for k in range(steps):
        assert integrator.advance(k * end / steps, x, u, end / steps, out)
        x, out = out, [0.0] * plant.states
    return x


@pytest.mark.parametrize('name', PLANTS)
def test_registered_plants_keep_the_convention(name: str) -> None:
    plant = build(PLANTS[name], {})
    assert check_plant(plant) is plant


@pytest.mark.parametrize('order', range(1, 6))
def test_a_chain_of_each_order(order: int) -> None:
    plant = check_plant(
        build(PLANTS['chain'], {'order': order, 'gain': -3.0, 'damping': 0.5, 'load': 2.0})
    )
    assert (plant.order, plant.states, plant.b0) == (order, order, -3.0)
    x = [1.0 + i for i in range(order)]
    assert slope(plant, 0.0, x, 0.7, 0.1)[-1] == pytest.approx(-0.5 * order - 2.1 - 2.0 + 0.1)


def test_the_plant_of_the_paper() -> None:
    plant = build(PLANTS['paper'], {})
    dx = slope(plant, 1.3, [0.4, -0.6], 2.0, 0.05)
    assert dx[0] == -0.6
    expected = 0.2 * 0.4 + 0.1 * sin(-0.6) + 0.05 + (1 + 0.2 * sin(1.3)) * 2.0
    assert dx[1] == pytest.approx(expected, rel=1e-15)
    assert (plant.order, plant.b0) == (2, 1.0)


def test_total_disturbance_is_what_b0_does_not_explain() -> None:
    plant, dx = build(PLANTS['paper'], {'a3': 0.0}), [0.0, 0.0]
    truth = unexplained(plant, 1.0, 0.0, [0.4, -0.6], 2.0, 0.05, dx)
    assert truth == pytest.approx(0.08 + 0.1 * sin(-0.6) + 0.05)
    wrong = unexplained(plant, 1.5, 0.0, [0.4, -0.6], 2.0, 0.05, dx)
    assert wrong == pytest.approx(truth - 1.0)
    chain = build(PLANTS['chain'], {'order': 3, 'load': 0.25})
    assert unexplained(chain, chain.b0, 0.0, [1.0] * 3, 9.0, 0.0, [0.0] * 3) == -0.25


def test_the_motor_reaches_its_steady_speed() -> None:
    motor = build(PLANTS['motor'], {'coulomb': 0.0, 'static': 0.0, 'viscous': 1e-4})
    speed, current = run(motor, [0.0, 0.0], 12.0, 1.0, 4000)
    assert current == pytest.approx(1e-4 * speed / 0.05, rel=1e-6)
    assert speed == pytest.approx(12.0 * 0.05 / (0.05**2 + 1.5 * 1e-4), rel=1e-6)


def test_the_motor_breaks_away_only_above_its_friction() -> None:
    motor = build(PLANTS['motor'], {})
    held = 5e-3 * 1.5 / 0.05
    assert run(motor, [0.0, 0.0], 0.5 * held, 0.5, 4000)[0] < 1.0
    assert run(motor, [0.0, 0.0], 6.0 * held, 0.5, 4000)[0] > 10.0


def test_the_torque_and_voltage_balance_of_the_motor() -> None:
    motor = build(PLANTS['motor'], {'load_torque': 0.02})
    for speed, current in ((3.0, 0.7), (-3.0, 0.7), (0.2, -1.0), (300.0, 2.0)):
        friction = (5e-3 + 3e-3 * exp(-((speed / 5.0) ** 2))) * tanh(speed) + 1e-5 * speed
        dx = slope(motor, 0.0, [speed, current], 4.0, 0.3)
        assert dx[0] == pytest.approx((0.05 * current - friction - 0.02) / 2e-5 + 0.3, rel=1e-12)
        assert dx[1] == pytest.approx((4.0 - 1.5 * current - 0.05 * speed) / 1.5e-3, rel=1e-12)


def test_w_is_an_acceleration_of_the_motor_and_the_inductance_is_unmodelled() -> None:
    for name, n in (('motor', 1), ('motor_position', 2)):
        motor, rest = build(PLANTS[name], {}), [0.0] * (n + 1)
        assert slope(motor, 0.0, rest, 0.0, 7.0)[n - 1] == 7.0
        assert slope(motor, 0.0, rest, 5.0, 0.0)[n - 1] == 0.0
        dx = [0.0] * (n + 1)
        settled = [*rest[:-1], 5.0 / 1.5]
        assert unexplained(motor, motor.b0, 0.0, settled, 5.0, 0.0, dx) == pytest.approx(
            0.0, abs=1e-9
        )


def test_both_motors_are_the_same_machine() -> None:
    speed = slope(build(PLANTS['motor'], {}), 0.0, [3.0, 0.7], 2.0, 0.3)
    angle = slope(build(PLANTS['motor_position'], {}), 0.0, [9.0, 3.0, 0.7], 2.0, 0.3)
    assert angle == [3.0, *speed]


def test_the_pendulum_hangs_at_zero_and_keeps_its_energy() -> None:
    pendulum = build(PLANTS['pendulum'], {'friction': 0.0, 'length': 1.0})
    assert slope(pendulum, 0.0, [0.0, 0.0], 0.0, 0.0) == [0.0, 0.0]
    small = run(pendulum, [1e-4, 0.0], 0.0, 2 * pi / sqrt(9.81), 1000)
    assert small == pytest.approx([1e-4, 0.0], abs=1e-9)
    angle, rate = run(pendulum, [2.0, 0.0], 0.0, 5.0, 5000)
    assert 0.5 * rate * rate - 9.81 * cos(angle) == pytest.approx(-9.81 * cos(2.0), abs=1e-8)


def test_the_oven_keeps_its_heat_balance() -> None:
    oven = build(PLANTS['thermal'], {})
    assert slope(oven, 0.0, [80.0, 150.0], 0.0, 0.0) == [0.0, -150.0 / 8.0]
    assert slope(oven, 0.0, [20.0, 0.0], 0.0, -0.3)[0] == -0.3
    full = run(oven, [20.0, 0.0], 100.0, 9000.0, 3000)
    assert full == pytest.approx([20.0 + 500.0 / 2.5, 500.0], rel=1e-6)
    assert unexplained(oven, oven.b0, 0.0, [20.0, 200.0], 40.0, 0.0, [0.0, 0.0]) == (
        pytest.approx(0.0, abs=1e-12)
    )


def test_every_coefficient_matters() -> None:
    for name, cls in PLANTS.items():
        base = build(PLANTS[name], {})
        x = [0.7 + 0.3 * i for i in range(base.states)]
        for field, declaration in declared(cls).items():
            if name == 'chain' and field == 'order':
                continue
            value = [-5.0, 0.0] if field == 'poles' else declaration.default * 1.5 or 0.1
            assert slope(build(PLANTS[name], {field: value}), 1.0, x, 1.0, 0.0) != slope(
                base, 1.0, x, 1.0, 0.0
            ), (name, field)


def test_unknown_names_and_bad_coefficients_are_refused() -> None:
    with pytest.raises(SettingError, match=r'plant = .rocket.*motor_position'):
        build(PLANTS['rocket'], {})
    with pytest.raises(SettingError, match='a4'):
        build(PLANTS['paper'], {'a4': 1.0})
    with pytest.raises(SettingError, match='gain = 0'):
        build(PLANTS['chain'], {'gain': 0.0})
    with pytest.raises(SettingError, match='order = 6'):
        build(PLANTS['chain'], {'order': 6})


class Lag:
    """A plant as a user would write it."""

    order = 2
    b0 = 2.0
    states = 2

    def derivative(self, t: float, x: Any, u: float, w: float, dx: Any) -> None:
        dx[0] = x[1]
        dx[1] = -x[1] + 2.0 * u + w

    def output(self, x: Any) -> float:
        return float(x[0])


@dataclass
class Tank:
    """The same as a dataclass, of order 1."""

    order: int = 1
    b0: float = 0.5
    states: int = 1
    outflow: float = 0.1

    def derivative(self, t: float, x: Any, u: float, w: float, dx: Any) -> None:
        dx[0] = self.b0 * u - self.outflow * x[0] + w

    def output(self, x: Any) -> float:
        return float(x[0])


def test_plants_of_ones_own() -> None:
    for plant in (Lag(), Tank()):
        checked = check_plant(plant)
        assert checked is plant
        assert substeps_for(checked, 0.01) == 1


def test_any_object_missing_everything_is_refused() -> None:
    with pytest.raises(SettingError, match=r'plant\.order'):
        check_plant(object())


def bad_order(self: Any, t: float, x: Any, u: float, w: float, dx: Any) -> None:
    dx[1] = x[0]
    dx[0] = u


def writes_input(self: Any, t: float, x: Any, u: float, w: float, dx: Any) -> None:
    dx[0] = x[1]
    dx[1] = u
    x[1] = 5.0


def forgets(self: Any, t: float, x: Any, u: float, w: float, dx: Any) -> None:
    dx[0] = x[1]


def grows(self: Any, t: float, x: Any, u: float, w: float, dx: Any) -> None:
    dx[0] = x[1]
    dx[1] = u
    dx.append(0.0)


def divides(self: Any, t: float, x: Any, u: float, w: float, dx: Any) -> None:
    dx[0] = x[1]
    dx[1] = u / x[0]


def old_style(self: Any, x: Any, u: float) -> list[float]:
    return [x[1], u]


@pytest.mark.parametrize(
    ('member', 'value', 'says'),
    [
        ('order', 0, r'plant\.order = 0: must be an integer from 1 to 5'),
        ('order', 6, r'plant\.order'),
        ('order', True, r'plant\.order'),
        ('order', 2.0, r'plant\.order'),
        ('states', 1, r'plant\.states = 1: must be an integer from 2 to'),
        ('states', None, r'plant\.states'),
        ('b0', 0.0, r'plant\.b0 = 0\.0: must be a finite number, not 0'),
        ('b0', inf, r'plant\.b0'),
        ('b0', 'one', r'plant\.b0'),
        ('derivative', 3, r'plant\.derivative = 3: must be a method'),
        ('derivative', bad_order, r'dx\[0\]'),
        ('derivative', writes_input, r'leaving its input'),
        ('derivative', forgets, r'2 finite numbers'),
        ('derivative', grows, r'2 finite numbers'),
        ('derivative', divides, r'any finite state'),
        ('derivative', old_style, r'\(t, x, u, w, dx\)'),
        ('output', None, r'plant\.output'),
        ('output', lambda self, x: x[1], r'plant\.output = .*must be x\[0\]'),
        ('output', lambda self: 1.0, r'plant\.output'),
    ],
)
def test_a_wrong_plant_is_refused_by_name(member: str, value: Any, says: str) -> None:
    with pytest.raises(SettingError, match=says):
        check_plant(type('Wrong', (Lag,), {member: value})())


def test_integration_converges_with_order_four() -> None:
    plant = build(PLANTS['paper'], {'a3': 0.9})
    w = make_signal('decaying_cosine', {'frequency': 3.0})
    exact = run(plant, [1.0, -0.5], 0.8, 2.0, 4096, w)
    sizes = [8, 16, 32, 64, 128]
    errors = [abs(run(plant, [1.0, -0.5], 0.8, 2.0, n, w)[1] - exact[1]) for n in sizes]
    logs = [(log(n), log(error)) for n, error in zip(sizes, errors, strict=True)]
    mean_n = sum(a for a, _ in logs) / len(logs)
    mean_e = sum(b for _, b in logs) / len(logs)
    fitted = sum((a - mean_n) * (b - mean_e) for a, b in logs)
    fitted /= sum((a - mean_n) ** 2 for a, _ in logs)
    assert -4.3 < fitted < -3.85, (fitted, errors)


def test_integration_against_a_closed_form() -> None:
    lag = build(PLANTS['chain'], {'order': 1, 'damping': 2.0, 'gain': 3.0})
    assert run(lag, [1.0], 0.5, 1.5, 300)[0] == pytest.approx(0.75 + 0.25 * exp(-3.0), rel=1e-9)
    chain = build(PLANTS['chain'], {'order': 3})
    x = run(chain, [1.0, 2.0, 3.0], 4.0, 0.5, 1)
    assert x == pytest.approx([1 + 1 + 3 / 8 + 4 / 48, 2 + 1.5 + 0.5, 5.0], rel=1e-15)


@given(st.sampled_from(sorted(PLANTS)), st.integers(1, 6), st.floats(-2, 2))
def test_substeps_equal_steps_and_the_input_is_left_alone(name: str, count: int, u: float) -> None:
    plant = build(PLANTS[name], {})
    x = [0.1 + 0.2 * i for i in range(plant.states)]
    w = make_signal('sine', {'frequency': 2.0})
    before, out = list(x), [nan] * plant.states
    assert Integrator(plant, w, substeps=count).advance(0.0, x, u, count * 1e-4, out)
    assert x == before
    assert out == pytest.approx(run(plant, x, u, count * 1e-4, count, w), rel=1e-12, abs=1e-15)


def test_the_motor_gets_the_substeps_it_needs() -> None:
    for name in ('motor', 'motor_position'):
        motor = build(PLANTS[name], {})
        rate = fastest_rate(motor)
        assert 700.0 < rate < 1600.0
        coarse, fine, out = [0.0] * motor.states, [0.0] * motor.states, [0.0] * motor.states
        one = Integrator(motor, NOTHING, substeps_for(motor, 0.01))
        other = Integrator(motor, NOTHING, 2000)
        for k in range(10):
            assert one.advance(0.01 * k, coarse, 6.0, 0.01, out)
            coarse, out = out, coarse
        for k in range(10):
            assert other.advance(0.01 * k, fine, 6.0, 0.01, out)
            fine, out = out, fine
        assert coarse == pytest.approx(fine, rel=1e-4)
    stiff = Integrator(build(PLANTS['motor'], {}), NOTHING, 1)
    x, out, finite = [0.0, 0.0], [0.0, 0.0], True
    for k in range(300):
        finite = finite and stiff.advance(0.01 * k, x, 6.0, 0.01, out)
        x, out = out, x
    assert not finite, 'one step per period should not be enough here'


def test_slow_plants_need_one_substep() -> None:
    assert fastest_rate(build(PLANTS['chain'], {'order': 5})) == 0.0
    assert fastest_rate(build(PLANTS['chain'], {'order': 3, 'damping': 7.0})) == pytest.approx(
        7.0, 0.1
    )
    for name in ('paper', 'pendulum', 'chain'):
        assert substeps_for(build(PLANTS[name], {}), 0.01) == 1
    assert substeps_for(build(PLANTS['chain'], {'damping': 50.0}), 0.01) == 2


@pytest.mark.parametrize('x', [[1e308, 1e308], [inf, 0.0], [nan, 0.0], [0.0, inf]])
def test_a_runaway_is_reported_and_never_raises(x: list[float]) -> None:
    for name in ('paper', 'pendulum', 'motor', 'chain'):
        out = [0.0, 0.0]
        assert not Integrator(build(PLANTS[name], {}), NOTHING).advance(0.0, x, 1e308, 1e6, out)
        assert all(map(isnan, out))
