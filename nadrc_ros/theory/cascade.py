"""
The loop of a cascade, opened at the plant: all of its laws in a row with it.

While nothing limits, the applied command of an outer loop is its command, so each law is that of
:func:`model.controller`: the outer one from y to what it asks, the inner one from that and from
the derivative of y that it measures to the command.
"""

from __future__ import annotations

from collections.abc import Sequence

from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.delayed import Loop
from nadrc_ros.theory.model import controller
from nadrc_ros.theory.system import split_delay, StateSpace, zero_order_hold
import numpy as np


def cascade_loop(
    designs: Sequence[Design], plant: StateSpace, h: float, delay: float = 0.0
) -> Loop:
    """
    Return the loop of a cascade, the outermost design first, at period ``h`` [s].

    The state of the continuous ``plant`` begins with (y, y', ...), of which each inner loop
    measures the one that the orders of those around it lead to; ``delay`` [s] is before the plant.
    In the result the ``plant`` is plant and laws in a row and the ``law`` is 1, so that its
    margins are those of the command, with all loops closed.
    """
    late, rest = split_delay(delay, h)
    p = zero_order_hold(plant, h, rest)
    measured = np.cumsum([0, *(design.order for design in designs[:-1])])
    law = laws(designs, h)
    seen = np.eye(len(p.a))[measured]
    a = np.block([[p.a, np.zeros((len(p.a), len(law.a)))], [law.b @ seen, law.a]])
    b = np.concatenate([p.b, np.zeros((len(law.a), 1))])
    c = np.hstack([law.d @ seen, law.c])
    none = np.zeros((1, 1))
    pair = np.zeros((1, 2))
    through = StateSpace(none, pair, none, np.eye(1, 2, 1), h)  # of (own command, output)
    n = len(a)
    closed_a = np.zeros((n + 1, n + 1))  # with the state of the 1, which it has for form's sake
    closed_a[:n, :n] = a + b @ c
    closed = StateSpace(closed_a, np.vstack([b, none]), np.hstack([c, none]), none, h)
    return Loop(StateSpace(a, b, c, none, h), through, late, 0, 0.0, closed)


def laws(designs: Sequence[Design], h: float) -> StateSpace:
    """Return (y, what the inner loops measure) -> command, references zero."""
    count = len(designs)
    a, b = np.zeros((0, 0)), np.zeros((0, count))
    c, d = np.zeros((1, 0)), np.zeros((1, count))
    for i, design in enumerate(designs):
        own = controller(design, h)
        by_y, by_r = own.b[:, :1], own.b[:, 1:2]
        sees = np.eye(1, count, i)
        a = np.block([[a, np.zeros((len(a), len(own.a)))], [by_r @ c, own.a]])
        b = np.concatenate([b, by_r @ d + by_y @ sees])
        c, d = (
            np.hstack([own.d[:, 1:2] @ c, own.c]),
            own.d[:, 1:2] @ d + own.d[:, :1] @ sees,
        )
    return StateSpace(a, b, c, d, h)
