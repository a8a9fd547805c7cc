"""Ten million steps of the law under random faults: nothing is left behind by any of them."""

from __future__ import annotations

from collections.abc import Iterator
import gc
from math import copysign
from random import Random
import sys
from typing import Any

from law_helpers import Chain, fixed_of, INF, NAN, varied_settings
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST
from nadrc_ros.adrc.state import State
from nadrc_ros.adrc.status import Mode, Status
import pytest

STEPS = {True: 10_000_000, False: 30_000}
H = 0.002
CASES = varied_settings()
VALUES = (NAN, INF, -INF, 1e308, -1e308, 1e99, 5e-324, -0.0, 1e6, -1e6)
SPANS = (NAN, INF, -INF, 0.0, -H, 1e-12, 5e-324, 0.1, 10.0, 1e9)
# Every one of these is a step with a fault: on average every fiftieth.
RATE = 0.02
KINDS = ('y', 'dt', 'elapsed', 'reference', 'applied', 'silence', 'enable', 'reset', 'retune')
# So many objects may be more than at half time: counters beyond small integers.
SPARE = 100


def random_settings(rng: Random, now: ControllerSettings) -> ControllerSettings:
    """Return the settings of a random case for the plant of ``now``, with random limits."""
    order = now.plant_order
    names = [name for name, case in CASES.items() if case.get('plant_order', 2) == order]
    changes = {
        'command_min': -rng.uniform(1.0, 30.0),
        'command_max': rng.uniform(1.0, 30.0),
        'reference_timeout': rng.choice((0.0, 0.1)),
        'b0': copysign(rng.uniform(0.1, 10.0), now.b0),
    }
    return ControllerSettings(**CASES[rng.choice(names)] | changes | fixed_of(now))


class Faulty:
    """A controller in a loop with a plant, and what goes wrong in it."""

    def __init__(self, settings: ControllerSettings, rng: Random) -> None:
        self.controller = Controller(settings)
        self._chain = Chain(settings.plant_order)
        self._rng = rng
        self._silent = 0
        self._first = settings

    def step(self) -> None:
        """Do one step, at random with a fault, and check the command."""
        fault = self._rng.choice(KINDS) if self._rng.random() < RATE else ''
        self._act(fault)
        values: dict[str, Any] = {'measurement': self._chain.y, 'dt': H, 'reference': [1.0, 0.0]}
        if self._silent:
            self._silent -= 1
            values |= {'measurement': NAN, 'dt': 0.0, 'elapsed': H}
        if fault in ('y', 'dt', 'elapsed', 'reference', 'applied'):
            values |= self._spoilt(fault)
        command = self.controller.tick(**values)
        settings = self.controller.settings
        assert settings.command_min <= command <= settings.command_max, (fault, values)
        self._chain.advance(settings.b0 * command + 0.5, H)
        if not abs(self._chain.y) < 1e6:
            self._chain = Chain(settings.plant_order)

    def _act(self, fault: str) -> None:
        if fault == 'silence':
            self._silent = self._rng.randrange(400)
        elif fault == 'enable':
            self.controller.enabled = not self.controller.enabled
        elif fault == 'reset':
            self.controller.reset()
        elif fault == 'retune':
            self.controller.retune(random_settings(self._rng, self.controller.settings))

    def _spoilt(self, fault: str) -> dict[str, Any]:
        value, span = self._rng.choice(VALUES), self._rng.choice(SPANS)
        spoilt: dict[str, dict[str, Any]] = {
            'y': {'measurement': value},
            'dt': {'dt': span},
            'elapsed': {'elapsed': span},
            'reference': {'reference': self._rng.choice(([value], [1.0, value], [], None))},
            'applied': {'applied': value},
        }
        return spoilt[fault]

    def recover(self) -> None:
        """Let it be well for a while with its first settings, and check that it is in control."""
        self.controller.enabled = True
        self.controller.retune(self._first)
        for _ in range(10):
            self.controller.tick(0.1, H, reference=[0.2])
        assert self.controller.mode == Mode.OK
        assert self.controller.status < Status.NO_MEASUREMENT


@pytest.fixture(autouse=True, scope='module')
def only_what_is_new() -> Iterator[None]:
    """To look through what all other tests left would take twice as long as these do."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


def objects() -> int:
    gc.collect()
    return sys.getallocatedblocks()


def bounded(state: State) -> bool:
    rows = [*state.levels, state.profile, state.offset, state.startup]
    return all(abs(x) < HIGHEST for row in rows for x in row)


@pytest.mark.parametrize('case', CASES)
def test_p20_steps_under_random_faults_leave_nothing_behind(
    case: str, soak: bool, seed: int
) -> None:
    loop = Faulty(ControllerSettings(**CASES[case]), Random(f'{seed} {case}'))
    steps = STEPS[soak] // len(CASES)
    held = 0
    for k in range(steps):
        loop.step()
        if k % 1000 == 0:
            assert bounded(loop.controller.state)
        if k == steps // 2:
            loop.recover()
            held = objects()
    loop.recover()
    grown = objects() - held
    print(f'{steps} steps, {grown} objects more than at half time')
    assert grown < SPARE
