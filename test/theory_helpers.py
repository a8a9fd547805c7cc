"""What the tests of the theory share: the matrices of the law as it runs, and its real loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from law_helpers import design_of, Law, NAMES
from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.law import step
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.theory.system import Array, StateSpace, zero_order_hold
import numpy as np

# A power of two, so that scaling costs no digit, inside the linear zone of fal.
SMALL = 2.0**-30
WIDE: dict[str, Any] = {'command_min': -1e9, 'command_max': 1e9}
LINEAR = tuple(name for name in NAMES if not design_of(structure=name).nonlinear)


def wide_design(**values: Any) -> Design:
    return design_of(**WIDE | values)


def stepped(design: Design, h: float) -> tuple[Array, Array]:
    """
    Unit vectors through `law.step`: (x, u, y, r, r', ...) -> x and -> u, the next ones.

    Shapes (K N, K N + 2 + n + 1) and (K N + 3 + n,).
    """
    size, inputs = design.levels * design.states, design.order + 1
    states, commands = [], []
    for unit in range(size + 2 + inputs):
        vector = np.zeros(size + 2 + inputs)
        vector[unit] = SMALL
        state, out = blank_state(design), blank_state(design)
        for k in range(design.levels):
            state.levels[k][:] = list(vector[k * design.states : (k + 1) * design.states])
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
        states.append(np.concatenate([np.array(level) for level in out.levels]) / SMALL)
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
