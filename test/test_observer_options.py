"""Options of the observer: fal gains, and bandwidths that rise after a start."""

from __future__ import annotations

from math import exp, sin

from law_helpers import design_of, Law, state_bits
from nadrc_ros.theory.model import observer_gains
import pytest


def test_the_nonlinear_structure_is_the_nested_one_for_small_innovations() -> None:
    nested = Law(design_of(structure='nested', inner_bandwidth=20.0))
    nonlinear = Law(design_of(structure='nonlinear', inner_bandwidth=20.0, eso_delta=10.0))
    for k in range(200):
        y = sin(0.05 * k)
        assert nested.step([1.0], y, 0.01) == nonlinear.step([1.0], y, 0.01)
    assert state_bits(nested.state) == state_bits(nonlinear.state)


def test_large_innovations_of_the_nonlinear_structure_are_corrected_by_fal() -> None:
    """State i of (y, y', d) moves by l_i delta (|e| / delta)^(2^-i) beyond delta, from rest."""
    delta, e, h, w = 0.01, 0.16, 0.01, 12.0
    law = Law(
        design_of(structure='nonlinear', levels=1, inner_bandwidth=w, eso_delta=delta), y=0.0
    )
    law.step([0.0], e, h)
    gains = observer_gains(3, h, [exp(-w * h)] * 3)
    expected = [gain * delta * (e / delta) ** 0.5**i for i, gain in enumerate(gains)]
    assert law.state.levels[0] == pytest.approx(expected, rel=1e-12)


def test_the_bandwidths_rise_as_t_cubed_after_a_start() -> None:
    rising = Law(design_of(levels=1, inner_bandwidth=50.0, startup_time=1.0), y=0.0)
    for _ in range(39):
        rising.step([0.0], 0.0, 0.01)
    rising.step([0.0], 1.0, 0.01)
    gains = observer_gains(3, 0.01, [exp(-50.0 * 0.4**3 * 0.01)] * 3)
    assert rising.state.levels[0] == pytest.approx(gains, rel=1e-9)


def test_the_rising_bandwidth_takes_the_peak_out_of_a_wrong_start() -> None:
    peaks = []
    for startup_time in (0.0, 1.0):
        law = Law(design_of(levels=1, inner_bandwidth=100.0, startup_time=startup_time), y=0.0)
        peaks.append(
            max(abs((law.step([0.0], 1.0, 1e-3), law.state.levels[0][2])[1]) for _ in range(2000))
        )
    assert peaks[1] < 0.05 * peaks[0]
