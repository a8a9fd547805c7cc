"""Theorem 1 and Corollary 1, as printed and sharp, against the observers as they run."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
import random

from law_helpers import Chain, design_of, Observer, ORDERS
from nadrc_ros.adrc.design import Design
from nadrc_ros.theory import bounds
from nadrc_ros.theory.bounds import coefficients, lyapunov, scaled_error_matrix
from nadrc_ros.theory.model import residual, total_disturbance
from nadrc_ros.theory.norms import l1_norm
from nadrc_ros.theory.system import Array, held, StateSpace
import numpy as np
import pytest
from theory_helpers import response

FACTORS = {1: 19.8995, 2: 191.4046032931, 3: 1964.76}
RATIOS = (0.5, 1.0, 2.0)


def test_the_lyapunov_function_of_order_two() -> None:
    found = lyapunov(2)
    p = [[1.0, -0.5, -1.0], [-0.5, 1.0, -0.5], [-1.0, -0.5, 4.0]]
    assert np.abs(found.p - p).max() < 1e-12
    assert scaled_error_matrix(2).tolist() == [[-3, 1, 0], [-3, 0, 1], [-1, 0, 0]]
    eigenvalues = [0.1965639455, 1.466199, 4.337236679]
    assert np.linalg.eigvalsh(found.p) == pytest.approx(eigenvalues, rel=1e-6)
    assert (found.smallest, found.largest) == pytest.approx(eigenvalues[::2], rel=1e-9)


@pytest.mark.parametrize('n', ORDERS)
def test_the_lyapunov_equation(n: int) -> None:
    rng = np.random.default_rng(n)
    for a in (None, np.poly(-rng.uniform(0.5, 2.0, n + 1))[1:].tolist()):
        found, matrix = lyapunov(n, a), scaled_error_matrix(n, a)
        rest = matrix.T @ found.p + found.p @ matrix + np.eye(n + 1)
        assert np.abs(rest).max() < 1e-9 * found.largest
        assert found.smallest > 0.0
        assert found.factor == 2.0 * found.largest**2 / found.smallest
    if n in FACTORS:
        assert lyapunov(n).factor == pytest.approx(FACTORS[n], rel=3e-6)
    assert lyapunov(2).factor == pytest.approx(FACTORS[2], rel=1e-9)


def test_constants_that_are_no_observer_are_refused() -> None:
    with pytest.raises(ValueError):
        lyapunov(2, (1.0, 1.0, 2.0))
    with pytest.raises(ValueError):
        coefficients(2, (1.0, 1.0))


@pytest.mark.parametrize('n', ORDERS)
def test_the_sharp_bounds_are_binomial(n: int) -> None:
    w, rate = 7.0, 3.0
    expected = [comb(n + 1, i - 1) * rate / w ** (n + 2 - i) for i in range(1, n + 2)]
    assert bounds.sharp(n, w, rate) == pytest.approx(expected, rel=1e-4)
    loose = bounds.theorem_1(n, w, rate) / bounds.sharp(n, w, rate)
    assert loose.min() > 5.0
    if n == 2:
        assert loose == pytest.approx([191.4, 63.8, 63.8], rel=1e-3)


def test_sharp_bounds_of_oscillating_poles_exceed_the_static_gain() -> None:
    a = np.poly([-1.0, -0.2 + 2.0j, -0.2 - 2.0j])[1:].real.tolist()
    static = np.linalg.solve(-scaled_error_matrix(2, a), [0.0, 0.0, 1.0])
    assert (bounds.sharp(2, 1.0, 1.0, a) > 1.05 * np.abs(static)).all()


def test_the_derivative_of_the_error_can_be_twice_that_of_the_disturbance() -> None:
    """Lemma 2 says at most once."""
    for n in ORDERS:
        assert bounds.error_rate(n) == pytest.approx(2.0, rel=1e-4)
    for frequency, holds in ((0.99, True), (1.01, False)):  # a sinusoid: iff below w/sqrt(6)
        left = response(residual(design_of(inner_bandwidth=1.0), levels=1), frequency / 6**0.5)
        assert (abs(left[0, 0]) <= 1.0) == holds


def theorem_1_transient(
    t: float,
    order: int,
    bandwidth: float,
    rate: float,
    error: Sequence[float],
    a: Sequence[float] | None = None,
) -> Array:
    """
    Return the bound on |e_i(t)|, shape (n+1,), from the initial error e(0) = ``error`` (n+1,).

    Eq. (14) taken back to e_i by (9). Eq. (14) is in the scaled time w t, so the exponent is
    -w t / (2 lmax); after (14), and in Corollary 1, the paper prints -t / (2 lmax).
    """
    found = lyapunov(order, a)
    scale = bandwidth ** np.arange(order, -1.0, -1.0)
    eta = scale * np.asarray(error, dtype=float)
    decay = np.exp(-bandwidth * t / (2.0 * found.largest))
    start = np.sqrt(eta @ found.p @ eta / found.smallest)
    return np.asarray((rate / bandwidth * found.factor * (1.0 - decay) + start * decay) / scale)


@pytest.mark.parametrize('n', (1, 2, 3))
def test_the_transient_bound_holds_and_ends_in_the_limit(n: int) -> None:
    w, rate = 8.0, 2.0
    error = [0.3 * (-4.0) ** i for i in range(n + 1)]
    a = scaled_error_matrix(n)
    powers = w ** np.arange(n, -1.0, -1.0)
    matrix = w * np.diag(1.0 / powers) @ a @ np.diag(powers)
    e, dt = np.array(error), 0.01
    transition, push = held(
        StateSpace(matrix, np.eye(n + 1)[:, -1:], np.eye(n + 1), np.zeros((n + 1, 1))), dt
    )
    for k in range(400):
        bound = theorem_1_transient(k * dt, n, w, rate, error)
        assert (np.abs(e) <= bound).all()
        e = transition @ e + push[:, 0] * rate * (1.0 if k % 160 < 80 else -1.0)
    assert theorem_1_transient(1e4, n, w, rate, error) == pytest.approx(
        bounds.theorem_1(n, w, rate)
    )
    start = theorem_1_transient(0.0, n, w, rate, [0.0] * (n + 1))
    assert start == pytest.approx(np.zeros(n + 1))


@pytest.mark.parametrize('n', (1, 2, 3))
def test_the_exponent_of_the_transient_bound_is_the_slowest_decay_of_v(n: int) -> None:
    """Along the eigenvector of lmax, -V/lmax is dV/dt; a printed exponent is w times too slow."""
    w, t = 8.0, 1e-5
    found = lyapunov(n)
    eta = np.linalg.eigh(found.p)[1][:, -1]
    error = (eta / w ** np.arange(n, -1.0, -1.0)).tolist()
    first, later = (theorem_1_transient(at, n, w, 0.0, error) for at in (0.0, t))
    a = scaled_error_matrix(n)
    slope = eta @ found.p @ a @ eta / (eta @ found.p @ eta)  # of log sqrt(V), in the time w t
    assert np.log(later / first) / (w * t) == pytest.approx([slope] * (n + 1), rel=1e-3)
    assert slope == pytest.approx(-0.5 / found.largest)


def errors(design: Design, rates: list[float], h: float) -> Array:
    """Return L - sum_k d_k at each tick, (ticks,); L has the given rate over each period."""
    n = design.order
    observer, chain, found = Observer(design), Chain(n + 1), []
    for rate in rates:
        observer.update(chain.y, 0.0, h)
        found.append(chain.x[n] - observer.disturbance())
        chain.advance(rate, h)
    return np.array(found)


def random_rates(rng: random.Random, count: int, period: float) -> list[float]:
    """Between -1 and 1, piecewise constant at the ends of it or in between."""
    rates: list[float] = []
    while len(rates) < count:
        value = rng.choice((-1.0, 1.0, rng.uniform(-1.0, 1.0)))
        rates += [value] * (1 + int(rng.expovariate(1.0 / period)))
    return rates[:count]


@pytest.mark.parametrize('seed', range(12))
def test_no_disturbance_error_exceeds_the_sharp_bound(seed: int) -> None:
    rng = random.Random(seed)
    n, w = 1 + seed % 3, 10.0 ** rng.uniform(0.0, 2.5)
    h = rng.uniform(0.02, 0.2) / w
    rate = 10.0 ** rng.uniform(-2.0, 2.0)
    design = design_of(structure='conventional', plant_order=n, inner_bandwidth=w)
    rates = [rate * r for r in random_rates(rng, 3000, rng.choice((0.3, 2.0, 10.0)) / (w * h))]
    worst = np.abs(errors(design, rates, h)).max()
    bound = bounds.sharp(n, w, rate)[n]
    assert 0.3 * bound < worst <= 1.02 * bound
    assert worst < bounds.theorem_1(n, w, rate)[n]


@pytest.mark.parametrize('seed', range(12))
def test_a_ramp_reaches_the_sharp_bound(seed: int) -> None:
    rng = random.Random(seed)
    n, w = 1 + seed % 3, 10.0 ** rng.uniform(0.0, 2.5)
    wh = 0.2 if seed < 3 else rng.uniform(0.02, 0.2)
    design = design_of(structure='conventional', plant_order=n, inner_bandwidth=w)
    final = errors(design, [1.0] * int(40 / wh), wh / w)[-1]
    assert final == pytest.approx(bounds.sharp(n, w, 1.0)[n], rel=0.05)


def worst_rates(design: Design, h: float, ticks: int) -> list[float]:
    """The rate that drives the residual furthest: the sign of Delta -> residual, backwards."""
    left = residual(design)
    state = -np.linalg.solve(left.a, left.b)[:, 0]
    transition, _ = held(left, h)
    signs = []
    state = held(left, h / 2.0)[0] @ state
    for _ in range(ticks):
        signs.append(float(np.sign(-(left.c[0] @ state))))
        state = transition @ state
    return signs[::-1]


@pytest.mark.parametrize('structure', ('conventional', 'nested', 'printed', 'generalized'))
def test_the_sharp_bound_of_what_all_levels_leave_is_reached(structure: str) -> None:
    w, wh = 20.0, 0.05
    design = design_of(structure=structure, levels=2, inner_bandwidth=w, outer_bandwidth=w)
    rates = worst_rates(design, wh / w, int(40 / wh))
    bound = bounds.residuals(design)[-1]
    error = errors(design, [*rates, 0.0], wh / w)[-1]
    assert abs(error) == pytest.approx(bound, rel=0.03)
    for seed in range(5):
        rates = random_rates(random.Random(seed), 2000, 2.0 / wh)
        assert np.abs(errors(design, rates, wh / w)).max() < bound + 0.5 * wh / w


def test_nesting_lowers_no_worst_case() -> None:
    """Zero for a ramp, but a rate that turns at the worst moment leaves more than one level."""
    design = design_of(levels=4, inner_bandwidth=1.0, outer_bandwidth=1.0, bandwidth_ratio=1.0)
    found = bounds.residuals(design)
    assert found == pytest.approx([3.0, 3.4264, 4.1864, 5.2832], rel=1e-3)
    printed = design_of(structure='printed', inner_bandwidth=1.0, outer_bandwidth=1.0)
    assert 1.5 < bounds.residuals(printed)[1] < 3.0
    one = design_of(structure='conventional')
    assert l1_norm(total_disturbance(one)) == pytest.approx([1.0], rel=1e-4)


def test_corollary_1_holds_for_nested_and_not_for_printed() -> None:
    """Under a ramp M' = 0: the corollary promises zero, and printed keeps half of e_3."""
    for structure, share in (('nested', 0.0), ('printed', 0.5)):
        for outer in (20.0, 80.0):
            design = design_of(structure=structure, inner_bandwidth=20.0, outer_bandwidth=outer)
            h, observer, chain = 0.002, Observer(design), Chain(2)
            for k in range(3000):
                chain.advance(k * h, h)
                observer.update(chain.y, 0.0, h)
            inner = 3000 * h - observer.levels[0][2]
            left = 3000 * h - observer.disturbance()
            assert left / inner == pytest.approx(share, abs=1e-4)
