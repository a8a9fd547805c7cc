"""Noise variances against long runs of the observers and of the loop, and what nesting costs."""

from __future__ import annotations

from typing import Any

from law_helpers import design_of, Observer
from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.adrc.supervisor import PolicyState
from nadrc_ros.adrc.tick import tick
from nadrc_ros.simulation.compiled import share_law
from nadrc_ros.simulation.kernel import tuple_of
from nadrc_ros.theory.delayed import command_variance, delayed_loop
from nadrc_ros.theory.equal_noise import (
    crossover,
    equal_noise_bandwidths,
    nested_design,
    noise_factor,
    residual_gain,
)
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.noise import (
    disturbance_variance,
    estimate_covariance,
    output_covariance,
)
from nadrc_ros.theory.system import response, StateSpace, zero_order_hold
from nadrc_ros.theory.transfer import residual
import numba
import numpy as np
import pytest
from theory_helpers import LINEAR, wide_design

H = 0.01
SAMPLES = 1_000_000


@pytest.fixture(scope='module')
def compiled() -> Any:
    """The functions of the law as they are, compiled, around a chain of integrators."""
    share_law()

    @numba.njit  # type: ignore[untyped-decorator, unused-ignore]
    def run(
        design: Any, state: Any, out: Any, policy: Any, a: Any, b: Any, noise: Any, left: Any
    ) -> Any:
        x, u, h = np.zeros(len(b)), 0.0, 0.01
        reference: Any = np.zeros(design.order + 1)
        commands = np.zeros(len(noise))
        for k in range(len(noise)):
            y = x[0] + noise[k]
            sample = Sample(y, h, h, 0.0, u)
            u, _, policy = tick(design, state, policy, sample, reference, True, True, out)
            state, out = out, state
            x = a @ x + b * u
            commands[k] = u
            total = 0.0
            for level in state.levels:
                total += level[design.order]
            left[k] = total
        return commands

    return run


def simulate(run: Any, design: Design) -> tuple[Any, Any]:
    """Return the command and the summed estimate minus what the command explains of it."""
    plant = zero_order_hold(chain(design.order, design.b0), H)
    noise = np.random.default_rng(7).standard_normal(SAMPLES)
    state, out = (tuple_of(blank_state(design)) for _ in range(2))
    disturbances = np.zeros(SAMPLES)
    b = plant.b[:, 0].copy()
    commands = run(tuple_of(design), state, out, PolicyState(), plant.a, b, noise, disturbances)
    return commands[2000:], disturbances[2000:]


@pytest.mark.parametrize('structure', LINEAR)
def test_variances_of_a_long_run_of_the_loop(structure: str, compiled: Any) -> None:
    """Of the summed estimate and of the command, both in closed loop, n = 2 and w h = 0.3, 0.2."""
    design = wide_design(
        structure=structure, inner_bandwidth=30.0, outer_bandwidth=20.0, controller_bandwidth=5.0
    )
    commands, disturbances = simulate(compiled, design)
    predicted = command_variance(delayed_loop(design, chain(design.order, design.b0), H))
    assert np.var(commands) == pytest.approx(predicted, rel=0.03)
    assert np.var(disturbances) == pytest.approx(disturbance_variance(design, H), rel=0.03)


def test_the_impulse_response_gives_the_same_covariance() -> None:
    design = design_of(levels=3, pole_ratios=(0.7, 1.0, 1.6))
    run, found = Observer(design), np.zeros((9, 9))
    for k in range(3000):
        run.update(1.0 if k == 0 else 0.0, 0.0, H)
        x = np.concatenate([np.array(level) for level in run.levels])
        found += np.outer(x, x)
    scale = np.sqrt(np.diag(found))
    expected = estimate_covariance(design, H)
    assert np.abs((found - expected) / np.outer(scale, scale)).max() < 1e-9


@pytest.mark.parametrize(
    ('levels', 'factor'), ((1, 0.1875), (2, 0.8027), (3, 1.9472), (4, 3.7632))
)
def test_noise_factors(levels: int, factor: float) -> None:
    assert noise_factor(2, [1.0] * levels) == pytest.approx(factor, abs=5e-5)
    design, h = nested_design(2, [20.0] * levels), 1e-4
    sampled = disturbance_variance(design, h) / (h * 20.0**5)
    assert sampled == pytest.approx(factor, rel=0.02)


@pytest.mark.parametrize(
    ('levels', 'shrink', 'left', 'above'),
    (
        (1, 1.0, 0.1495, np.inf),
        (2, 0.7476, 0.0398, 0.2172),
        (3, 0.6262, 0.0134, 0.1930),
        (4, 0.5489, 0.0053, 0.1755),
    ),
)
def test_nesting_at_equal_noise(levels: int, shrink: float, left: float, above: float) -> None:
    found = equal_noise_bandwidths(2, levels)
    assert found == pytest.approx([shrink] * levels, abs=5e-5)
    assert residual_gain(2, list(found), 0.05) == pytest.approx(left, abs=5e-5)
    assert crossover(2, list(found)) == pytest.approx(above, abs=5e-5)
    w = 30.0
    design = nested_design(2, list(w * found))
    gain = response(residual(design), 0.05 * w)
    assert abs(gain[0, 0]) == pytest.approx(left, abs=5e-5)


@pytest.mark.parametrize('n', (1, 2, 3, 4))
def test_equal_noise_is_equal(n: int) -> None:
    for ratios in ((1.0, 1.0), (1.0, 0.5), (1.0, 0.5, 0.25)):
        found = equal_noise_bandwidths(n, len(ratios), ratios)
        assert found / found[0] == pytest.approx(ratios)
        assert noise_factor(n, list(found)) == pytest.approx(noise_factor(n, [1.0]), rel=1e-9)
        above = crossover(n, list(found))
        for omega, better in ((0.9 * above, True), (1.1 * above, False)):
            pair = residual_gain(n, list(found), omega), residual_gain(n, [1.0], omega)
            assert (pair[0] < pair[1]) == better
    with pytest.raises(ValueError):
        equal_noise_bandwidths(n, 2, (1.0,))


def test_covariances_of_what_is_known() -> None:
    one = np.ones((1, 1))
    lag = StateSpace(-2.0 * one, one, one, 0.0 * one)
    assert output_covariance(lag, 3.0) == pytest.approx(3.0 / 4.0 * one)
    average = StateSpace(0.5 * one, one, 2.0 * one, 3.0 * one, H)
    assert output_covariance(average) == pytest.approx((4.0 / 0.75 + 9.0) * one)
    assert output_covariance(lag._replace(a=one)) == np.inf
    with pytest.raises(ValueError):
        output_covariance(lag._replace(d=one))
    assert command_variance(delayed_loop(design_of(), chain(2, 30.0), H)) == np.inf
