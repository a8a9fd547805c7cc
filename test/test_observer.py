"""What each structure of observers does to a disturbance."""

from __future__ import annotations

from cmath import exp as cexp
from math import cos, exp

from law_helpers import Chain, design_of, NAMES, noise, Observer, ORDERS, varied_settings
from nadrc_ros.adrc.design import Design
import pytest

H = 0.01


def follow(design: Design, slope: float, ticks: int, u: float = 0.0, h: float = H) -> Observer:
    """Observe a chain under a disturbance slope t_k held over each period; exact."""
    observer, chain = Observer(design), Chain(design.order)
    for k in range(ticks):
        chain.advance(design.b0 * u + slope * k * h, h)
        observer.update(chain.y, u, h)
    return observer


def ramp_error(design: Design, slope: float = 2.0, ticks: int = 600, h: float = H) -> float:
    """Return L - sum d_k at t_k, with L of the period that starts there."""
    return slope * ticks * h - follow(design, slope, ticks, h=h).disturbance()


def ramp_design(structure: str, n: int = 2, w: float = 10.0, **values: object) -> Design:
    values = {'inner_bandwidth': w, 'outer_bandwidth': w} | values
    return design_of(structure=structure, plant_order=n, **values)


@pytest.mark.parametrize('wh', (0.01, 0.05, 0.1))
def test_conventional_lags_a_ramp_by_three_slopes_over_w(wh: float) -> None:
    w = wh / H
    error = ramp_error(ramp_design('conventional', w=w), ticks=int(60 / wh))
    assert error == pytest.approx(3 * 2.0 / w, rel=2e-3)


@pytest.mark.parametrize('n', ORDERS)
def test_the_lag_for_any_order(n: int) -> None:
    w = 2.0
    error = ramp_error(ramp_design('conventional', n, w=w), ticks=3000)
    assert error == pytest.approx((n + 1) * 2.0 / w, rel=2e-3)


@pytest.mark.parametrize('n', (1, 2, 3))
def test_nested_leaves_nothing_of_a_ramp(n: int) -> None:
    conventional = ramp_error(ramp_design('conventional', n))
    nested = ramp_error(ramp_design('nested', n, levels=2))
    assert abs(nested) < 1e-9 * abs(conventional)


def test_a_faster_inner_level_does_not_spoil_that() -> None:
    nested = ramp_error(ramp_design('nested', levels=2, inner_bandwidth=40.0))
    assert abs(nested) < 1e-9 * ramp_error(ramp_design('conventional'))


def test_generalized_with_two_extended_states_leaves_nothing_of_a_ramp() -> None:
    """It models the true ramp; the staircase trails that by half a step."""
    design = ramp_design('generalized', extended_states=2)
    assert true_ramp_error(design, 2.0) == pytest.approx(0.0, abs=1e-9)
    assert ramp_error(design) == pytest.approx(2.0 * H / 2, rel=1e-6)


@pytest.mark.parametrize('m', (2, 3, 4, 5))
@pytest.mark.parametrize('n', ORDERS)
def test_generalized_follows_a_ramp_at_any_order(n: int, m: int) -> None:
    design = ramp_design('generalized', n, extended_states=m, w=5.0)
    assert true_ramp_error(design, 1.0, h=0.05) == pytest.approx(0.0, abs=1e-5)


def true_ramp_error(design: Design, slope: float, h: float = H) -> float:
    """Return L(t) - sum d_k under L = slope t, not held: the last state of a longer chain is L."""
    observer, chain = Observer(design), Chain(design.order + 1)
    for _ in range(600):
        chain.advance(slope, h)
        observer.update(chain.y, 0.0, h)
    return chain.x[-1] - observer.disturbance()


@pytest.mark.parametrize(('wh', 'ratio'), ((0.1, 0.984), (0.2, 0.970), (0.4, 0.947)))
def test_a_ramp_that_is_not_held_is_seen_half_a_step_sooner(wh: float, ratio: float) -> None:
    """For the observer the last period is one of constant L, its mean: nested runs h/2 ahead."""
    w, slope = wh / H, 2.0
    conventional = true_ramp_error(ramp_design('conventional', w=w), slope)
    assert conventional == pytest.approx(ratio * 3 * slope / w, rel=2e-3)
    nested = true_ramp_error(ramp_design('nested', w=w), slope)
    assert nested == pytest.approx(-slope * H / 2, rel=1e-6)


def test_printed_halves_a_constant_residual() -> None:
    """e_3 is what level 1 leaves: constant under a ramp. Level 2 as printed takes half of it."""
    for n in (1, 2, 3):
        observer = follow(ramp_design('printed', n), 2.0, 3000)
        residual = 2.0 * 3000 * H - observer.levels[0][n]
        left = 2.0 * 3000 * H - observer.disturbance()
        assert residual == pytest.approx((n + 1) * 2.0 / 10.0, rel=0.01)
        assert left / residual == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize('structure', NAMES)
@pytest.mark.parametrize('n', ORDERS)
def test_a_constant_disturbance_is_found_whatever_the_command(structure: str, n: int) -> None:
    design = design_of(structure=structure, plant_order=n, b0=-2.5, levels=3)
    observer, chain = Observer(design), Chain(n)
    for u in noise(5, 1500, 0.3):
        chain.advance(design.b0 * u - 4.0, H)
        observer.update(chain.y, u, H)
    settled = abs(chain.y) * H**-n * 1e-14 + 1e-6
    assert observer.disturbance() == pytest.approx(-4.0, abs=settled)


def g(z: complex, n: int, w: float, h: float) -> complex:
    """
    G(z) from L, held from t_k on, to d at t_k, of one level: (1-p)^N z E(z) / (z-p)^N.

    Numerator: L reaches y through h^n E(z) / (z-1)^n, y reaches d through l_N z (z-1)^n / (z-p)^N.
    """
    p = exp(-w * h)
    return (1 - p) ** (n + 1) * z * eulerian(n, z) / (z - p) ** (n + 1)


def eulerian(n: int, z: complex) -> complex:
    """E_n(z) / n! of the held chain: sum over Euler's triangle, 1 at z = 1."""
    row = [1]
    for size in range(2, n + 1):
        row = [
            (i + 1) * (row[i] if i < len(row) else 0) + (size - i) * (row[i - 1] if i else 0)
            for i in range(size)
        ]
    return sum(c * z**i for i, c in enumerate(row)) / sum(row)


@pytest.mark.parametrize('levels', (1, 2, 3, 4))
@pytest.mark.parametrize('n', (1, 2, 3))
def test_the_residual_of_nested_levels_is_the_product_of_one_minus_g(n: int, levels: int) -> None:
    h, frequency = H, 5.0
    design = design_of(
        plant_order=n,
        structure='nested',
        levels=levels,
        inner_bandwidth=30.0,
        outer_bandwidth=20.0,
    )
    observer, chain, ticks = Observer(design), Chain(n), 3000
    residuals = []
    for k in range(ticks):
        observer.update(chain.y, 0.0, h)
        disturbance = cos(frequency * k * h)
        residuals.append(disturbance - observer.disturbance())
        chain.advance(disturbance, h)
    z = cexp(1j * frequency * h)
    expected = 1.0 + 0.0j
    for w in design.bandwidths:
        expected *= 1 - g(z, n, w, h)
    for k in range(ticks - 20, ticks):
        assert residuals[k] == pytest.approx((expected * z**k).real, abs=1e-9)


def test_nesting_helps_below_its_crossover_and_hurts_above() -> None:
    """For a sinusoid nested helps iff frequency < w'/sqrt(6) (n = 2, small w h)."""
    for frequency, helps in ((15.0, True), (18.0, False)):
        z = cexp(1j * frequency * 1e-4)
        assert (abs(1 - g(z, 2, 40.0, 1e-4)) ** 2 < 1) == helps


@pytest.mark.parametrize('structure', ('nested', 'cascade'))
def test_one_level_is_the_conventional_observer_to_the_bit(structure: str) -> None:
    one = Observer(design_of(structure=structure, levels=1))
    conventional = Observer(design_of(structure='conventional'))
    for y, u in zip(noise(1, 500), noise(2, 500)):
        one.update(y, u, H)
        conventional.update(y, u, H)
        assert one.levels == conventional.levels


def test_generalized_with_one_extended_state_is_conventional_to_the_bit() -> None:
    one = Observer(design_of(structure='generalized', extended_states=1))
    conventional = Observer(design_of(structure='conventional'))
    for y, u in zip(noise(1, 500), noise(2, 500)):
        one.update(y, u, H)
        conventional.update(y, u, H)
        assert one.levels == conventional.levels


def test_the_first_level_is_the_same_in_every_structure_of_many() -> None:
    many = [Observer(design_of(structure=name)) for name in ('nested', 'printed', 'cascade')]
    conventional = Observer(design_of(structure='conventional'))
    for y, u in zip(noise(3, 300), noise(4, 300)):
        for observer in (*many, conventional):
            observer.update(y, u, H)
        assert all(observer.levels[0] == conventional.levels[0] for observer in many)
    assert many[0].levels[1] != many[1].levels[1] != many[2].levels[1]


def noise_gain(design: Design) -> float:
    """Sum of squares of the impulse response from y to sum d_k, over sigma^2 h w^5."""
    observer, total = Observer(design), 0.0
    h, w = 0.001, 20.0
    for k in range(4000):
        observer.update(1.0 if k == 0 else 0.0, 0.0, h)
        total += observer.disturbance() ** 2
    return total / (h * w**5)


@pytest.mark.parametrize('levels', (1, 2, 3, 4))
def test_nesting_costs_noise(levels: int) -> None:
    """Var(d) / (sigma^2 h w^5) for n = 2, all levels at w."""
    design = design_of(
        structure='nested',
        levels=levels,
        inner_bandwidth=20.0,
        outer_bandwidth=20.0,
        bandwidth_ratio=1.0,
    )
    expected = (0.1875, 0.8027, 1.9472, 3.7632)[levels - 1]
    assert noise_gain(design) == pytest.approx(expected, rel=0.03)


def test_cascade_filters_more_noise_than_nested_at_the_same_bandwidths() -> None:
    nested, cascade = (
        design_of(structure=name, levels=2, inner_bandwidth=10.0, outer_bandwidth=20.0)
        for name in ('nested', 'cascade')
    )
    assert noise_gain(cascade) < 0.5 * noise_gain(nested)


def test_bandwidths_of_the_levels() -> None:
    design = design_of(levels=5, inner_bandwidth=80.0, outer_bandwidth=32.0, bandwidth_ratio=0.25)
    assert design.bandwidths == [80.0, 32.0, 8.0, 2.0, 0.5]
    assert [list(design_of(structure=name, levels=3).reach) for name in NAMES] == [
        {name: [0, 1, 2] for name in ('nested', 'cascade', 'nonlinear')}.get(
            name, {'printed': [0, 2], 'filtered': [0, 1]}.get(name, [0])
        )
        for name in NAMES
    ]


def test_every_structure_is_in_the_varied_settings() -> None:
    used = {case.get('structure', 'nested') for case in varied_settings().values()}
    assert used == set(NAMES)


def test_the_eulerian_polynomials_used_above() -> None:
    assert eulerian(1, 5.0) == 1.0
    assert eulerian(3, 2.0) == pytest.approx((1 + 4 * 2 + 4) / 6)
