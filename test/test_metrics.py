"""Metrics: closed forms, streaming equals batch, and nothing poisons them."""

from __future__ import annotations

from math import exp, inf, isfinite, nan, pi, sin
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from nadrc_ros.simulation.metrics import accumulate, Metrics, MetricValues
import numpy as np
import pytest

SETTLE_TIME = 2.0
SAMPLE = st.tuples(
    st.floats(0, 10), st.floats(0, 0.1), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.booleans()
)
ANYTHING = st.tuples(st.floats(), st.floats(), st.floats(), st.floats(), st.booleans())


def test_closed_forms_of_a_decaying_error() -> None:
    h, found = 1e-4, Metrics(SETTLE_TIME)
    for k in range(200_000):
        found.add(k * h, h, -exp(-k * h), 2.0)
    values = found.values()
    assert values.iae == pytest.approx(1 + h / 2, rel=1e-6)
    assert values.itae == pytest.approx(1.0, rel=1e-6)
    assert values.ise == pytest.approx(1 / 2 + h / 2, rel=1e-6)
    assert values.itse == pytest.approx(1 / 4, rel=1e-6)
    assert values.isu == pytest.approx(80.0)
    assert values.rmse == pytest.approx((values.ise / 20.0) ** 0.5)
    assert values.max_error == 1.0
    assert values.peak_error == pytest.approx(exp(-2.0))
    assert values.max_command == 2.0
    assert values.total_variation == 0.0
    assert values.samples == 200_000
    assert values.skipped == 0
    assert values.duration == pytest.approx(20.0)


def test_closed_forms_of_a_sine_command() -> None:
    h, found = pi / 5000, Metrics(SETTLE_TIME)
    for k in range(10_000):
        found.add(k * h, h, sin(k * h), 3.0 * sin(k * h), k % 4 == 0)
    values = found.values()
    assert values.isu == pytest.approx(9.0 * pi, rel=1e-9)
    assert values.ise == pytest.approx(pi, rel=1e-9)
    assert values.rmse == pytest.approx(0.5**0.5, rel=1e-9)
    assert values.iae == pytest.approx(4.0, rel=1e-6)
    assert values.total_variation == pytest.approx(12.0, rel=1e-3)
    assert values.saturated_fraction == pytest.approx(0.25)


def test_the_effort_of_a_held_command_is_exact() -> None:
    found = Metrics(SETTLE_TIME)
    for k, u in enumerate((1.0, -2.0, 4.0)):
        found.add(0.5 * k, 0.5, 0.0, u)
    assert found.values().isu == 0.5 * (1 + 4 + 16)
    assert found.values().total_variation == 9.0
    assert found.values().max_command == 4.0


@given(st.lists(SAMPLE, min_size=1, max_size=30))
def test_streaming_equals_batch(samples: list[tuple[float, float, float, float, bool]]) -> None:
    found = Metrics(SETTLE_TIME)
    for sample in samples:
        found.add(*sample)
    t, h, e, u, s = (np.array(column) for column in zip(*samples, strict=True))
    values = found.values()
    duration = h.sum()
    late = np.abs(e[t >= SETTLE_TIME])
    expected = {
        'itae': (h * t * abs(e)).sum(),
        'isu': (h * u**2).sum(),
        'iae': (h * abs(e)).sum(),
        'ise': (h * e**2).sum(),
        'itse': (h * t * e**2).sum(),
        'max_error': abs(e).max(initial=0.0),
        'peak_error': late.max() if late.size else None,
        'max_command': abs(u).max(initial=0.0),
        'total_variation': abs(np.diff(u)).sum(),
        'samples': len(samples),
        'skipped': 0,
        'duration': duration,
    }
    if duration > 1e-9:
        expected['rmse'] = ((h * e**2).sum() / duration) ** 0.5
        expected['saturated_fraction'] = (h * s).sum() / duration
    for name, value in expected.items():
        figure = values.as_dict()[name]
        near = value if value is None else pytest.approx(value, rel=1e-9, abs=1e-300)
        assert figure == near, name


@given(st.lists(ANYTHING, max_size=20))
def test_nothing_poisons_the_sums(
    samples: list[tuple[float, float, float, float, bool]],
) -> None:
    found = Metrics(SETTLE_TIME)
    for sample in samples:
        found.add(*sample)
    values = found.values()
    assert all(v is None or isfinite(v) for v in values.as_dict().values())
    assert values.samples + values.skipped == len(samples)


@pytest.mark.parametrize('place', range(4))
@pytest.mark.parametrize('bad', [nan, inf, -inf])
def test_a_sample_that_is_not_finite_is_skipped_whole(place: int, bad: float) -> None:
    clean, dirty = Metrics(SETTLE_TIME), Metrics(SETTLE_TIME)
    for k in range(10):
        good = (3.0 * k, 0.1, 1.0 + k, 2.0 * k)
        t, h, error, command = (bad if i == place else value for i, value in enumerate(good))
        clean.add(*good, saturated=True)
        dirty.add(*good, saturated=True)
        dirty.add(t, h, error, command, True)
    assert dirty.values().skipped == 10
    expected = clean.values().as_dict()
    assert dirty.values().as_dict() == {**expected, 'skipped': 10}


@pytest.mark.parametrize('sample', [(-1.0, 0.1, 0.0, 0.0), (0.0, -0.1, 0.0, 0.0)])
def test_time_that_runs_backwards_is_skipped(sample: tuple[float, float, float, float]) -> None:
    found = Metrics(SETTLE_TIME)
    found.add(*sample)
    assert found.values().skipped == 1


def test_an_empty_run_has_no_figures_rather_than_perfect_ones() -> None:
    values: Any = Metrics(SETTLE_TIME).values().as_dict()
    counts = {name: values[name] for name in ('samples', 'skipped', 'duration')}
    assert set(counts.values()) == {0}
    assert {value for name, value in values.items() if name not in counts} == {None}
    assert MetricValues(**values).as_dict() == values


def test_the_compiled_update_gives_the_same_bits() -> None:
    numba = pytest.importorskip('numba')
    function, plain = numba.njit(accumulate), Metrics(SETTLE_TIME)
    acc = np.array(plain.sums)
    for k in range(2000):
        error = nan if k % 97 == 5 else sin(0.37 * k)
        sample = (0.01 * k, 0.01, error, sin(0.11 * k) ** 3, k % 7 == 0)
        function(acc, *sample)
        plain.add(*sample)
    assert acc.tolist() == plain.sums
