"""The state error feedback: linear, and the nonlinear fal."""

from __future__ import annotations

from math import comb

from hypothesis import given
from hypothesis import strategies as st
from law_helpers import design_of, Law, NAMES, noise, ORDERS
from nadrc_ros.adrc.feedback import fal, fal_feedback
from nadrc_ros.adrc.state import blank_state, raw_command
import pytest

ERRORS = st.floats(-1e9, 1e9)
ALPHAS = st.floats(0.01, 1.0)
DELTAS = st.floats(1e-9, 1e3)


@given(ERRORS, ALPHAS, DELTAS)
def test_fal_is_odd(e: float, alpha: float, delta: float) -> None:
    assert fal(-e, alpha, delta) == -fal(e, alpha, delta)


@given(ALPHAS, DELTAS)
def test_fal_is_continuous_where_its_branches_meet(alpha: float, delta: float) -> None:
    inside, outside = fal(delta, alpha, delta), fal(delta * (1 + 1e-12), alpha, delta)
    assert outside == pytest.approx(inside, rel=1e-10)


@given(ERRORS, ERRORS, ALPHAS, DELTAS)
def test_fal_never_falls(e: float, f: float, alpha: float, delta: float) -> None:
    low, high = sorted((e, f))
    assert fal(low, alpha, delta) <= fal(high, alpha, delta) * (1 + 1e-12) + 1e-300 or (
        fal(low, alpha, delta) == pytest.approx(fal(high, alpha, delta), rel=1e-12)
    )


@given(ERRORS, DELTAS)
def test_fal_of_exponent_one_is_the_identity(e: float, delta: float) -> None:
    assert fal(e, 1.0, delta) == pytest.approx(e, rel=1e-15)


def test_fal_values() -> None:
    assert fal(4.0, 0.5, 0.1) == 2.0
    assert fal(-4.0, 0.5, 4.0) == -2.0
    assert fal(0.01, 0.5, 0.25) == 0.02
    assert fal(0.36, 0.5, 0.25) == 0.6
    assert fal(0.0, 0.25, 1e-9) == 0.0


@pytest.mark.parametrize('n', ORDERS)
def test_the_linear_gains_are_those_of_s_plus_wc_to_the_n(n: int) -> None:
    wc = 3.0
    gains = design_of(plant_order=n, controller_bandwidth=wc).feedback_gains
    # s^n + k_n s^(n-1) + ... + k_1 at s = 1.5 is (1.5 + wc)^n.
    assert 1.5**n + sum(k * 1.5**i for i, k in enumerate(gains)) == pytest.approx((1.5 + wc) ** n)
    assert gains[0] == wc**n and gains[-1] == comb(n, n - 1) * wc


@pytest.mark.parametrize('n', ORDERS)
def test_the_reference_derivatives_enter_up_to_the_nth(n: int) -> None:
    design = design_of(plant_order=n, structure='conventional', b0=2.0)
    state, x, r = blank_state(design), noise(1, n + 1), noise(2, n + 1)
    state.levels[0][:], state.profile[:] = x, r
    expected = r[n] + sum(k * (r[i] - x[i]) for i, k in enumerate(design.feedback_gains))
    assert raw_command(design, state) == pytest.approx((expected - x[n]) / 2.0, rel=1e-13)


@pytest.mark.parametrize('structure', NAMES)
def test_fal_with_exponent_one_is_the_linear_law(structure: str) -> None:
    linear = Law(design_of(structure=structure))
    same = Law(design_of(structure=structure, feedback='fal', fal_exponents=(1.0,)))
    for y, r in zip(noise(1, 500), noise(2, 500)):
        assert same.step([r], y, 0.01) == pytest.approx(linear.step([r], y, 0.01), rel=1e-12)


def test_fal_gains_of_its_own_and_from_the_bandwidth() -> None:
    def gains(*given_gains: float) -> list[float]:
        design = design_of(feedback='fal', fal_gains=given_gains, controller_bandwidth=4.0)
        return list(design.feedback_gains)

    assert gains(0.0) == [16.0, 8.0]
    assert gains(5.0) == [5.0, 5.0]
    assert gains(0.0, 7.0) == [16.0, 7.0]
    assert design_of(fal_gains=(5.0,)).feedback_gains == [16.0, 8.0]


def test_fal_is_applied_to_each_state_error() -> None:
    design = design_of(feedback='fal', fal_exponents=(0.5, 1.0), fal_gains=(3.0, 2.0))
    v = fal_feedback(design, [-4.0, 1.0], [0.0, 2.0, 0.25], 0.25)
    assert v == 0.25 + 3.0 * 2.0 + 2.0 * 1.0


@pytest.mark.parametrize(
    ('level', 'index'), (('inner', 0), ('outer', 3), ('1', 0), ('3', 2), ('6', 3))
)
def test_the_level_that_feeds_the_law(level: str, index: int) -> None:
    law = Law(design_of(levels=4, feedback_level=level))
    assert law.design.feedback_level == index
    for y in noise(3, 50):
        u = law.step([0.0], 0.01 * y, 0.01)
    x = law.state.levels[index]
    v = -sum(k * x[i] for i, k in enumerate(law.design.feedback_gains))
    assert u == pytest.approx(v - sum(x[2] for x in law.state.levels), rel=1e-12)
