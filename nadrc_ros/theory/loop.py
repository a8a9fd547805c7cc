"""The closed loop of the discrete law and a linear plant, as one system."""

from __future__ import annotations

from collections.abc import Sequence

from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.model import controller
from nadrc_ros.theory.system import growth, StateSpace, zero_order_hold
import numpy as np


def chain(order: int, gain: float, damping: Sequence[float] = ()) -> StateSpace:
    """
    Return the plant y^(n) + sum_i c_i y^(i) = b u, ``damping`` = c_0, c_1, ... [1/s^(n-i)].

    Coefficients that are not given are 0. The state is (y, y', ..., y^(n-1)).
    """
    a = np.eye(order, k=1)
    a[-1, : len(damping)] -= np.asarray(damping, dtype=float)
    identity = np.eye(order)
    return StateSpace(a, gain * identity[:, -1:], identity[:1], np.zeros((1, 1)))


def closed_loop(design: Design, plant: StateSpace, h: float, delay: float = 0.0) -> StateSpace:
    """
    Return (noise, load, r, r', ..., r^(n)) -> (output, command) of the loop at period ``h``.

    ``plant`` is continuous, one input, one output, without feedthrough, sampled with the command
    held and ``delay`` [s], or sampled so already; ``load`` adds to the command on its way to the
    plant, unseen by the observers. States: those of the plant, with one for each period of the
    delay (of a long one see ``delayed``), then those of :func:`model.controller`.
    """
    p = plant if plant.h == h and delay == 0.0 else zero_order_hold(plant, h, delay)
    k = controller(design, h)
    n, m = len(p.a), len(k.a)
    by, br = k.b[:, :1], k.b[:, 1:]
    dy, dr = k.d[:, :1], k.d[:, 1:]
    a = np.block([[p.a + p.b @ dy @ p.c, p.b @ k.c], [by @ p.c, k.a]])
    b = np.block([[p.b @ dy, p.b, p.b @ dr], [by, np.zeros((m, 1)), br]])
    c = np.block([[p.c, np.zeros((1, m))], [dy @ p.c, k.c]])
    d = np.block([[np.zeros((1, 2 + dr.shape[1]))], [dy, np.zeros((1, 1)), dr]])
    assert a.shape == (n + m, n + m)
    return StateSpace(a, b, c, d, h)


def loop_growth(design: Design, plant: StateSpace, h: float, delay: float = 0.0) -> float:
    """Return max |z| of the closed loop: below 1 it is stable."""
    return growth(closed_loop(design, plant, h, delay))
