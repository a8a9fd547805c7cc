"""Ticks that jitter or never come: the observers use the dt that was, not the one meant."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, exp, sin
import random

from law_helpers import design_of, Law, NAMES
import pytest

H = 0.01
DURATION = 20.0
A3 = 0.1
DEVIATION = 0.01  # of the noise, variance 1e-4


def slope(t: float, x: tuple[float, float], u: float) -> tuple[float, float]:
    """Eq. (26) of the paper with the disturbance exp(-t) cos t."""
    force = 0.2 * x[0] + 0.1 * sin(x[1]) + exp(-t) * cos(t) + (1.0 + A3 * sin(t)) * u
    return x[1], force


def advance(t: float, x: tuple[float, float], u: float, h: float) -> tuple[float, float]:
    steps = max(1, round(h / H))
    h /= steps
    for _ in range(steps):
        a = slope(t, x, u)
        b = slope(t + h / 2, (x[0] + h / 2 * a[0], x[1] + h / 2 * a[1]), u)
        c = slope(t + h / 2, (x[0] + h / 2 * b[0], x[1] + h / 2 * b[1]), u)
        d = slope(t + h, (x[0] + h * c[0], x[1] + h * c[1]), u)
        x = (
            x[0] + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0]),
            x[1] + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1]),
        )
        t += h
    return x


def periods(rng: random.Random, disturbed: bool) -> Iterator[float]:
    """Yield 10 ms, or that with +-30 % of jitter and 5 % of ticks that begin a drop of 1 to 5."""
    while True:
        ticks = 1 + (rng.randint(1, 5) if disturbed and rng.random() < 0.05 else 0)
        yield sum(H * (1 + (rng.uniform(-0.3, 0.3) if disturbed else 0.0)) for _ in range(ticks))


def isu(
    structure: str,
    seed: int,
    disturbed: bool,
    told: float | None = None,
    deviation: float = DEVIATION,
) -> float:
    """Return the integral of u^2; ``told`` is the dt that the law is given instead of the true."""
    law = Law(
        design_of(
            structure=structure,
            levels=1,
            extended_states=1,
            inner_bandwidth=40.0,
            outer_bandwidth=10.0,
            controller_bandwidth=4.0,
        )
    )
    rng, noise = random.Random(seed), random.Random(seed + 1000)
    t, x, total, before = 0.0, (0.0, 0.0), 0.0, H
    for h in periods(rng, disturbed):
        if t >= DURATION:
            break
        y = x[0] + noise.gauss(0.0, deviation)
        u = law.step([cos(0.5 * t)], y, told or before)
        x = advance(t, x, u, h)
        total += u * u * h
        t, before = t + h, h
    return total


SEEDS = range(5)


def mean_isu(disturbed: bool, told: float | None, deviation: float) -> float:
    runs = [isu('conventional', seed, disturbed, told, deviation) for seed in SEEDS]
    return sum(runs) / len(runs)


@pytest.mark.parametrize(('deviation', 'worse'), ((0.0, 2.0), (DEVIATION, 1.2)))
def test_the_effort_with_dropped_ticks_is_that_of_the_undisturbed_run(
    deviation: float, worse: float
) -> None:
    """Noise costs the same effort on both sides, so that ratios are clearer without."""
    undisturbed = mean_isu(False, None, deviation)
    measured = mean_isu(True, None, deviation)
    fixed = mean_isu(True, H, deviation)
    assert measured < 1.3 * undisturbed
    assert fixed > worse * measured


@pytest.mark.parametrize('structure', NAMES)
def test_no_structure_suffers_from_dropped_ticks(structure: str) -> None:
    assert isu(structure, 3, True) < 1.4 * isu(structure, 3, False)
