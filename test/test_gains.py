"""The observer gains: check values, and every pole where it was asked for."""

from __future__ import annotations

from fractions import Fraction
from math import comb, exp, factorial, log, pi, sin
from operator import mul

from law_helpers import design_of, Observer, ORDERS
from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.model import observer_gains
from nadrc_ros.theory.system import is_stable
import pytest
from theory_helpers import observer as transfer_function

CHECK_VALUES = (
    (2, 12.0, 0.01, 0.8869204367, (0.3023236739, 3.619204243, 14.45946977)),
    (2, 100.0, 0.001, 0.9048374180, (0.2591817793, 25.87507435, 861.7844443)),
    (1, 20.0, 0.01, 0.8187307531, (0.3296799540, 3.285853988)),
)
POLYNOMIALS = [(n, m) for n in ORDERS for m in (1, 2, 3, 4, 5)]
ONE = 2**200  # of 1 / ONE floats that are not smaller than 1e-44 are whole multiples
RATIOS = (1.0, 0.4, 2.5, 1.2, 0.7, 3.0, 0.9, 1.6, 0.5, 2.0)


def observer(n: int, m: int = 1, **values: object) -> Design:
    return design_of(plant_order=n, structure='generalized', extended_states=m, **values)


def gains_in_use(design: Design, h: float) -> list[float]:
    """From estimates of zero with no input, one tick on y = 1 leaves L y."""
    used = Observer(design)
    used.update(1.0, 0.0, h)
    return list(used.levels[0])


def scaled_error_matrix(design: Design, h: float) -> list[list[float]]:
    """Step unit vectors: D^-1 (I - L C) Ad D with D = diag(h^-i), so that no entry is huge."""
    states = design.states
    columns = []
    for j in range(states):
        used = Observer(design)
        used.levels[0][j] = h**-j
        used.update(0.0, 0.0, h)
        columns.append([used.levels[0][i] * h**i for i in range(states)])
    return [[column[i] for column in columns] for i in range(states)]


def characteristic_polynomial(matrix: list[list[float]]) -> list[float]:
    """
    Return c of sum_k c_k z^k by Faddeev and LeVerrier in exact arithmetic.

    In whole numbers, which are quicker than fractions: of a matrix in units of 1 / ONE the c are
    whole, too.
    """
    size = len(matrix)
    a = [[int(Fraction(value) * ONE) for value in row] for row in matrix]
    c = [0] * size + [1]
    product = [[0] * size for _ in range(size)]
    for k in range(1, size + 1):
        for i in range(size):
            product[i][i] += c[size - k + 1]
        columns = list(zip(*product))
        product = [[sum(map(mul, row, column)) for column in columns] for row in a]
        c[size - k] = -sum(product[i][i] for i in range(size)) // k
    return [float(Fraction(value, ONE ** (size - k))) for k, value in enumerate(c)]


def polynomial_with_roots(roots: list[float]) -> list[float]:
    c = [Fraction(1)]
    for root in roots:
        shifted = [Fraction(0), *c]
        c = [s - Fraction(root) * low for s, low in zip(shifted, [*c, Fraction(0)])]
    return [float(value) for value in c]


@pytest.mark.parametrize(('n', 'w', 'h', 'z', 'gains'), CHECK_VALUES)
def test_gains_equal_the_check_values(
    n: int, w: float, h: float, z: float, gains: tuple[float, ...]
) -> None:
    assert exp(-w * h) == pytest.approx(z, rel=1e-9)
    assert observer_gains(n + 1, h, [exp(-w * h)] * (n + 1)) == pytest.approx(gains, rel=1e-9)
    design = design_of(plant_order=n, structure='conventional', inner_bandwidth=w)
    assert gains_in_use(design, h) == pytest.approx(gains, rel=1e-9)


@pytest.mark.parametrize('wh', (0.03, 0.4, 1.3))
def test_gains_equal_their_closed_forms(wh: float) -> None:
    z, h = exp(-wh), 0.01
    second = (1 - z**3, 3 * (1 - z) ** 2 * (1 + z) / (2 * h), (1 - z) ** 3 / h**2)
    assert observer_gains(2, h, [z] * 2) == pytest.approx((1 - z**2, (1 - z) ** 2 / h), rel=1e-12)
    assert observer_gains(3, h, [z] * 3) == pytest.approx(second, rel=1e-12)


@pytest.mark.parametrize('h', (1e-3, 0.01, 1.0, 1e3))
@pytest.mark.parametrize(('n', 'm'), POLYNOMIALS)
def test_every_pole_of_the_observer_in_use_is_at_exp_minus_w_h(n: int, m: int, h: float) -> None:
    for wh in (0.05, 0.4, 1.5):
        matrix = scaled_error_matrix(observer(n, m, inner_bandwidth=wh / h), h)
        expected = polynomial_with_roots([exp(-wh)] * (n + m))
        assert characteristic_polynomial(matrix) == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize('h', (1e-3, 0.01, 1.0, 1e3))
@pytest.mark.parametrize(('n', 'm'), POLYNOMIALS)
def test_pole_ratios_place_each_pole(n: int, m: int, h: float) -> None:
    states = n + m
    ratios = RATIOS[:states]
    for wh in (0.05, 0.4):
        design = observer(n, m, inner_bandwidth=wh / h, pole_ratios=ratios)
        expected = polynomial_with_roots([exp(-ratio * wh) for ratio in ratios])
        found = characteristic_polynomial(scaled_error_matrix(design, h))
        assert found == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize('ratios', ((1.0,), (0.5, 1.0, 2.0)))
@pytest.mark.parametrize('factor', (0.5, 0.8))
@pytest.mark.parametrize(('n', 'm'), POLYNOMIALS)
def test_a_share_of_the_gains_mixes_the_polynomials(
    n: int, m: int, factor: float, ratios: tuple[float, ...]
) -> None:
    h, wh, states = 0.01, 0.4, n + m
    design = observer(
        n, m, inner_bandwidth=wh / h, pole_ratios=ratios[:states], observer_gain_factor=factor
    )
    used = polynomial_with_roots([exp(-ratio * wh) for ratio in design.pole_ratios])
    free = polynomial_with_roots([1.0] * states)
    expected = [factor * a + (1.0 - factor) * b for a, b in zip(used, free)]
    found = characteristic_polynomial(scaled_error_matrix(design, h))
    assert found == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize(('n', 'm'), POLYNOMIALS)
def test_half_gain_is_stable_up_to_its_limit(n: int, m: int) -> None:
    states = n + m
    step = min(4.0 * sin(pi / (2 * states)) ** 2, 1.0)  # the largest 1 - exp(-w h)
    for share, stable in ((0.98, True), (1.02, False)):
        if share * step < 1.0:
            w = -log(1.0 - share * step) / 0.01
            design = observer(n, m, inner_bandwidth=w, observer_gain_factor=0.5)
            assert is_stable(transfer_function(design, 0.01)) == stable


@pytest.mark.parametrize(('n', 'm'), POLYNOMIALS)
def test_both_forms_of_the_gains_in_use_agree(n: int, m: int) -> None:
    h, w, states = 0.01, 30.0, n + m
    formula = observer_gains(states, h, [exp(-w * h)] * states)
    ratios = (1.0,) * (states - 1) + (1.0 + 1e-12,)
    equal = gains_in_use(observer(n, m, inner_bandwidth=w), h)
    general = gains_in_use(observer(n, m, inner_bandwidth=w, pole_ratios=ratios), h)
    assert equal == pytest.approx(formula, rel=1e-11)
    assert general == pytest.approx(formula, rel=1e-9)
    scaled = gains_in_use(observer(n, m, inner_bandwidth=w / 3, pole_ratios=(3.0,)), h)
    assert scaled == pytest.approx(formula, rel=1e-11)


@pytest.mark.parametrize('n', ORDERS)
def test_the_gains_tend_to_those_of_the_continuous_observer(n: int) -> None:
    w, h = 10.0, 1e-6
    continuous = [comb(n + 1, i + 1) * w ** (i + 1) for i in range(n + 1)]
    found = gains_in_use(observer(n, inner_bandwidth=w), h)
    assert [gain / h for gain in found] == pytest.approx(continuous, rel=1e-4)


@pytest.mark.parametrize('n', ORDERS)
def test_with_the_truth_in_hand_the_prediction_is_exact(n: int) -> None:
    """The chain's own motion under a held input and a held disturbance leaves no innovation."""
    h, d = 0.2, -0.7
    design = design_of(plant_order=n, b0=3.0, structure='conventional')
    x = [0.3 * (-1) ** i for i in range(n)]
    for u in (0.5, -2.0, 1.0):
        used = Observer(design)
        used.levels[0][:] = [*x, d]
        z = [*x, 3.0 * u + d]
        x = [
            sum(z[j] * h ** (j - i) / factorial(j - i) for j in range(i, n + 1)) for i in range(n)
        ]
        used.update(x[0], u, h)
        assert used.levels[0] == pytest.approx([*x, d], abs=1e-11)


def test_the_polynomial_of_a_known_matrix() -> None:
    assert characteristic_polynomial([[2.0, 1.0], [0.0, 3.0]]) == [6.0, -5.0, 1.0]
    assert polynomial_with_roots([2.0, 3.0]) == [6.0, -5.0, 1.0]
