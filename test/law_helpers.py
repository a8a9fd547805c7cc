"""What the tests of the law share: designs over every structure, exact chains, two-buffer runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import factorial
import random
from typing import Any

import attrs
from hypothesis import settings
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.law import step
from nadrc_ros.adrc.observer import update
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import blank_state, start, State
from nadrc_ros.adrc.structures import STRUCTURES

NAN = float('nan')
INF = float('inf')
ORDERS = (1, 2, 3, 4, 5)
NAMES = tuple(STRUCTURES)


def at_least(cases: int) -> settings:
    """Try so many random cases, whatever is usual; the profile `soak` tries more."""
    deep, usual = settings().max_examples, settings.get_profile('test').max_examples
    return settings(max_examples=max(cases, deep) if deep > usual else cases)


def design_of(**values: Any) -> Design:
    return make_design(ControllerSettings(**values))


def fixed_of(settings: ControllerSettings) -> dict[str, Any]:
    """Return what no live change may change."""
    fields = declared(ControllerSettings).items()
    return {name: getattr(settings, name) for name, field in fields if not field.live}


def bits(values: Sequence[float]) -> list[str]:
    return [float(value).hex() for value in values]


def state_bits(state: State) -> list[list[str]]:
    rows = state.profile, state.offset, state.startup, state.gain, state.resting, state.angle[1:]
    return [bits(row) for row in (*state.levels, *rows, state.ripple)]


def copy_of(state: State) -> State:
    copy: list[Any] = [
        [list(row) if isinstance(row, list) else row for row in getattr(state, field.name)]
        for field in attrs.fields(State)
        if field.init
    ]
    return State(*copy)


def init(design: Design, y: float, u: float, r: float | None = None) -> State:
    """Return the state at rest at y under u; the reference defaults to y."""
    state = blank_state(design)
    start(design, y, u, y if r is None else r, state)
    return state


class Law:
    """`step` over its two buffers."""

    def __init__(
        self, design: Design, y: float = 0.0, u: float = 0.0, r: float | None = None
    ) -> None:
        self.design = design
        self.state = init(design, y, u, r)
        self.next = blank_state(design)
        self.u = u
        self.status = 0

    def step(self, reference: Sequence[float], y: float, h: float) -> float:
        r = [*reference, *[0.0] * (self.design.order + 1 - len(reference))]
        self.u, self.status = step(self.design, self.state, r, y, self.u, h, self.next)
        self.state, self.next = self.next, self.state
        return self.u


class Observer:
    """`update` over its two buffers, from zero."""

    def __init__(self, design: Design) -> None:
        self.design = design
        state, self._out = blank_state(design), blank_state(design)
        self.levels, self._scratch = state.levels, state.scratch
        self._spare = self._out.levels

    def update(self, y: float, u: float, h: float) -> None:
        received = self.design.b0 * u
        update(self.design, self.levels, y, received, h, 1.0, self._spare, self._scratch)
        self.levels, self._spare = self._spare, self.levels

    def disturbance(self) -> float:
        return sum(level[self.design.order] for level in self.levels)


class Chain:
    """y^(n) = push, held over each period: the exact solution."""

    def __init__(self, order: int) -> None:
        self.x = [0.0] * order

    @property
    def y(self) -> float:
        return self.x[0]

    def advance(self, push: float, h: float) -> None:
        z = [*self.x, push]
        self.x = [
            sum(z[j] * h ** (j - i) / factorial(j - i) for j in range(i, len(z)))
            for i in range(len(self.x))
        ]


def run_chain(
    controller: Controller,
    ticks: int,
    h: float = 0.01,
    r: float | None = 1.0,
    disturbance: float = 0.0,
    chain: Chain | None = None,
) -> Iterator[tuple[float, float]]:
    """Yield (y, u) of each tick of the loop around an integrator chain with the right b0."""
    chain = chain or Chain(controller.design.order)
    for _ in range(ticks):
        y = chain.y
        u = controller.tick(y, h, reference=None if r is None else [r])
        yield y, u
        chain.advance(controller.design.b0 * u + disturbance, h)


def varied_settings() -> dict[str, dict[str, Any]]:
    """Settings that between them reach every structure and every branch of the law."""
    common: dict[str, Any] = {'command_min': -20.0, 'command_max': 30.0, 'safe_command': 1.0}
    cases: dict[str, dict[str, Any]] = {
        f'{name}-{n}': {'structure': name, 'plant_order': n} for name in NAMES for n in (1, 2)
    }
    cases |= {
        'one level': {'levels': 1},
        'four levels': {'levels': 4, 'feedback_level': '3', 'b0': -2.0},
        'outer': {'feedback_level': 'outer', 'b0': 0.3},
        'generalized-3': {'structure': 'generalized', 'extended_states': 3, 'plant_order': 3},
        'cascade-fal': {'structure': 'cascade', 'levels': 3, 'feedback': 'fal'},
        'printed-td': {'structure': 'printed', 'tracking_acceleration': 5.0},
        'td-3': {'plant_order': 3, 'tracking_acceleration': 5.0, 'error_based': True},
        'error': {'error_based': True},
        'error-td-fal': {'error_based': True, 'tracking_acceleration': 2.0, 'feedback': 'fal'},
        'ratios': {'pole_ratios': (1.0, 1.3, 0.7)},
        'cascade-ratios': {'structure': 'cascade', 'pole_ratios': (0.5, 2.0, 1.0)},
        'half gain': {'observer_gain_factor': 0.5},
        'rate limit': {'command_rate_limit': 40.0},
        'slow': {'command_rate_limit': 2.0, 'structure': 'printed', 'feedback': 'fal'},
        'delay': {'input_delay': 0.0237, 'command_rate_limit': 40.0},
        'long delay': {'input_delay': 0.8, 'plant_order': 1, 'structure': 'cascade'},
        'angle': {'measurement_period': 0.5, 'command_rate_limit': 200.0},
        'error-angle': {'measurement_period': 1.0, 'error_based': True, 'plant_order': 1},
        'angle-td': {'measurement_period': 2.0, 'tracking_acceleration': 5.0, 'levels': 3},
        'table': {'b0_table': (-1.0, 0.5, 0.5, 2.0, 1.0, 1.0)},
        'table-td': {
            'b0_table': (0.0, -1.0, 2.0, -3.0),
            'b0_source': 'reference',
            'b0': -2.0,
            'tracking_acceleration': 5.0,
        },
        'deadband': {'error_deadband': 2.0},
        'known poles': {'plant_poles': (-3.0, 0.0)},
        'known lags': {
            'structure': 'cascade',
            'plant_poles': (-0.5, -3.0, 1.0),
            'plant_order': 3,
            'error_based': True,
            'feedback': 'fal',
            'pole_ratios': (1.0, 1.3, 0.7),
        },
        'vibration': {'disturbance_frequencies': (30.0,), 'pole_ratios': (1.0, 1.3, 0.7)},
        'vibrations': {
            'disturbance_frequencies': (30.0, 7.0),
            'plant_poles': (-0.5,),
            'plant_order': 1,
            'structure': 'printed',
            'observer_gain_factor': 0.5,
            'error_based': True,
            'input_delay': 0.008,
        },
        'vibration-generalized': {
            'disturbance_frequencies': (12.0,),
            'plant_poles': (-1.0, 0.0),
            'b0': -2.0,
            'structure': 'generalized',
            'tracking_acceleration': 2.0,
        },
        'vibration-nonlinear': {
            'disturbance_frequencies': (12.0, 31.0, 3.0),
            'feedback_level': 'outer',
            'structure': 'nonlinear',
            'eso_delta': 0.1,
        },
        'narrow': {'command_min': -1.5, 'command_max': 1.5, 'error_based': True},
    }
    return {name: common | case for name, case in cases.items()}


def noise(seed: int, count: int, deviation: float = 1.0) -> list[float]:
    rng = random.Random(seed)
    return [rng.gauss(0.0, deviation) for _ in range(count)]
