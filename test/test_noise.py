"""Noise: the hold is exact, the sequence depends on the seed alone."""

from __future__ import annotations

from fractions import Fraction
from itertools import chain, pairwise

from hypothesis import given, settings
from hypothesis import strategies as st
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.simulation.noise import Noise, NoiseSource, sample_indices
import numpy as np
import pytest

PINNED = [0.1257302210933933, -0.1321048632913019, 0.6404226504432821]
RATES = st.sampled_from((1, 3, 7, 10, 30, 50, 100, 120, 200, 250, 333, 500, 1000, 3000, 8000))


def test_a_new_sample_exactly_when_the_index_goes_up() -> None:
    source = NoiseSource(Noise(variance=1.0, sample_time=0.01), 0.001)
    values = [source.at(k) for k in range(1000)]
    for k in range(1, 1000):
        assert (values[k] != values[k - 1]) == (k % 10 == 0), k


@settings(max_examples=300)
@given(RATES, RATES, st.integers(0, 10**8))
def test_the_index_is_the_exact_quotient_rounded_down(rate: int, noise_rate: int, k: int) -> None:
    exact = Fraction(k * noise_rate, rate)
    found = sample_indices(k, 1, 1 / rate, 1 / noise_rate)
    assert found.tolist() == [exact.numerator // exact.denominator]


def test_the_index_is_right_at_every_one_of_many_boundaries() -> None:
    for rate, noise_rate in ((1000, 100), (1000, 333), (3000, 7), (100, 10), (120, 100)):
        period, sample_time = 1 / rate, 1 / noise_rate
        exact = [k * noise_rate // rate for k in range(20_000)]
        assert sample_indices(0, 20_000, period, sample_time).tolist() == exact
        noise = Noise(variance=1.0, sample_time=sample_time)
        normals = NoiseSource(Noise(variance=1.0), period).block(0, exact[-1] + 1)
        assert np.array_equal(NoiseSource(noise, period).block(0, 20_000), normals[exact])


@given(st.integers(1, 5000), st.integers(1, 5000), st.integers(0, 10**5))
def test_rounding_never_moves_a_boundary(rate: int, noise_rate: int, seconds: int) -> None:
    """At whole seconds the index is known, also where the float quotient falls just below."""
    found = sample_indices(seconds * rate, 1, 1 / rate, 1 / noise_rate)
    assert found.tolist() == [seconds * noise_rate]


def test_sample_time_zero_draws_each_period() -> None:
    source = NoiseSource(Noise(variance=1.0), 0.005)
    assert len({source.at(k) for k in range(500)}) == 500


@given(
    st.integers(0, 2**63 - 1),
    st.sampled_from((0.0, 0.0004, 0.001, 0.003, 0.01)),
    st.lists(st.integers(0, 40), min_size=1, max_size=40),
)
def test_skipping_ahead_and_reading_all_give_the_same_bits(
    seed: int, sample_time: float, strides: list[int]
) -> None:
    noise = Noise(variance=2.0, sample_time=sample_time, seed=seed)
    periods = np.cumsum(strides)
    whole = NoiseSource(noise, 0.001).block(0, int(periods[-1]) + 1)
    source, skipping = NoiseSource(noise, 0.001), NoiseSource(noise, 0.001)
    assert [source.at(k) for k in range(len(whole))] == whole.tolist()
    assert [skipping.at(int(k)) for k in periods] == [whole[k] for k in periods]


def test_a_long_skip_draws_in_chunks_and_stays_in_step() -> None:
    noise = Noise(variance=1.0, seed=5)
    assert NoiseSource(noise, 1.0).at(200_000) == NoiseSource(noise, 1.0).block(0, 200_001)[-1]


def test_the_variance_scales_and_leaves_the_sequence_alone() -> None:
    plain = NoiseSource(Noise(variance=1.0, seed=3), 0.01).block(0, 100)
    source = NoiseSource(Noise(variance=0.0, seed=3), 0.01)
    found = []
    for k in range(100):
        if k == 50:
            source.set_variance(4.0)
        found.append(source.at(k))
    assert found == [0.0] * 50 + (2.0 * plain[50:]).tolist()
    with pytest.raises(SettingError, match='variance = -1'):
        source.set_variance(-1.0)


def test_known_bits() -> None:
    """PCG64 with the ziggurat method: pinned, since runs are compared across machines."""
    found = NoiseSource(Noise(variance=1.0, seed=0), 1.0).block(0, 3).tolist()
    assert found == PINNED


def test_the_statistics() -> None:
    values = NoiseSource(Noise(variance=1e-4, seed=11), 0.001).block(0, 200_000)
    assert abs(values.mean()) < 5 * 0.01 / 200_000**0.5
    assert values.var() == pytest.approx(1e-4, rel=0.02)
    assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 0.01


def test_going_back_is_refused() -> None:
    source = NoiseSource(Noise(variance=1.0), 0.001)
    source.at(3)
    assert source.at(3) == source.at(3)
    with pytest.raises(ValueError, match='period 2'):
        source.at(2)


@pytest.mark.parametrize('period', [0.0, -1.0, float('nan'), float('inf')])
def test_a_bad_period_is_refused(period: float) -> None:
    with pytest.raises(SettingError, match='period'):
        NoiseSource(Noise(), period)
    with pytest.raises(SettingError, match='period'):
        NoiseSource(Noise(), period).block(0, 3)


def test_an_empty_sequence() -> None:
    assert NoiseSource(Noise(), 0.1).block(0, 0).tolist() == []


def test_blocks_read_the_same_bits_as_periods() -> None:
    for sample_time in (0.0, 0.001, 0.0033, 0.01, 1e-4, 7.0):
        noise = Noise(variance=2.0, sample_time=sample_time, seed=4)
        one, other = NoiseSource(noise, 0.001), NoiseSource(noise, 0.001)
        singly = [one.at(k) for k in range(1000)]
        cuts = [0, 1, 2, 300, 300, 301, 900]
        blocks = [other.block(a, b - a).tolist() for a, b in pairwise(cuts)]
        blocks.append([other.at(k) for k in range(900, 950)])
        blocks.append(other.block(950, 50).tolist())
        assert list(chain.from_iterable(blocks)) == singly


def test_a_block_of_the_past_is_refused() -> None:
    source = NoiseSource(Noise(), 0.001)
    source.block(0, 10)
    with pytest.raises(ValueError, match='before one'):
        source.block(8, 5)
