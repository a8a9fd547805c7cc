"""What the tests of the theory share: the matrices of the law as it runs, its real loop, noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import attrs
from law_helpers import design_of, Law, NAMES
from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.law import step
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.theory.model import observer_matrices, starts
from nadrc_ros.theory.system import (
    Array,
    balanced,
    Complex,
    frequency_response,
    is_stable,
    StateSpace,
    zero_order_hold,
)
import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

# A power of two, so that scaling costs no digit, inside the linear zone of fal.
SMALL = 2.0**-30
WIDE: dict[str, Any] = {'command_min': -1e9, 'command_max': 1e9}
LINEAR = tuple(name for name in NAMES if not design_of(structure=name).nonlinear)


def wide_design(**values: Any) -> Design:
    return design_of(**WIDE | values)


def nested_design(order: int, bandwidths: Sequence[float]) -> Design:
    """Return a nested design with the given bandwidths [rad/s], one level each."""
    design = design_of(plant_order=order, structure='nested', levels=len(bandwidths))
    return attrs.evolve(design, bandwidths=list(bandwidths))


def response(system: StateSpace, omega: ArrayLike) -> Complex:
    return frequency_response(system)(omega)


def observer(design: Design, h: float = 0.0) -> StateSpace:
    """Return (u, y) -> all estimates, shape (K N,), with the applied command as an input."""
    a, b_u, b_y = observer_matrices(design, h)
    one, none = np.eye(len(a)), np.zeros(len(a))
    if h > 0.0:
        return StateSpace(a, np.column_stack([b_u, a @ b_y]), one, np.column_stack([none, b_y]), h)
    return StateSpace(a, np.column_stack([b_u, b_y]), one, np.zeros((len(a), 2)))


def output_covariance(system: StateSpace, variance: float = 1.0) -> Array:
    """
    Return the covariance of the outputs, (outputs, outputs), under white noise on every input.

    Discrete: X = a X a' + b b' variance, covariance c X c' + d d' variance. Continuous: a X + X a'
    = -b b' S with ``variance`` the intensity S (two-sided density [unit^2 s]); d must be 0. A
    sampled noise of variance sigma^2 and period h has about S = sigma^2 h. Infinite when unstable.
    """
    if not is_stable(system):
        return np.full((len(system.c), len(system.c)), np.inf)
    system = balanced(system)
    drive = system.b @ system.b.T * variance
    if system.h > 0.0:
        inside = linalg.solve_discrete_lyapunov(system.a, drive)
    elif np.any(system.d):
        raise ValueError('white noise of infinite variance passes d')
    else:
        inside = linalg.solve_continuous_lyapunov(system.a, -drive)
    return np.asarray(system.c @ inside @ system.c.T + system.d @ system.d.T * variance)


def stepped(design: Design, h: float) -> tuple[Array, Array]:
    """
    Unit vectors through `law.step`: (x, u, y, r, r', ...) -> x and -> u, the next ones.

    Shapes (K N, K N + 2 + n + 1) and (K N + 3 + n,).
    """
    begin, inputs = starts(design), design.order + 1
    size = begin[-1]
    states, commands = [], []
    for unit in range(size + 2 + inputs):
        vector = np.zeros(size + 2 + inputs)
        vector[unit] = SMALL
        state, out = blank_state(design), blank_state(design)
        for k in range(design.levels):
            state.levels[k][: design.sizes[k]] = list(vector[begin[k] : begin[k + 1]])
        u, status = step(
            design,
            state,
            list(vector[size + 2 :]),
            float(vector[size + 1]),
            float(vector[size]),
            h,
            out,
        )
        assert status == 0
        found = [level[:size] for level, size in zip(out.levels, design.sizes)]
        states.append(np.concatenate(found) / SMALL)
        commands.append(u / SMALL)
    return np.array(states).T, np.array(commands)


class Loop:
    """The real law around any linear plant, exactly sampled; from a random state of the plant."""

    def __init__(
        self, design: Design, plant: StateSpace, h: float, delay: float = 0.0, start: float = 1e-6
    ) -> None:
        held = zero_order_hold(plant, h, delay)
        rng = np.random.default_rng(1)
        x = start * rng.standard_normal(len(plant.a))
        self.x = [*x, *[0.0] * (len(held.a) - len(x))]
        self.a, self.b, self.c = held.a.tolist(), held.b[:, 0].tolist(), held.c[0].tolist()
        self.h = h
        self.law = Law(design)
        self.law.state.levels[0][0] = self.output

    @property
    def output(self) -> float:
        return float(sum(c * x for c, x in zip(self.c, self.x)))

    def run(self, ticks: int, reference: Sequence[float] = (0.0,), stop: float = np.inf) -> Array:
        """Return the output at each tick; ends early beyond ``stop``."""
        outputs = []
        for _ in range(ticks):
            y = self.output
            outputs.append(y)
            if abs(y) > stop:
                break
            u = self.law.step(reference, y, self.h)
            self.x = [
                sum(a * x for a, x in zip(row, self.x)) + b * u for row, b in zip(self.a, self.b)
            ]
        return np.array(outputs)


def simulated_stable(
    design: Design, plant: StateSpace, h: float, distance: float, delay: float = 0.0
) -> bool:
    """Whether the real loop decays; ``distance`` of max |z| from 1 only says how long to look."""
    ticks = int(8.0 / distance) + 100
    loop = Loop(design, plant, h, delay, start=1e-9)
    y = np.abs(loop.run(ticks, stop=1.0))
    if y[-1] > 1.0:
        return False
    tenth = len(y) // 10
    return bool(y[-tenth:].max() < 0.1 * y[tenth : 5 * tenth].max())
