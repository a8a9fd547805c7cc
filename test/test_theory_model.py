"""The matrices of the theory are those of the law as it runs; what follows from them."""

from __future__ import annotations

from math import inf
from typing import Any

from law_helpers import design_of, NAMES, ORDERS, varied_settings
from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.model import (
    controller,
    law_matrices,
    observer_matrices,
    residual,
    total_disturbance,
)
from nadrc_ros.theory.norms import frequency_grid, l1_norm, peak
from nadrc_ros.theory.pid import equivalent_pid, FilteredPID
from nadrc_ros.theory.system import (
    Array,
    Complex,
    frequency_response,
    is_stable,
    natural_frequencies,
    pick,
    poles,
    StateSpace,
    zero_order_hold,
)
import numpy as np
import pytest
from test_observer import g
from theory_helpers import LINEAR, nested_design, observer, response, stepped, wide_design

H = 0.01
CASES = {
    **{f'{name}-{n}': {'structure': name, 'plant_order': n} for name in NAMES for n in ORDERS},
    **{
        name: {k: v for k, v in case.items() if k not in ('tracking_acceleration', 'b0_table')}
        for name, case in varied_settings().items()
    },
    'cascade-4': {'structure': 'cascade', 'levels': 4, 'feedback_level': 'outer'},
    'fast pole': {'plant_poles': (-400.0, -20.0), 'disturbance_frequencies': (33.0, 9.0)},
    'nested-6': {'levels': 6, 'bandwidth_ratio': 0.9},
}
FREQUENCIES = np.geomspace(0.01, 0.999 * np.pi / H, 200)


def case_design(case: dict[str, Any]) -> Design:
    free = {'command_min', 'command_max', 'command_rate_limit', 'safe_command'}
    return wide_design(**{key: value for key, value in case.items() if key not in free})


@pytest.mark.parametrize('h', (0.002, 0.01, 0.05))
@pytest.mark.parametrize('case', CASES)
def test_the_matrices_are_those_of_the_step(case: str, h: float) -> None:
    """In units of h^i, so that no entry hides behind a larger one."""
    design = case_design(CASES[case])
    states, commands = stepped(design, h)
    a, b_u, b_y = observer_matrices(design, h)
    f, reference = law_matrices(design, h)
    scale = np.concatenate([h ** np.arange(float(size)) for size in design.sizes])
    size, push = len(a), abs(design.b0) * h**design.order
    found, expected = states[:, :size], a
    close((found.T * scale).T / scale, (expected.T * scale).T / scale)
    close(scale * states[:, size] / push, scale * b_u / push)
    close(scale * states[:, size + 1], scale * b_y)
    if design.error_based:
        close(scale * states[:, size + 2], -scale * b_y)
    effort = float(np.abs(f / scale).max())
    close(commands[:size] / scale / effort, -f @ a / scale / effort)
    close(commands[size] / (push * effort), -f @ b_u / (push * effort))
    close(commands[size + 1] / effort, -f @ b_y / effort)
    if not design.error_based:
        close(commands[size + 2 :] / effort, reference / effort)
        assert not states[:, size + 2 :].any()


def close(found: Any, expected: Any) -> None:
    assert np.abs(np.asarray(found) - np.asarray(expected)).max() < 1e-12


@pytest.mark.parametrize('levels', (1, 2, 3, 4))
@pytest.mark.parametrize('n', (1, 2, 3))
def test_the_response_of_the_step_is_the_product_of_one_minus_g(n: int, levels: int) -> None:
    """Of the step as it runs: its matrices come from unit vectors, the product from paper."""
    design = wide_design(
        plant_order=n, levels=levels, inner_bandwidth=40.0, outer_bandwidth=25.0, b0=2.0
    )
    states, _ = stepped(design, H)
    size = levels * design.states
    disturbance = np.zeros((1, size))
    disturbance[0, n :: design.states] = 1.0
    run = StateSpace(states[:, :size], -states[:, [size]] / 2.0, -disturbance, np.ones((1, 1)), H)
    left = response(run, FREQUENCIES)[:, 0, 0]
    z = np.exp(1j * FREQUENCIES * H)
    product = np.prod([[1.0 - g(p, n, w, H) for p in z] for w in design.bandwidths], axis=0)
    assert np.abs(left - product).max() < 1e-9
    assert np.abs(response(residual(design, H), FREQUENCIES)[:, 0, 0] - product).max() < 1e-9


@pytest.mark.parametrize('n', ORDERS)
def test_the_continuous_residuals(n: int) -> None:
    w1, w2, omega = 30.0, 12.0, np.geomspace(0.1, 1e4, 100)
    values = {'plant_order': n, 'inner_bandwidth': w1, 'outer_bandwidth': w2}
    g1, g2 = ((w / (1j * omega + w)) ** (n + 1) for w in (w1, w2))
    expected = {
        'conventional': 1 - g1,
        'nested': (1 - g1) * (1 - g2),
        'printed': (1 - g1) / (1 + g2),
    }
    for name, left in expected.items():
        found = response(residual(design_of(structure=name, **values)), omega)[:, 0, 0]
        assert np.abs(found - left).max() < 1e-9
        inner = response(residual(design_of(structure=name, **values), levels=1), omega)
        assert np.abs(inner[:, 0, 0] - (1 - g1)).max() < 1e-9


@pytest.mark.parametrize('structure', NAMES)
@pytest.mark.parametrize('n', (1, 2, 3))
def test_discrete_tends_to_continuous(n: int, structure: str) -> None:
    """The held estimate of a short period differs by about w h."""
    design, omega = design_of(structure=structure, plant_order=n), np.geomspace(1.0, 200.0, 20)
    for make in (residual, total_disturbance):
        near, far = (
            np.abs(response(make(design, h), omega) - response(make(design), omega)).max()
            for h in (1e-4, 1e-3)
        )
        assert near < 0.15 * far < 0.15
    omega, pairs = np.geomspace(1.0, 40.0, 20), []
    for h in (1e-4, 1e-3):
        discrete = response(controller(design, h), omega)[:, 0, 0]
        continuous = response(controller(design), omega)[:, 0, 0]
        pairs.append(np.abs(discrete / continuous - 1.0).max())
    assert pairs[0] < 0.15 * pairs[1] < 0.15


@pytest.mark.parametrize('h', (0.0, H))
@pytest.mark.parametrize('structure', NAMES)
def test_every_structure_estimates_a_constant_and_integrates(structure: str, h: float) -> None:
    design = design_of(structure=structure, plant_order=2, levels=3)
    assert is_stable(observer(design, h))
    assert response(total_disturbance(design, h), 0.0).real == pytest.approx(
        np.ones((1, 1)), abs=1e-9
    )
    assert response(residual(design, h), 0.0).real == pytest.approx(np.zeros((1, 1)), abs=1e-9)
    edge = 1.0 if h > 0.0 else 0.0
    assert np.abs(poles(controller(design, h)) - edge).min() < 1e-3


def test_discrete_poles_are_where_they_were_asked_for() -> None:
    design = design_of(pole_ratios=(0.5, 1.0, 2.0), inner_bandwidth=20.0, outer_bandwidth=8.0)
    asked = np.exp(-np.array([4.0, 8.0, 10.0, 16.0, 20.0, 40.0]) * H)
    assert np.sort(poles(observer(design, H)).real)[::-1] == pytest.approx(asked, abs=1e-9)
    assert np.sort(-poles(observer(design)).real) == pytest.approx([4, 8, 10, 16, 20, 40])


def test_a_triple_pole_is_found_in_proportion_to_the_period() -> None:
    """Rounding moves it by (1e-16)^(1/3) of w h, not of 1; all entries are exact."""
    wh = 2.0**-20
    slope = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -3.0, -3.0]])  # (s + 1)^3
    nothing = np.zeros((0, 0))
    found = poles(StateSpace(np.eye(3) + wh * slope, nothing, nothing, nothing, h=1e-3))
    assert np.abs((found - 1.0) / wh + 1.0).max() < 1e-4


def test_the_frequency_of_a_sampled_pole_is_that_of_its_logarithm() -> None:
    """One at -1 turns by half a circle each period; one at 0 is as fast as a number can tell."""
    nothing = np.zeros((0, 0))
    sampled = StateSpace(np.diag([-1.0, np.exp(-1.0), 0.0]), nothing, nothing, nothing, h=0.1)
    half, slow, fast = np.sort(natural_frequencies(sampled))[[1, 0, 2]]
    assert (half, slow) == pytest.approx((10.0 * np.pi, 10.0))
    assert 1e3 < fast < inf


def h_infinity_norm(system: StateSpace) -> float:
    """
    Return the largest singular value of the response over all frequencies; inf when unstable.

    Found on a logarithmic grid around the poles.
    """
    if not is_stable(system):
        return inf
    best = peak(frequency_response(system), frequency_grid(system))
    return max(best, float(np.linalg.norm(system.d, 2))) if system.h == 0.0 else best


@pytest.mark.parametrize(('levels', 'norm'), ((1, 1.0), (2, 1.457), (3, 2.100), (4, 2.882)))
def test_h_infinity_norms(levels: int, norm: float) -> None:
    """Margin of an input gain error: 1.00, 0.686, 0.476, 0.347."""
    design = nested_design(2, [30.0] * levels)
    assert h_infinity_norm(total_disturbance(design)) == pytest.approx(norm, abs=5e-4)
    assert h_infinity_norm(total_disturbance(design, 1e-4)) == pytest.approx(norm, rel=1e-2)


def test_norms_of_what_is_known() -> None:
    def resonance(zeta: float) -> StateSpace:
        a = np.array([[0.0, 1.0], [-25.0, -10.0 * zeta]])
        return StateSpace(a, np.array([[0.0], [25.0]]), np.eye(2)[:1], np.zeros((1, 1)))

    for zeta in (0.3, 0.01):
        peak = 1.0 / (2.0 * zeta * np.sqrt(1.0 - zeta**2))
        assert h_infinity_norm(resonance(zeta)) == pytest.approx(peak, rel=1e-8)
        one = resonance(zeta)
        two = one._replace(c=np.vstack([one.c, 2.0 * one.c]), d=np.vstack([one.d, 2.0 * one.d]))
        assert h_infinity_norm(two) == pytest.approx(5.0**0.5 * peak, rel=1e-8)
    overshoot = np.exp(-np.pi * 0.3 / np.sqrt(1 - 0.09))
    area = (1 + overshoot) / (1 - overshoot)  # of |impulse|: half-waves in geometric progression
    assert l1_norm(resonance(0.3)) == pytest.approx([area], rel=1e-3)
    sampled = zero_order_hold(resonance(0.3), 0.01)
    assert h_infinity_norm(sampled) == pytest.approx(h_infinity_norm(resonance(0.3)), rel=1e-3)
    assert l1_norm(sampled) == pytest.approx([area], rel=1e-3)
    unstable = resonance(-0.1)
    assert h_infinity_norm(unstable) == l1_norm(unstable)[0] == np.inf
    assert h_infinity_norm(zero_order_hold(unstable, 0.01)) == np.inf
    with pytest.raises(ValueError):
        l1_norm(observer(design_of()))


@pytest.mark.parametrize('delay', (0.0, 0.013, 0.02, 0.005))
def test_sampling_with_a_delay(delay: float) -> None:
    """Against exp(-s delay) times the response, far below the sampling frequency."""
    a = np.array([[0.0, 1.0], [-4.0, -1.0]])
    plant = StateSpace(a, np.array([[0.0], [1.0]]), np.eye(2)[:1], np.zeros((1, 1)))
    omega = np.array([0.1, 1.0, 2.0])
    held = response(zero_order_hold(plant, H, delay), omega)[:, 0, 0]
    expected = response(plant, omega)[:, 0, 0] * np.exp(-1j * omega * (delay + H / 2))
    assert np.abs(held / expected - 1.0).max() < 1e-4
    with pytest.raises(ValueError):
        zero_order_hold(plant, H, -0.1)
    with pytest.raises(ValueError):
        zero_order_hold(zero_order_hold(plant, H), H)


@pytest.mark.parametrize('delay', (0.0, 0.013, 0.07))
def test_of_several_inputs_each_is_delayed_as_it_were_alone(delay: float) -> None:
    a, b = np.array([[0.0, 1.0], [-4.0, -1.0]]), np.array([[0.0, 0.3], [1.0, -2.0]])
    c, omega = np.eye(2), np.array([0.1, 1.0, 20.0])
    both = response(zero_order_hold(StateSpace(a, b, c, np.zeros((2, 2))), H, delay), omega)
    for i in range(2):
        alone = StateSpace(a, b[:, i : i + 1], c, np.zeros((2, 1)))
        np.testing.assert_allclose(
            both[..., i : i + 1], response(zero_order_hold(alone, H, delay), omega), rtol=1e-9
        )


def feedback_response(pid: FilteredPID, omega: Array) -> Complex:
    """Return K(j omega)."""
    s = 1j * omega
    return np.asarray((pid.kp + pid.ki / s + pid.kd * s) / (1.0 + pid.t1 * s + pid.t2 * s * s))


def reference_response(pid: FilteredPID, omega: Array) -> Complex:
    """Return u / r at j omega."""
    s = 1j * omega
    return np.asarray(
        np.polyval(pid.setpoint[::-1], s) / (s * (1.0 + pid.t1 * s + pid.t2 * s * s))
    )


@pytest.mark.parametrize(
    'values', ({}, {'pole_ratios': True}, {'b0': -3.0, 'observer_gain_factor': 0.5})
)
@pytest.mark.parametrize('n', (1, 2))
def test_one_leso_is_a_filtered_pid(n: int, values: dict[str, Any]) -> None:
    if 'pole_ratios' in values:
        values = {'pole_ratios': (0.6, 1.0, 1.7)[: n + 1]}
    design = design_of(structure='conventional', plant_order=n, **values)
    pid, omega = equivalent_pid(design), np.geomspace(1e-2, 1e4, 60)
    full = response(controller(design), omega)[:, 0]
    assert np.abs(-full[:, 0] / feedback_response(pid, omega) - 1.0).max() < 1e-9
    assert np.abs(full[:, 1] / reference_response(pid, omega) - 1.0).max() < 1e-9
    f = -full[:, 1] / full[:, 0]
    assert f == pytest.approx(reference_response(pid, omega) / feedback_response(pid, omega))
    assert (pid.kd == pid.t2 == 0.0) == (n == 1)
    assert abs(f[0] - 1.0) < 1e-2  # r and y weigh the same at rest


def test_pi_gains_of_an_example() -> None:
    """n = 1, b0 = 2, wc = 3, w = 10: b1 = 20, b2 = 100, D = s + 23."""
    design = design_of(
        structure='conventional',
        plant_order=1,
        b0=2.0,
        controller_bandwidth=3.0,
        inner_bandwidth=10.0,
    )
    pid = equivalent_pid(design)
    assert (pid.kp, pid.ki, pid.t1) == pytest.approx((160 / 46, 300 / 46, 1 / 23))


@pytest.mark.parametrize(
    'values',
    (
        {'structure': 'nested'},
        {'structure': 'generalized'},
        {'structure': 'conventional', 'plant_order': 3},
        {'structure': 'conventional', 'feedback': 'fal'},
        {'structure': 'conventional', 'error_based': True},
    ),
)
def test_the_others_are_no_pid(values: dict[str, Any]) -> None:
    with pytest.raises(ValueError):
        equivalent_pid(design_of(**values))


def test_a_level_alone_of_any_kind_is_the_same_pid() -> None:
    """Nested and cascade with one level, generalized with one extended state."""
    one = [{'structure': name, 'levels': 1, 'extended_states': 1} for name in LINEAR]
    found: list[Array] = [
        np.array(equivalent_pid(design_of(**values))[:5])
        for values in one
        if design_of(**values).levels == 1
    ]
    assert all((gains == found[0]).all() for gains in found)


def test_picking_a_part() -> None:
    system = controller(design_of(), H)
    part = pick(system, [1], [0])
    assert response(part, 3.0)[0, 0] == pytest.approx(response(system, 3.0)[0, 1])
