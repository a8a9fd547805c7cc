"""The tracking differentiator: Han's fhan reaches the reference soonest, without overshoot."""

from __future__ import annotations

from itertools import pairwise
from math import copysign, isfinite, sqrt

from hypothesis import given
from hypothesis import strategies as st
from nadrc_ros.adrc.differentiator import fhan, track
import pyadrc
import pytest

H = 0.01
STATES = st.floats(-1e3, 1e3)


def profile_to(
    target: float, acceleration: float, ticks: int, h: float = H, n: int = 2
) -> list[list[float]]:
    profile, run = [0.0] * (n + 1), []
    for _ in range(ticks):
        track(target, acceleration, h, profile)
        run.append(list(profile))
    return run


@given(STATES, STATES, st.floats(1e-3, 1e3), st.floats(1e-4, 0.1))
def test_fhan_is_odd_and_bounded(x1: float, x2: float, r: float, h: float) -> None:
    assert abs(fhan(x1, x2, r, h)) <= r
    if abs(fhan(x1, x2, r, h)) < r or x1 != 0.0 or x2 != 0.0:
        assert fhan(-x1, -x2, r, h) == -fhan(x1, x2, r, h)


@given(STATES, STATES, st.floats(1e-2, 1e2))
def test_fhan_agrees_with_an_independent_one(x1: float, x2: float, r: float) -> None:
    scale = abs(x1) + abs(x2) + 1.0
    if abs(fhan(x1 + 1e-9 * scale, x2, r, H) - fhan(x1 - 1e-9 * scale, x2, r, H)) < 1e-3 * r:
        assert fhan(x1, x2, r, H) == pytest.approx(pyadrc.fhan(x1, x2, r, H), abs=1e-6 * r)


@pytest.mark.parametrize('r', (0.5, 4.0, 50.0))
@pytest.mark.parametrize('target', (1.0, -3.0, 0.001))
def test_a_step_is_reached_in_minimum_time_without_overshoot(target: float, r: float) -> None:
    """A double integrator under |r''| <= R covers D in 2 sqrt(D/R)."""
    fastest = 2 * sqrt(abs(target) / r)
    run = profile_to(target, r, int(fastest / H) + 8)
    arrived = int(fastest / H) + 5
    late = [abs(x[0] - target) for x in run[arrived:]]
    assert max(late) < 1e-9 + r * H * H
    assert all(copysign(1.0, target) * (x[0] - target) < 0.125 * r * H * H for x in run)
    assert all(abs(b[1] - a[1]) <= r * H * (1 + 1e-9) for a, b in pairwise(run))
    early = run[int(0.8 * fastest / H)] if fastest > 10 * H else [0.0]
    assert abs(early[0] - target) > 0.01 * abs(target)


def test_at_rest_it_does_not_chatter() -> None:
    run = profile_to(1.0, 4.0, 1000)
    assert all(abs(x[0] - 1.0) < 1e-12 and abs(x[1]) < 1e-9 for x in run[500:])


@pytest.mark.parametrize('r', (0.5, 4.0, 100.0))
@pytest.mark.parametrize('v', (0.7, -0.2))
def test_a_moving_reference_is_trailed_by_the_distance_of_a_stop(r: float, v: float) -> None:
    profile = [0.0, 0.0, 0.0]
    for k in range(3001):
        track(v * k * H, r, H, profile)
    lag = v * 3000 * H - profile[0]  # behind the reference of the same tick
    assert profile[1] == pytest.approx(v, abs=1e-9)
    if abs(v) > 2 * r * H:
        assert lag == pytest.approx(copysign(v * v / (2 * r), v) + 0.5 * H * v, rel=1e-3)
    else:
        assert abs(lag) < 5 * H * abs(v)


@pytest.mark.parametrize('n', (1, 2, 3, 4, 5))
def test_derivatives_beyond_the_profile_are_zero(n: int) -> None:
    run = profile_to(1.0, 4.0, 5, n=n)
    assert run[-1][1] > 0.0
    for i in range(2, n + 1):
        assert (run[-1][i] != 0.0) == (i == 2 and n > 2)


@given(
    st.floats(-1e100, 1e100),
    st.floats(5e-324, 1e6),
    st.floats(1e-9, 3600.0),
    st.lists(st.floats(-1e100, 1e100), min_size=2, max_size=2),
)
def test_it_never_raises(target: float, r: float, h: float, start: list[float]) -> None:
    for x1, x2 in (start, [target, 0.0]):
        profile = [x1, x2, 0.0]
        track(target, r, h, profile)
        assert all(map(isfinite, profile))


def test_an_acceleration_too_small_to_square_is_no_division_by_zero() -> None:
    profile = [1.0, 0.0, 0.0]
    track(1.0, 5e-324, 1e-9, profile)
    assert profile[0] == 1.0
