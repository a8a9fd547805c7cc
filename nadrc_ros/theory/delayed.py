"""
The closed loop behind a dead time of any length, as frequency responses and what follows of them.

The whole periods m of the dead time are a factor z^-m, and only what is left of it is a part of
the sampled plant. A law with an ``input_delay`` of m' periods and a part p of one gets its own
command late, by g = (1 - p + p/z) z^-m'; the two need not be equal. So nothing here grows with
either: with the states x of plant and law, and the command u = F x + G (noise, load, r, ...),

    z x = A x + B (noise, load, r, ...) + (z^-m B_plant + g B_law) u + z^-m B_plant load,

stability is a number of turns (Nyquist), a variance an integral over frequency (Parseval), a
response in time an inverse transform. Inputs and outputs are those of :func:`loop.closed_loop`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, inf, log2, pi
from typing import NamedTuple

import attrs
from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.known import own_delay
from nadrc_ros.theory.loop import closed_loop
from nadrc_ros.theory.model import open_controller
from nadrc_ros.theory.norms import frequency_grid
from nadrc_ros.theory.system import (
    Array,
    balance,
    Complex,
    frequency_response,
    is_stable,
    pick,
    split_delay,
    StateSpace,
    zero_order_hold,
)
import numpy as np
from numpy.typing import ArrayLike

# Inputs and outputs of the loop, by their index.
NOISE, LOAD, REFERENCE = 0, 1, 2
OUTPUT, COMMAND = 0, 1
# A grid is so dense that z^-m turns by so many radians between two points, as long as |L| is above
# this, with so many points at most. A loop that needs more turns far more often than its poles
# make up for.
_TURN, _LOOP_GAIN_THAT_MATTERS, _MOST_POINTS = 0.25, 0.3, 20_000
# Points of the grid on which turns are counted, and how often it may be refined.
_COUNTING_POINTS, _REFINEMENTS = 400, 30
# Quadrature: points of a panel, panels of a decade; relative change with twice as many that is
# good enough, and how often they may be doubled.
_PANEL_POINTS, _PANELS, _QUADRATURE_ERROR, _DOUBLINGS = 8, 4, 1e-7, 8
# Samples of a response in time, what may be missing at the end, how often it may take twice as
# long, and the exponent by which it is damped over twice its time.
_MOST_SAMPLES, _SETTLED, _EXTENSIONS, _DAMPING = 8192, 1e-6, 20, 7.0


class Loop(NamedTuple):
    """
    The sampled ``plant`` and the ``law``; the command acts whole periods ``late``.

    ``law`` has its own command as its first input, ``own`` periods and a ``part`` of one late;
    ``closed`` is the loop with none of all these periods.
    """

    plant: StateSpace
    law: StateSpace
    late: int
    own: int
    part: float
    closed: StateSpace

    @property
    def h(self) -> float:
        """Sample period [s]."""
        return self.plant.h

    @property
    def dead_time(self) -> float:
        """Whole periods of it [s]."""
        return self.late * self.h

    @property
    def delayed(self) -> bool:
        """Tell whether anything is late by whole periods."""
        return self.late > 0 or self.own > 0 or self.part > 0.0

    @property
    def alone(self) -> StateSpace:
        """Return the law with its own command, as if that were not late."""
        return self.law._replace(a=self.law.a + self.law.b[:, :1] @ self.law.c)

    def told(self, s: Complex) -> Complex:
        """Return g at s, z = exp(s h): what the law knows of its own command."""
        part = 1.0 - self.part + self.part * np.exp(-s * self.h)
        return np.asarray(part * np.exp(-self.own * self.h * s))


def delayed_loop(design: Design, plant: StateSpace, h: float, delay: float = 0.0) -> Loop:
    """Return the loop with the continuous ``plant`` at period ``h``, ``delay`` [s] before it."""
    late, rest = split_delay(delay, h)
    sampled = zero_order_hold(plant, h, rest)
    at_once = attrs.evolve(design, input_delay=0.0)
    law, own = open_controller(design, h), own_delay(design, h)
    return Loop(sampled, law, late, *own, closed_loop(at_once, sampled, h))


def open_response(loop: Loop) -> Callable[[ArrayLike], Complex]:
    """Return L as a function of omega [rad/s]: negative feedback, -1 is critical."""
    plant = frequency_response(loop.plant)
    law = frequency_response(pick(loop.law, [0, 1], [0]))

    def at(omega: ArrayLike) -> Complex:
        s = 1j * np.asarray(omega, dtype=float)
        of_law = law(omega)[..., 0, :]
        late = np.exp(-loop.dead_time * s)
        alone = of_law[..., 1] / (1.0 - loop.told(s) * of_law[..., 0])
        return np.asarray(-plant(omega)[..., 0, 0] * late * alone)

    return at


def closed_response(loop: Loop) -> Callable[[ArrayLike], Complex]:
    """Return the response (..., outputs, inputs) as a function of omega, which may be complex."""
    matrix, drive, c, d = _matrices(loop)

    def at(omega: ArrayLike) -> Complex:
        s = 1j * np.asarray(omega, dtype=np.complex128)
        states = np.linalg.solve(matrix(s), drive(s))
        return np.asarray(c @ states + d)

    return at


def _matrices(
    loop: Loop,
) -> tuple[Callable[[Complex], Complex], Callable[[Complex], Complex], Array, Array]:
    """Return what multiplies x, what drives it, as functions of s, z = exp(s h), and c, d."""
    p, k = loop.plant, loop.law
    n, m, inputs = len(p.a), len(k.a), k.b.shape[1]
    by_y, by_r = k.b[:, 1:2], k.b[:, 2:]
    a = np.block([[p.a, np.zeros((n, m))], [by_y @ p.c, k.a]])
    b = np.block([[np.zeros((n, inputs))], [by_y, np.zeros((m, 1)), by_r]])
    into_plant, into_law = np.zeros((2, n + m, 1))
    into_plant[:n], into_law[n:] = p.b, k.b[:, :1]
    row = np.hstack([k.d[:, 1:2] @ p.c, k.c])
    through = np.hstack([k.d[:, 1:2], np.zeros((1, 1)), k.d[:, 2:]])
    load = np.eye(1, inputs, 1)
    # Of this law: with known vibrations the one without the delay, in closed, has another output.
    c = np.vstack([np.hstack([p.c, np.zeros((1, m))]), row])
    d = np.vstack([np.zeros((1, inputs)), through])
    scale = balance(a + (into_plant + into_law) @ row)
    a = a * scale / scale[:, None]
    b, into_plant, into_law = (each / scale[:, None] for each in (b, into_plant, into_law))
    row = row * scale
    identity = np.eye(n + m)

    def late(s: Complex) -> Complex:
        return np.asarray(np.exp(-loop.dead_time * s)[..., None, None] * into_plant)

    def by_command(s: Complex) -> Complex:
        return np.asarray(late(s) + loop.told(s)[..., None, None] * into_law)

    def matrix(s: Complex) -> Complex:
        shift = np.expm1(s * loop.h)[..., None, None]
        return np.asarray(shift * identity - (a - identity) - by_command(s) @ row)

    return (
        matrix,
        lambda s: np.asarray(b + by_command(s) @ through + late(s) @ load),
        c * scale,
        d,
    )


def is_stable_loop(loop: Loop) -> bool:
    """
    Tell whether all poles of the loop, those of the dead time included, are inside the circle.

    Without whole periods by the poles. Else by the argument principle. What is late enters by the
    command alone, so that det(z - A - ...) is linear in z^-m and z^-m', and times z^q, q the
    larger of m and m', or of m and m' + 1, a polynomial of degree N + q: all its zeros are inside
    if and only if its argument grows by (N + q) pi over the half circle, of which z^q has q pi.
    """
    if not loop.delayed:
        return is_stable(loop.closed)
    omega = loop_grid(loop, _COUNTING_POINTS)
    if len(omega) > _MOST_POINTS:
        return False
    matrix, *_ = _matrices(loop)

    def phase(omega: Array) -> Complex:
        s = np.asarray(1j * omega, dtype=np.complex128)
        return np.asarray(np.linalg.slogdet(matrix(s)).sign, dtype=np.complex128)

    # From z = 1 to z = -1, where the determinant is real.
    omega = np.concatenate([[0.0], omega])
    phases = phase(omega)
    for _ in range(_REFINEMENTS):
        steps = np.angle(phases[1:] * phases[:-1].conj())
        far = np.flatnonzero(np.abs(steps) > 1.0)
        if not far.size:
            return round(float(steps.sum()) / pi) == len(loop.closed.a)
        middle = 0.5 * (omega[far] + omega[far + 1])
        omega = np.insert(omega, far + 1, middle)
        phases = np.insert(phases, far + 1, phase(middle))
    return False  # a pole on the circle


def loop_grid(loop: Loop, points: int = 1500) -> Array:
    """Return frequencies [rad/s] around all poles up to pi / h, dense where z^-m turns L."""
    omega = frequency_grid(loop.plant, loop.alone, points=points)
    if not loop.delayed:
        return omega
    longest = max(loop.late, loop.own + 1) * loop.h
    own = frequency_response(pick(loop.law, [0], [0]))(omega)[:, 0, 0]
    gain = np.maximum(np.abs(open_response(loop)(omega)), np.abs(own))
    matters = omega[gain > _LOOP_GAIN_THAT_MATTERS]
    turns = longest * float(matters.max(initial=0.0)) / _TURN
    even = np.linspace(0.0, turns, min(ceil(turns), _MOST_POINTS) + 1)[1:] * _TURN / longest
    return np.unique(np.concatenate([omega, even[even < omega[-1]]]))


def command_variance(loop: Loop, variance: float = 1.0) -> float:
    """
    Return the variance of the command under white measurement noise; inf for an unstable loop.

    The integral of |u / noise|^2 over omega h from 0 to pi, over pi, by Gauss's rule on panels of
    equal ratio, whose number is doubled until it makes no difference.
    """
    if not is_stable_loop(loop):
        return inf
    at = closed_response(loop)
    grid = frequency_grid(loop.plant, loop.alone, points=2)
    low, high = float(grid[0]), pi / loop.h
    nodes, weights = np.polynomial.legendre.leggauss(_PANEL_POINTS)
    count, integral, before = ceil(_PANELS * np.log10(high / low)), 0.0, inf
    for _ in range(_DOUBLINGS):
        edges = np.concatenate([[0.0], np.geomspace(low, high, count + 1)])
        half, middle = 0.5 * np.diff(edges), 0.5 * (edges[1:] + edges[:-1])
        density = np.abs(at(middle[:, None] + half[:, None] * nodes)[..., COMMAND, NOISE]) ** 2
        integral = float(half @ density @ weights) * loop.h / pi
        if abs(integral - before) <= _QUADRATURE_ERROR * integral:
            break
        count, before = 2 * count, integral
    return variance * integral


def step_responses(loop: Loop, inputs: list[int], lasting: float) -> tuple[Array, float]:
    """
    Return the output after unit steps of ``inputs``, (inputs, samples), and their distance [s].

    It lasts about ``lasting`` [s], or twice that and so on until the response rests; of more than
    some thousand periods every k-th is a sample. What is missing to the final value, whose
    transform is (T(1) - T(z)) / (1 - 1/z), is transformed back a little outside of the unit
    circle: exactly where every period is a sample, but for what is missing after twice the time.
    Else frequencies beyond the samples' are cut off softly, as by a mean over three of them. The
    loop must be stable.
    """
    at = closed_response(loop)
    final = at(0.0).real[OUTPUT, inputs][:, None]
    for _ in range(_EXTENSIONS):
        count = 2 ** ceil(log2(min(max(lasting / loop.h, 2.0), _MOST_SAMPLES)))
        every = max(1, ceil(lasting / loop.h / count))
        step = every * loop.h
        damping = _DAMPING / (2.0 * count * step)
        turns = np.arange(count + 1) / count
        s = damping + 1j * pi * turns / step
        reached = at(-1j * s)[:, OUTPUT, inputs].T / np.expm1(-s * loop.h) / every
        missing = reached - final / np.expm1(-s * step)
        if every > 1:
            missing *= np.cos(0.5 * pi * turns) ** 2
        missing = np.fft.irfft(missing)[:, :count] * np.exp(damping * step * np.arange(count))
        missing[:, :1] = final
        at_the_end = np.abs(missing[:, -count // 8 :]).max(axis=1)
        if (at_the_end <= _SETTLED * np.abs(missing).max(axis=1)).all():
            break
        lasting *= 2.0
    return np.asarray(final - missing, dtype=float), step
