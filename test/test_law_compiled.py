"""One source, two speeds: compiled by numba the law gives the same bits as in plain Python."""

from __future__ import annotations

import random
from typing import Any

from law_helpers import design_of, NAN, state_bits, varied_settings
from nadrc_ros.adrc import tick as law
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.adrc.status import Mode
from nadrc_ros.adrc.supervisor import PolicyState, Stall
from nadrc_ros.simulation.compiled import share_law
from nadrc_ros.simulation.kernel import tuple_of
import numba
import numpy as np
import pytest

ALL: dict[str, Any] = {
    'b0': -2.0,
    'b0_table': (-1.0, -0.5, 0.5, -2.0, 1.0, -1.0),
    'measurement_period': 0.5,
    'input_delay': 0.0237,
    'plant_poles': (-3.0, 0.0),
    'disturbance_frequencies': (30.0, 7.0),
    'error_deadband': 0.2,
    'command_rate_limit': 400.0,
}
CASES = varied_settings() | {
    'all': ALL,
    'all-error': ALL | {'error_based': True, 'structure': 'printed', 'feedback': 'fal'},
}
TICKS = 5000


@pytest.fixture(scope='module')
def compiled() -> Any:
    share_law()

    def alone(*arguments: Any) -> Any:  # calls the one that the loops call
        return law.tick(*arguments)

    return numba.njit(alone)


@pytest.mark.parametrize('case', CASES)
def test_p18_compiled_and_plain_give_the_same_bits(case: str, compiled: Any) -> None:
    """
    Over jittered ticks with bad samples, lost references, gaps and an enable switch at work.

    And now and then with reports of what acts, and feed-forward.
    """
    design = design_of(**CASES[case], reference_timeout=0.05, max_dt=0.1)
    runs = [run(design, law.tick, plain=True), run(design, compiled, plain=False)]
    assert runs[0] == runs[1]
    commands, modes, states = runs[0]
    assert len(set(commands)) > 5 and len(set(states)) > TICKS / 20
    assert set(modes) >= {Mode.OK, Mode.RAMPING, Mode.SAFE}


def run(design: Any, tick: Any, *, plain: bool) -> tuple[list[str], list[int], list[str]]:
    n = design.order
    state, out = blank_state(design), blank_state(design)
    reference: Any = [0.0] * (n + 1)
    if not plain:
        design, state, out = map(tuple_of, (design, state, out))
        reference = np.zeros(n + 1)
    policy, u, y = PolicyState(), 0.0, 0.0
    rng, others = random.Random(1), random.Random(2)
    commands: list[str] = []
    modes: list[int] = []
    states: list[str] = []
    for k in range(TICKS):
        h = 0.005 * (1 + 0.3 * rng.uniform(-1, 1)) if rng.random() > 0.01 else 0.2
        referenced = rng.random() > 0.2 and k % 500 > 50
        if referenced:
            for i in range(n + 1):
                reference[i] = rng.gauss(0.0, 1.0) if i < 2 else 0.0
        measured = rng.random() > 0.05 and k % 300 > 60
        enabled = k % 700 > 100
        y += 0.01 * rng.gauss(0.0, 1.0)
        sample = Sample(y if measured else NAN, h, h, h * rng.random(), u)
        if k % 900 > 450:  # somebody says what acts, and what is known of the load
            acting, fed = 0.7 * u + others.random(), others.gauss(0.0, 0.1)
            sample = sample._replace(
                applied=acting,
                applied_age=h * others.random(),
                sent=u,
                feed_forward=fed,
                downstream=acting + 0.1 * others.random(),
                foreign=others.random() > 0.5,
            )
        u, _, policy = tick(design, state, policy, sample, reference, referenced, enabled, out)
        assert isinstance(policy, PolicyState) and isinstance(policy.stall, Stall)
        state, out = out, state
        commands.append(float(u).hex())
        modes.append(policy.mode)
        if k % 10 == 0:
            states.append(str(state_bits(state)))
    return commands, modes, states
