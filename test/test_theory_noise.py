"""Noise variances against long runs of the observers and of the loop, and what nesting costs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import inf
from typing import Any

from law_helpers import design_of, Observer
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.simulation.compiled_law import address, compiled_law
from nadrc_ros.simulation.kernel import Running
from nadrc_ros.simulation.period import (
    COMMAND,
    FEED_FORWARD,
    FIRST_LEVEL,
    MEASUREMENT,
    SPAN,
)
from nadrc_ros.theory.delayed import command_variance, delayed_loop
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.model import disturbance_weights, residual
from nadrc_ros.theory.system import Array, pick, StateSpace, zero_order_hold
import numba
import numpy as np
from numpy.typing import ArrayLike
import pytest
from scipy import optimize
from theory_helpers import (
    LINEAR,
    nested_design,
    observer,
    output_covariance,
    response,
    WIDE,
)

H = 0.01
SAMPLES = 400_000


def estimate_covariance(design: Design, h: float = 0.0, variance: float = 1.0) -> Array:
    """
    Return the covariance (K N, K N) of the estimates' part that comes from measurement noise.

    The command moves plant and observers alike (for the right b0), so it holds in any loop.
    """
    system = observer(design, h)
    return output_covariance(pick(system, [1], range(len(system.c))), variance)


def disturbance_variance(design: Design, h: float = 0.0, variance: float = 1.0) -> float:
    """Return the variance of d_1 + ... + d_K; over S w^5 it is 3/16 for one level and n = 2."""
    row = disturbance_weights(design)
    return float(row @ estimate_covariance(design, h, variance) @ row)


def noise_factor(order: int, ratios: Sequence[float]) -> float:
    """
    Return Var(sum_k d_k) / (S w^(2n+1)) of levels at ratio_k w under white noise of intensity S.

    n = 2, equal ratios: 0.1875, 0.8027, 1.9472, 3.7632 for K = 1..4.
    """
    return disturbance_variance(nested_design(order, ratios))


def equal_noise_bandwidths(
    order: int, levels: int, ratios: Sequence[float] | None = None
) -> Array:
    """
    Return w_1..w_K over the w of a single level with the same variance of the summed estimate.

    ``ratios`` are the w_k relative to each other (default all equal). The variance goes with
    w^(2n+1), so the common factor is (noise of one / noise of K)^(1 / (2n+1)): 0.7476, 0.6262,
    0.5489 for K = 2, 3, 4 and n = 2.
    """
    shape = [1.0] * levels if ratios is None else list(ratios)
    if len(shape) != levels:
        raise ValueError(f'{levels} levels need {levels} ratios')
    quotient = noise_factor(order, [1.0]) / noise_factor(order, shape)
    return np.asarray(quotient ** (1.0 / (2 * order + 1)) * np.array(shape))


def residual_gain(order: int, bandwidths: Sequence[float], omega: ArrayLike) -> Array:
    """Return |prod_k (1 - G_k(j omega))|, G_k = (w_k / (s + w_k))^(n+1), of the nested levels."""
    s = 1j * np.asarray(omega, dtype=float)
    left = np.ones_like(s)
    for w in bandwidths:
        left = left * (1.0 - (w / (s + w)) ** (order + 1))
    return np.abs(left)


def crossover(order: int, bandwidths: Sequence[float]) -> float:
    """
    Return the frequency, over w_single, above which the levels leave more than one level would.

    ``bandwidths`` over w_single too, from :func:`equal_noise_bandwidths`: 0.2172, 0.1930, 0.1755
    for K = 2, 3, 4 and n = 2. inf if there is none below 100 w.
    """

    def worse(x: float) -> float:
        w = float(np.exp(x))
        pair = residual_gain(order, bandwidths, w), residual_gain(order, [1.0], w)
        return float(np.log(pair[0] / pair[1]))

    grid = np.linspace(np.log(1e-3), np.log(1e2), 600)
    for low, high in pairwise(grid):
        if worse(low) < 0.0 <= worse(high):
            return float(np.exp(optimize.brentq(worse, low, high, rtol=1e-12)))
    return inf


@pytest.fixture(scope='module')
def compiled() -> Any:
    """A chain of integrators around the functions of the law as they are compiled."""

    @numba.njit  # type: ignore[untyped-decorator, unused-ignore]
    def run(period: Any, law: Any, reference: Any, a: Any, b: Any, x: Any, given: Any) -> Any:
        design, state, out, told, gives = law
        noise, left, levels = given
        commands = np.zeros(len(noise))
        for k in range(len(noise)):
            told[MEASUREMENT], told[SPAN], told[FEED_FORWARD] = x[0] + noise[k], H, 0.0
            period(
                *(address(design), address(state), address(reference)),
                *(address(told), address(out), address(gives)),
            )
            state, out, told, gives = out, state, gives, told
            x = a @ x + b * told[COMMAND]
            commands[k] = told[COMMAND]
            left[k] = np.sum(told[FIRST_LEVEL : FIRST_LEVEL + levels])
        return commands

    return run


def simulate(run: Any, settings: ControllerSettings) -> tuple[Any, Any]:
    """Return the command and the summed estimate minus what the command explains of it."""
    controller = Controller(settings)
    for _ in range(10):  # it is in control then
        controller.tick(0.0, H, reference=[0.0])
    design, running = controller.design, Running(controller)
    plant = zero_order_hold(chain(design.order, design.b0), H)
    noise = np.random.default_rng(7).standard_normal(SAMPLES)
    given = noise, np.zeros(SAMPLES), design.levels
    period = compiled_law(design)['regular_period']
    b = plant.b[:, 0].copy()
    commands = run(period, running.parts, running.reference, plant.a, b, 0.0 * b, given)
    return commands[2000:], given[1][2000:]


@pytest.mark.parametrize('structure', LINEAR)
def test_variances_of_a_long_run_of_the_loop(structure: str, compiled: Any) -> None:
    """Of the summed estimate and of the command, both in closed loop, n = 2 and w h = 0.3, 0.2."""
    bandwidths: dict[str, Any] = {
        'inner_bandwidth': 30.0,
        'outer_bandwidth': 20.0,
        'controller_bandwidth': 5.0,
    }
    settings = ControllerSettings(**WIDE, structure=structure, **bandwidths)
    commands, disturbances = simulate(compiled, settings)
    design = make_design(settings)
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
