"""Predicted stability and margins against the real law around a sampled plant."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

from law_helpers import design_of
from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.loop import chain, closed_loop, loop_growth
from nadrc_ros.theory.margins import margins
from nadrc_ros.theory.system import poles, StateSpace
import numpy as np
import pytest
from theory_helpers import LINEAR, Loop, response, simulated_stable, wide_design

H = 0.01
# A motor with a slow and a fast time constant, and a flexible one with little damping: no chains.
MOTOR = chain(2, 3.0, (0.0, 2.0))
FLEXIBLE = StateSpace(
    np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 40.0], [-30.0, 0.0, -8.0]]),
    np.array([[0.0], [0.0], [1.0]]),
    np.array([[30.0, 0.0, 0.0]]),
    np.zeros((1, 1)),
)


def loop_design(structure: str, n: int, wh: float, **values: Any) -> Any:
    w = wh / H
    own = {'inner_bandwidth': w, 'outer_bandwidth': 0.7 * w, 'controller_bandwidth': 0.15 * w}
    return wide_design(structure=structure, plant_order=n, **own | values)


@pytest.mark.parametrize('n', (1, 2, 3))
@pytest.mark.parametrize('structure', LINEAR)
def test_predicted_and_simulated_stability_agree(structure: str, n: int) -> None:
    """Over w h and b0 error; points within 1e-3 of the limit are left out."""
    stable = unstable = 0
    for wh in (0.1, 0.3, 0.8, 1.6):
        design = loop_design(structure, n, wh, b0=-2.0)
        for ratio in (-0.5, 0.05, 0.15, 0.4, 0.7, 1.0, 1.5, 2.2, 3.5, 5.5, 9.0, 15.0):
            plant = chain(n, ratio * -2.0)
            growth = loop_growth(design, plant, H)
            if abs(growth - 1.0) < 1e-3:
                continue
            assert simulated_stable(design, plant, H, abs(growth - 1.0)) == (growth < 1.0), (
                wh,
                ratio,
                growth,
            )
            stable, unstable = stable + (growth < 1.0), unstable + (growth > 1.0)
    assert stable >= 10 and unstable >= 10


@pytest.mark.parametrize('structure', LINEAR)
def test_so_they_do_for_other_plants_and_with_a_delay(structure: str) -> None:
    seen = set()
    for plant in (MOTOR, FLEXIBLE):
        for wh in (0.1, 0.4, 1.0):
            for delay in (0.0, 0.013, 0.04):
                design = loop_design(structure, 2, wh, b0=3.0, controller_bandwidth=4.0)
                growth = loop_growth(design, plant, H, delay)
                if abs(growth - 1.0) > 1e-3:
                    found = simulated_stable(design, plant, H, abs(growth - 1.0), delay)
                    assert found == (growth < 1.0), (wh, delay, growth)
                    seen.add(found)
    assert seen == {True, False}


@pytest.mark.parametrize('structure', LINEAR)
def test_the_poles_with_the_right_gain_are_those_of_observer_and_law(structure: str) -> None:
    """The separation principle, with the law's own poles of the sampled chain."""
    design = loop_design(structure, 2, 0.2, b0=2.0, pole_ratios=(1.0,))
    found = poles(closed_loop(design, chain(2, 2.0), H))
    k1, k2 = design.feedback_gains
    a = np.array([[1.0, H], [0.0, 1.0]]) - np.outer([H * H / 2.0, H], [k1, k2])
    for pole in np.linalg.eigvals(a):
        assert np.abs(found - pole).min() < 1e-4
    assert loop_growth(design, chain(2, 2.0), H) == pytest.approx(
        max(np.abs(np.linalg.eigvals(a))), abs=1e-4
    )


def gain_interval(
    design: Design,
    plant: StateSpace,
    h: float,
    delay: float = 0.0,
    reach: float = 1e3,
    points: int = 40,
) -> tuple[float, float]:
    """
    Return the factors on the gain of ``plant``, around 1, between which the loop is stable.

    With a plant of gain b0 they are the admissible b / b0: of the law only this ratio matters.
    The ends are found by a scan outwards, ``points`` per decade up to ``reach``, then bisection;
    0 and inf where it found none. (1, 1) when the loop is unstable as it is. An instability
    narrower than the scan is missed; ``margins`` finds the same ends from the frequency response.
    """

    def stable(factor: float) -> bool:
        return loop_growth(design, plant._replace(b=factor * plant.b), h, delay) < 1.0

    if not stable(1.0):
        return 1.0, 1.0
    ratio = 10.0 ** (1.0 / points)
    low = _edge(stable, 1.0 / ratio, 1.0 / reach)
    high = _edge(stable, ratio, reach)
    return 0.0 if low is None else low, inf if high is None else high


def _edge(stable: Callable[[float], bool], ratio: float, end: float) -> float | None:
    inside = 1.0
    while abs(np.log(inside)) < abs(np.log(end)):
        outside = inside * ratio
        if not stable(outside):
            for _ in range(50):
                middle = (inside * outside) ** 0.5
                if stable(middle):
                    inside = middle
                else:
                    outside = middle
            return inside
        inside = outside
    return None


@pytest.mark.parametrize('n', (1, 2, 3))
@pytest.mark.parametrize('structure', LINEAR)
def test_margins_and_scan_find_the_same_gains(structure: str, n: int) -> None:
    design, plant = loop_design(structure, n, 0.3, b0=2.0), chain(n, 2.0)
    low, high = gain_interval(design, plant, H)
    found = margins(design, plant, H)
    assert (found.gain_low, found.gain_high) == pytest.approx((low, high), rel=1e-6, abs=2e-3)
    assert 0.0 <= low < 1.0 < high < np.inf
    for edge, sign in ((low, -1.0), (high, 1.0)):
        if edge > 0.0:
            inside, outside = ((1.0 - sign * step) * edge for step in (0.02, -0.02))
            assert loop_growth(design, chain(n, 2.0 * inside), H) < 1.0
            assert loop_growth(design, chain(n, 2.0 * outside), H) > 1.0


@pytest.mark.parametrize('structure', LINEAR)
@pytest.mark.parametrize('plant', (chain(2, 3.0), MOTOR), ids=('chain', 'motor'))
def test_the_delay_margin_is_where_the_loop_breaks(structure: str, plant: StateSpace) -> None:
    design = loop_design(structure, 2, 0.2, b0=3.0)
    delay = margins(design, plant, H).delay
    assert loop_growth(design, plant, H, 0.98 * delay) < 1.0
    assert loop_growth(design, plant, H, 1.02 * delay) > 1.0
    whole = int(delay / H)
    assert whole >= 1
    assert (
        loop_growth(design, plant, H, whole * H)
        < 1.0
        < loop_growth(design, plant, H, (whole + 1) * H)
    )
    left = margins(design, plant, H, whole * H).delay
    assert left == pytest.approx(delay - whole * H, rel=1e-6)


@pytest.mark.parametrize(
    ('resonance', 'sign', 'delay'), ((40.0, 1.0, 0.0), (80.0, -1.0, 0.01)), ids=('last', 'first')
)
def test_the_delay_margin_is_of_the_crossing_that_breaks_first(
    resonance: float, sign: float, delay: float
) -> None:
    """
    A resonance lifts |L| above 1 again, far above the crossover: once there, once not the first.

    There the first of its two crossings is past -180 degrees, so that little less delay would
    destabilise, but it takes nearly a turn more.
    """
    a = np.zeros((4, 4))
    a[0, 1] = a[2, 3] = 1.0
    a[3, 2:] = [-(resonance**2), -0.3]
    b, c = [[0.0], [1.0], [0.0], [1.0]], [[1.0, 0.0, sign, 0.0]]
    plant = StateSpace(a, np.array(b), np.array(c), np.zeros((1, 1)))
    design, h = design_of(inner_bandwidth=60.0, outer_bandwidth=40.0, levels=1), 0.001
    found = margins(design, plant, h, delay)
    assert found.crossover > 35.0
    if sign > 0.0:
        assert found.delay < found.phase / 20.0
    else:
        assert found.delay > 5.0 * found.phase / found.crossover
    assert loop_growth(design, plant, h, delay + 0.97 * found.delay) < 1.0
    assert loop_growth(design, plant, h, delay + 1.03 * found.delay) > 1.0


def test_margins_are_consistent() -> None:
    for structure in LINEAR:
        design, plant = loop_design(structure, 2, 0.3), chain(2, 1.0)
        found = margins(design, plant, H)
        s = found.modulus  # what a modulus margin guarantees
        assert found.gain_high >= 1.0 / (1.0 - s) - 1e-9 and found.gain_low <= 1.0 / (1.0 + s)
        assert found.phase >= 2.0 * np.arcsin(s / 2.0) - 1e-9
        assert found.delay * found.crossover > 0.0
        system = closed_loop(design, plant, H)
        omega = np.geomspace(0.1, np.pi / H, 4000)
        # u / load is -T, so the sensitivity is 1 + that.
        sensitivity = np.abs(1.0 + response(system, omega)[:, 1, 1])
        assert sensitivity.max() == pytest.approx(1.0 / s, rel=1e-4)
    unstable = margins(loop_design('nested', 2, 0.3), chain(2, 50.0), H)
    assert unstable == (1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    assert gain_interval(loop_design('nested', 2, 0.3), chain(2, 50.0), H) == (1.0, 1.0)


@pytest.mark.parametrize('feedback', ('linear', 'fal'))
@pytest.mark.parametrize('error_based', (False, True))
@pytest.mark.parametrize('structure', LINEAR)
def test_the_closed_loop_is_the_real_one(structure: str, error_based: bool, feedback: str) -> None:
    """Step response of the real law, plant by plant sample, against the matrices; tiny for fal."""
    size = 1e-6
    design = loop_design(
        structure, 2, 0.3, b0=3.0, error_based=error_based, feedback=feedback, fal_delta=0.5
    )
    real = Loop(design, MOTOR, H, 0.013, start=0.0)
    outputs = real.run(300, [size])
    system = closed_loop(design, MOTOR, H, 0.013)
    x, expected = np.zeros(len(system.a)), []
    for _ in range(300):
        expected.append(system.c[0] @ x)
        x = system.a @ x + system.b[:, 2] * size
    assert np.abs(outputs - expected).max() < 1e-10 * max(np.abs(expected).max(), size)
    assert np.abs(expected).max() > 0.5 * size
