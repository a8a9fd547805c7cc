"""Theory of a law that knows the dead time of its plant, against the law itself in simulation."""

from __future__ import annotations

from itertools import product
from typing import Any

import attrs
from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.theory.delayed import (
    command_variance,
    delayed_loop,
    is_stable_loop,
    REFERENCE,
    step_responses,
)
from nadrc_ros.theory.loop import chain, loop_growth
from nadrc_ros.theory.margins import margins
from nadrc_ros.theory.model import controller
from nadrc_ros.tuning.design.candidates import candidates
from nadrc_ros.tuning.design.limits import fastest
from nadrc_ros.tuning.design.requirements import Requirements
import numpy as np
import pytest
from theory_helpers import Loop, simulated_stable, WIDE, wide_design

H = 0.01
DELAY = 5.0 * H
KNOWING: dict[str, Any] = {
    'inner_bandwidth': 15.0,
    'outer_bandwidth': 15.0,
    'controller_bandwidth': 3.0,
    'input_delay': 0.0437,
}
# Nearer to the edge of stability it takes too long to see on which side a run is.
EDGE = 0.01


def late_design(
    n: int, structure: str, w: float, input_delay: float, ratio: float = 5.0
) -> Design:
    return wide_design(
        plant_order=n,
        structure=structure,
        inner_bandwidth=w,
        outer_bandwidth=w,
        controller_bandwidth=w / ratio,
        input_delay=input_delay,
    )


@pytest.mark.parametrize('structure', ('conventional', 'nested', 'cascade'))
def test_predicted_and_simulated_stability_agree(structure: str) -> None:
    """Over bandwidths and delays of plant and law, right and wrong ones, fractions too."""
    bandwidths = np.geomspace(5.0, 120.0, 5)
    delays = ((5.0, 5.0), (5.0, 0.0), (5.0, 4.0), (5.0, 6.0), (2.3, 2.3), (0.0, 3.6))
    seen = []
    for n, w, (late, told) in product((1, 2), bandwidths, delays):
        design = late_design(n, structure, w, told * H)
        growth = loop_growth(design, chain(n, 1.0), H, late * H)
        predicted = is_stable_loop(delayed_loop(design, chain(n, 1.0), H, late * H))
        assert predicted == (growth < 1.0)
        if abs(growth - 1.0) > EDGE:
            seen.append(predicted)
            found = simulated_stable(design, chain(n, 1.0), H, abs(growth - 1.0), late * H)
            assert found == predicted, (n, w, late, told)
    assert len(seen) > 45 and 10 < sum(seen) < len(seen) - 10


def largest(n: int, structure: str, input_delay: float, ratio: float = 5.0) -> float:
    """Return the largest observer bandwidth [rad/s] up to which the loop with DELAY is stable."""

    def stable(w: float) -> bool:
        design = late_design(n, structure, w, input_delay, ratio)
        return is_stable_loop(delayed_loop(design, chain(n, 1.0), H, DELAY))

    low = 2.0
    while stable(1.3 * low) and low < 200.0:
        low *= 1.3
    high = 1.3 * low
    for _ in range(8):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


@pytest.mark.parametrize('structure', ('conventional', 'nested'))
@pytest.mark.parametrize('n', (1, 2, 3))
def test_five_periods_of_delay_that_are_known_allow_twice_the_bandwidth(
    n: int, structure: str
) -> None:
    known = largest(n, structure, DELAY)
    assert known >= 2.0 * largest(n, structure, 0.0)
    # What is left is the delay of the feedback: an edge of wc, however fast the observers are.
    assert largest(n, structure, DELAY, 3.0) / 3.0 == pytest.approx(known / 5.0, rel=0.02)


@pytest.mark.parametrize('n', (1, 2, 3))
def test_at_the_advised_bandwidth_a_delay_that_is_a_period_off_leaves_the_loop_stable(
    n: int,
) -> None:
    """Of the fastest design that `nadrc design` allows, in theory and as it runs."""
    wanted, _ = fastest(Requirements(order=n, rate=1.0 / H, delay=DELAY))
    for candidate in candidates(wanted):
        design = attrs.evolve(make_design(candidate.settings), **WIDE)
        assert design.input_delay == DELAY
        for periods in (4, 6):
            delay = periods * H
            assert is_stable_loop(delayed_loop(design, chain(n, 1.0), H, delay))
            assert simulated_stable(design, chain(n, 1.0), H, 0.01, delay)


@pytest.mark.parametrize(
    'known',
    (
        {'plant_poles': (-2.0, 0.0)},
        {'disturbance_frequencies': (9.0,)},
        {'error_based': True, 'levels': 3, 'structure': 'cascade'},
    ),
)
def test_so_are_those_of_a_law_that_knows_more_than_the_delay(known: dict[str, Any]) -> None:
    design = wide_design(**KNOWING | known)
    plant = chain(2, 1.0, [0.0, 2.0] if 'plant_poles' in known else [])
    loop = delayed_loop(design, plant, H, DELAY)
    assert is_stable_loop(loop)
    (response,), _ = step_responses(loop, [REFERENCE], 3.0)
    run = Loop(design, plant, H, DELAY, start=0.0).run(300, [1.0])
    np.testing.assert_allclose(run, response[:300], atol=1e-9)


def test_noise_and_step_response_are_those_of_the_law_that_runs() -> None:
    design = late_design(2, 'nested', 25.0, 0.0437)
    plant = chain(2, 1.0)
    loop = delayed_loop(design, plant, H, DELAY)
    (response,), step = step_responses(loop, [REFERENCE], 3.0)
    run = Loop(design, plant, H, DELAY, start=0.0)
    assert step == pytest.approx(H)
    np.testing.assert_allclose(run.run(300, [1.0]), response[:300], atol=1e-9)
    rng, quiet = np.random.default_rng(1), Loop(design, plant, H, DELAY, start=0.0)
    commands = []
    for _ in range(20_000):
        u = quiet.law.step([0.0], quiet.output + rng.standard_normal(), H)
        quiet.x = [
            sum(a * x for a, x in zip(row, quiet.x)) + b * u for row, b in zip(quiet.a, quiet.b)
        ]
        commands.append(u)
    assert np.std(commands[500:]) == pytest.approx(command_variance(loop) ** 0.5, rel=0.03)


def test_the_margin_of_delay_is_where_the_loop_becomes_unstable() -> None:
    design, plant = late_design(1, 'conventional', 40.0, DELAY), chain(1, 1.0)
    found = margins(design, plant, H, DELAY)
    for share, stable in ((0.98, True), (1.02, False)):
        late = delayed_loop(design, plant, H, DELAY + share * found.delay)
        assert is_stable_loop(late) == stable
        gained = delayed_loop(design, chain(1, share * found.gain_high), H, DELAY)
        assert is_stable_loop(gained) == stable


def test_continuous_time_refuses_a_law_with_a_dead_time() -> None:
    with pytest.raises(ValueError, match='needs a period'):
        controller(late_design(1, 'nested', 10.0, DELAY))
