"""One law, several machines: what numba compiles of it gives the same bits as plain Python."""

from __future__ import annotations

from ctypes import c_double, POINTER
import random
from typing import Any

from law_helpers import NAN, state_bits, varied_settings
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.adrc.status import Mode
from nadrc_ros.adrc.tick import tick
from nadrc_ros.simulation import period
from nadrc_ros.simulation.compiled import compiled_law
from nadrc_ros.simulation.kernel import Running
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
# Each is compiled anew; test_specialise goes through all of them in plain Python.
CHOSEN = 'nonlinear-2', 'error-td-fal', 'cascade-ratios'
CASES = {name: varied_settings()[name] for name in CHOSEN} | {'all': ALL}
TICKS = 3000


@pytest.mark.parametrize('case', CASES)
def test_p18_compiled_and_plain_give_the_same_bits(case: str) -> None:
    """
    Over jittered ticks with bad samples, lost references, gaps and an enable switch at work.

    And now and then with reports of what acts, and feed-forward. Periods that are left to plain
    Python are few.
    """
    settings = ControllerSettings(**CASES[case], reference_timeout=0.05, max_dt=0.1)
    plain, compiled = Controller(settings), Controller(settings)
    law = compiled_law(plain.design)['period']
    modes, commands, done = set[int](), set[float](), 0
    for sample, reference, enabled in stream(plain):
        one, fast = Running(compiled), blank_state(compiled.design)
        design, state, out, told, gives = one.parts
        told[: period.REFERENCED] = sample
        told[period.REFERENCED], told[period.ENABLED] = reference is not None, enabled
        for each in (plain, compiled):
            each.reference[:] = reference or each.reference
        one.reference[:] = reference or one.reference
        vectors = design, state, one.reference, told, out, gives
        law.ctypes(*(each.ctypes.data_as(POINTER(c_double)) for each in vectors))
        done += gives[period.LEFT] == 0.0
        for each in (plain, compiled):
            if each is plain or gives[period.LEFT] > 0.0:
                u, _, each.policy = tick(
                    *(each.design, each.state, each.policy, sample, each.reference),
                    *(reference is not None, enabled, fast),
                )
                each.state, fast, each.command = fast, each.state, u
            else:
                one.give_back(1)
        assert plain.command.hex() == compiled.command.hex()
        assert repr(plain.policy) == repr(compiled.policy)
        assert state_bits(plain.state) == state_bits(compiled.state)
        modes.add(plain.policy.mode)
        commands.add(plain.command)
    assert len(commands) > 5 and modes >= {Mode.OK, Mode.RAMPING, Mode.SAFE}
    assert done > 0.8 * TICKS


def stream(controller: Controller) -> Any:
    """Yield samples, references, and whether it is enabled."""
    n, y = controller.design.order, 0.0
    rng, others = random.Random(1), random.Random(2)
    for k in range(TICKS):
        h = 0.005 * (1 + 0.3 * rng.uniform(-1, 1)) if rng.random() > 0.01 else 0.2
        reference = None
        if rng.random() > 0.2 and k % 500 > 50:
            reference = [rng.gauss(0.0, 1.0) if i < 2 else 0.0 for i in range(n + 1)]
        measured = rng.random() > 0.05 and k % 300 > 60
        y += 0.01 * rng.gauss(0.0, 1.0)
        u = controller.command
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
        yield sample, reference, k % 700 > 100
