"""Signals: each derivative is the slope of the one before, and one word means one thing."""

from __future__ import annotations

from math import cos, exp, nan, pi, sin
from typing import Any

from hypothesis import assume, given, settings
from hypothesis import strategies as st
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.simulation.kernel import fields_of
from nadrc_ros.simulation.protocols import Signal
from nadrc_ros.simulation.signals import (
    make_signal,
    signal_fields,
    SIGNALS,
)
import pytest

SMOOTH = ('none', 'constant', 'ramp', 'sine', 'cosine', 'chirp', 'decaying_cosine')
MAX_DERIVATIVES = 6
STENCIL = (-1 / 60, 3 / 20, -3 / 4, 0.0, 3 / 4, -3 / 20, 1 / 60)
FLAT = st.fixed_dictionaries(
    {
        'offset': st.floats(-3, 3),
        'amplitude': st.floats(-3, 3),
        'start_time': st.floats(0, 3),
        'slope': st.floats(-3, 3),
        'frequency': st.floats(0, 4),
        'phase': st.floats(-4, 4),
        'end_frequency': st.floats(0, 4),
        'sweep_time': st.floats(0.5, 5),
        'velocity': st.floats(0.1, 3),
        'acceleration': st.floats(0.1, 3),
        'decay': st.floats(0, 2),
    }
)


def at(signal: Signal, t: float, count: int = MAX_DERIVATIVES) -> list[float]:
    out = [nan, *[0.0] * (count - 1)]
    signal.derivatives(t, out)
    return out


def slopes(signal: Signal, t: float, h: float = 0.01) -> list[float]:
    """Differentiate every derivative but the last by a sixth-order difference."""
    rows = [at(signal, t + (i - 3) * h) for i in range(7)]
    return [
        sum(c * row[k] for c, row in zip(STENCIL, rows, strict=True)) / h
        for k in range(MAX_DERIVATIVES - 1)
    ]


def away(t: float, *corners: float) -> bool:
    return all(abs(t - corner) > 0.05 for corner in corners)


@settings(max_examples=300)
@given(st.sampled_from(SMOOTH), FLAT, st.floats(0, 12))
def test_each_derivative_is_the_slope_of_the_one_before(
    name: str, flat: dict[str, float], t: float
) -> None:
    start = flat['start_time']
    assume(away(t, start, start + flat['sweep_time']))
    signal = make_signal(name, flat)
    values = at(signal, t)
    for k, slope in enumerate(slopes(signal, t)):
        assert values[k + 1] == pytest.approx(slope, rel=1e-6, abs=1e-5), k


@settings(max_examples=300)
@given(FLAT, st.floats(0, 12))
def test_trapezoid_derivatives_are_slopes_between_its_corners(
    flat: dict[str, float], t: float
) -> None:
    signal = make_signal('trapezoid', flat)
    rows = [at(signal, t + i * 0.01) for i in (-3, -2, -1, 0, 1, 2, 3)]
    assume(len({row[2] for row in rows}) == 1)
    assume(away(t, flat['start_time']))
    values = at(signal, t)
    found = slopes(signal, t)
    assert values[1] == pytest.approx(found[0], abs=1e-9)
    assert values[2] == pytest.approx(found[1], abs=1e-9)
    assert values[3:] == [0.0] * 3


@given(FLAT, st.floats(0, 40), st.floats(0, 1))
def test_trapezoid_keeps_its_limits_and_arrives(
    flat: dict[str, float], t: float, step: float
) -> None:
    signal = make_signal('trapezoid', flat)
    distance = flat['amplitude']
    now, later = at(signal, t), at(signal, t + step)
    assert abs(now[1]) <= flat['velocity'] * (1 + 1e-12)
    assert abs(now[2]) in (0.0, flat['acceleration'])
    assert (later[0] - now[0]) * distance >= -1e-12
    assert abs(later[0] - now[0]) <= flat['velocity'] * step + 1e-12
    end = flat['start_time'] + abs(distance) / flat['velocity']
    end += (
        flat['velocity'] / flat['acceleration'] + 2 * abs(distance / flat['acceleration']) ** 0.5
    )
    assert at(signal, end + 1e-6)[:2] == [flat['offset'] + distance, 0.0]


def test_trapezoid_closed_form() -> None:
    long = make_signal('trapezoid', {'amplitude': -6.0, 'velocity': 2.0, 'acceleration': 1.0})
    assert at(long, 1.0, 3) == [-0.5, -1.0, -1.0]
    assert at(long, 2.5, 3) == [-3.0, -2.0, 0.0]
    assert at(long, 4.0, 3) == [-5.5, -1.0, 1.0]
    assert at(long, 5.0, 3) == [-6.0, 0.0, 0.0]
    short = make_signal('trapezoid', {'amplitude': 1.0, 'velocity': 9.0, 'acceleration': 4.0})
    assert at(short, 0.25, 3) == [0.125, 1.0, 4.0]
    assert at(short, 0.75, 3) == [0.875, 1.0, -4.0]
    assert at(short, 1.0, 3) == [1.0, 0.0, 0.0]


@given(st.sampled_from(sorted(SIGNALS)), FLAT, st.floats(0, 12))
def test_a_short_buffer_gets_the_first_derivatives(
    name: str, flat: dict[str, float], t: float
) -> None:
    signal = make_signal(name, flat)
    full = at(signal, t)
    for count in range(1, MAX_DERIVATIVES):
        assert at(signal, t, count) == full[:count]


@given(st.sampled_from(sorted(set(SIGNALS) - {'none'})), FLAT, st.floats(1e-6, 3))
def test_before_the_start_there_is_only_the_offset(
    name: str, flat: dict[str, float], early: float
) -> None:
    signal = make_signal(name, flat)
    assert at(signal, flat['start_time'] - early) == [flat['offset']] + [0.0] * 5


def test_the_disturbance_of_the_paper_is_the_default_decaying_cosine() -> None:
    w = make_signal('decaying_cosine', {})
    for t in (0.0, 0.3, 1.0, 5.0, 40.0):
        assert at(w, t, 1)[0] == exp(-t) * cos(t)
        assert at(w, t, 2)[1] == pytest.approx(-exp(-t) * (cos(t) + sin(t)), rel=1e-14)


def test_the_reference_of_the_paper() -> None:
    reference = make_signal('cosine', {'frequency': 0.5})
    for t in (0.0, 0.3, 7.0):
        expected = [cos(0.5 * t), -0.5 * sin(0.5 * t), -0.25 * cos(0.5 * t)]
        assert at(reference, t, 3) == pytest.approx(expected, rel=1e-15)


def test_chirp_goes_on_at_the_end_frequency_without_a_jump() -> None:
    chirp = make_signal('chirp', {'frequency': 1.0, 'end_frequency': 3.0, 'sweep_time': 2.0})
    before, after = at(chirp, 2.0 - 1e-9, 2), at(chirp, 2.0, 2)
    assert after == pytest.approx(before, abs=1e-7)
    assert after == pytest.approx([sin(4.0), 3.0 * cos(4.0)], rel=1e-14)
    assert at(chirp, 2.5, 3) == pytest.approx(
        [sin(5.5), 3.0 * cos(5.5), -9.0 * sin(5.5)], rel=1e-14
    )


def test_a_chirp_that_does_not_sweep_is_a_sine() -> None:
    same = {'frequency': 2.0, 'end_frequency': 2.0, 'phase': 0.4, 'start_time': 0.1}
    for t in (0.05, 0.1, 3.0, 30.0):
        found = at(make_signal('chirp', same), t)
        assert found == pytest.approx(at(make_signal('sine', same), t), abs=1e-12)


def test_jumps() -> None:
    step = make_signal('step', {'start_time': 1.0, 'offset': 0.5, 'amplitude': -2.0})
    assert [at(step, t)[0] for t in (0.0, 0.999, 1.0, 9.0)] == [0.5, 0.5, -1.5, -1.5]
    square = make_signal('square', {'frequency': pi, 'offset': 1.0, 'amplitude': 2.0})
    assert [at(square, t)[0] for t in (0.0, 0.9, 1.1, 1.9, 2.1)] == [3.0, 3.0, -1.0, -1.0, 3.0]
    sine = make_signal('sine', {'frequency': pi})
    for k in range(1, 1000):
        t = 0.0371 * k
        assert (at(square, t)[0] > 1.0) == (at(sine, t)[0] > 0.0)
    assert at(square, 1.0)[1:] == at(step, 1.0)[1:] == [0.0] * 5


def test_one_word_means_one_thing() -> None:
    union = signal_fields()
    for name, cls in SIGNALS.items():
        for field, declaration in declared(cls).items():
            assert declaration == union[field], (name, field)


def test_every_field_of_a_signal_matters() -> None:
    for name, cls in SIGNALS.items():
        if name == 'none':
            continue
        base = {'start_time': 0.3, 'amplitude': 7.0, 'sweep_time': 2.0}
        for field, declaration in declared(cls).items():
            other = {**base, field: base.get(field, declaration.default) + 0.37}
            changed = [
                at(make_signal(name, base), 0.13 * k) != at(make_signal(name, other), 0.13 * k)
                for k in range(100)
            ]
            assert any(changed), (name, field)


def test_make_signal_picks_its_own_fields_and_refuses_unknown_ones() -> None:
    everything = {name: field.default for name, field in signal_fields().items()}
    for name, cls in SIGNALS.items():
        assert make_signal(name, everything) == cls()
    with pytest.raises(SettingError, match='ampitude'):
        make_signal('sine', {'ampitude': 1.0})
    with pytest.raises(SettingError, match='amplitude = nan'):
        make_signal('sine', {'amplitude': float('nan')})
    with pytest.raises(SettingError, match=r'signal = .sinus.*decaying_cosine'):
        make_signal('sinus', {})
    with pytest.raises(SettingError, match='slope'):
        build(SIGNALS['sine'], {'slope': 1.0})


def compiled(value: Any, method: str) -> tuple[Any, Any]:
    """Return the method under numba and its object as a named tuple of the same fields."""
    numba = pytest.importorskip('numba')
    return numba.njit(getattr(type(value), method)), fields_of(value)


@pytest.mark.parametrize('name', SIGNALS)
def test_compiled_signals_give_the_same_bits(name: str) -> None:
    import numpy as np

    signal = make_signal(name, {'start_time': 0.5, 'frequency': 1.7, 'sweep_time': 4.0})
    function, record = compiled(signal, 'derivatives')
    out = np.zeros(MAX_DERIVATIVES)
    for k in range(200):
        function(record, 0.0437 * k, out)
        assert out.tolist() == at(signal, 0.0437 * k)
