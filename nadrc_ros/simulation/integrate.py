"""
The plant over one period: classical Runge-Kutta of order 4 with the command held.

Over a period the command is constant (zero-order hold), while the disturbance is evaluated at each
stage. A jump of the disturbance inside a period costs the order for that period only.
"""

from __future__ import annotations

from math import ceil, isfinite
from typing import Any

from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.simulation.protocols import (
    Derivative,
    Derivatives,
    MutableVector,
    Plant,
    probe_states,
    Signal,
    Vector,
)
import numpy as np
import numpy.typing as npt

_STAGE = 4  # the row of the work buffer behind those of the four slopes
_MOST_SUBSTEPS = 10_000
# Of a time constant, one Runge-Kutta step at most.
_LARGEST_STEP = 0.25
# Beyond it a state has run away: its powers overflow, and functions of them are not defined.
_FAR = 1e30


def integrate(
    derivative: Derivative,
    plant: Any,
    disturbances: Derivatives,
    disturbance: Any,
    t: float,
    x: Vector,
    u: float,
    h: float,
    substeps: int,
    work: Any,
    w: MutableVector,
    out: MutableVector,
    size: int,
) -> None:
    """
    Write x(t + h) into ``out`` from x(t) in ``x``, with command ``u`` held over [t, t + h].

    The first slope is given: who simulates a plant has it, from its total disturbance at ``t``.
    The methods are passed beside their objects, ``type(plant).derivative`` with ``plant`` and
    ``type(disturbance).derivatives`` with ``disturbance``, so that the same source compiles.

    Parameters
    ----------
    derivative, plant
        The right-hand side dx/dt = derivative(plant, t, x, u, w, dx).
    disturbances, disturbance
        The signal w(t), read as disturbances(disturbance, t, w).
    t, h
        Start and length of the period [s].
    x
        State at ``t``, left as it is.
    u
        Command.
    substeps
        Number of equal Runge-Kutta steps, at least 1.
    work
        Five rows of the length of ``x``, the first of them dx/dt at ``t``; overwritten.
    w
        One entry, w(t); overwritten.
    out
        The new state; never ``x`` itself.
    size
        How many states there are.

    """
    step = h / substeps
    stage = work[4]
    for i in range(size):
        out[i] = x[i]
    for j in range(substeps):
        start = t + j * step
        middle = start + 0.5 * step
        end = t + (j + 1) * step
        if j > 0:  # w is still that of the last end, which is this start
            derivative(plant, start, out, u, w[0], work[0])
        for i in range(size):
            stage[i] = out[i] + 0.5 * step * work[0][i]
        disturbances(disturbance, middle, w)
        derivative(plant, middle, stage, u, w[0], work[1])
        for i in range(size):
            stage[i] = out[i] + 0.5 * step * work[1][i]
        derivative(plant, middle, stage, u, w[0], work[2])
        for i in range(size):
            stage[i] = out[i] + step * work[2][i]
        disturbances(disturbance, end, w)
        derivative(plant, end, stage, u, w[0], work[3])
        for i in range(size):
            middle_slope = work[1][i] + work[2][i]
            out[i] = out[i] + step / 6.0 * (work[0][i] + 2.0 * middle_slope + work[3][i])


def make_work(states: int) -> list[list[float]]:
    """Return the buffer that :func:`integrate` works in."""
    return [[0.0] * states for _ in range(_STAGE + 1)]


class Integrator:
    """A plant, its disturbance and the buffers to step them in plain Python."""

    def __init__(self, plant: Plant, disturbance: Signal, substeps: int = 1) -> None:
        self.plant = plant
        self.disturbance = disturbance
        self.substeps = substeps
        self._derivative: Derivative = type(plant).derivative
        self._disturbances: Derivatives = type(disturbance).derivatives
        self._work = make_work(plant.states)
        self._w = [0.0]

    def advance(self, t: float, x: Vector, u: float, h: float, out: MutableVector) -> bool:
        """
        Write x(t + h) into ``out`` and return True, or not-a-number and False if it diverged.

        Whatever else a plant or a signal of the user's raises passes: see :func:`ran_away`.
        """
        try:
            self._disturbances(self.disturbance, t, self._w)
            self._derivative(self.plant, t, x, u, self._w[0], self._work[0])
            integrate(
                self._derivative,
                self.plant,
                self._disturbances,
                self.disturbance,
                t,
                x,
                u,
                h,
                self.substeps,
                self._work,
                self._w,
                out,
                len(x),
            )
            finite = all(isfinite(out[i]) for i in range(len(out)))
        except (OverflowError, ValueError) as error:
            if not ran_away(error, x, out, self._work[_STAGE]):
                raise
            finite = False
        if not finite:
            for i in range(len(out)):
                out[i] = float('nan')
        return finite


def ran_away(error: Exception, *states: Vector) -> bool:
    """
    Tell whether a plant at these states raises since it diverges, not for a fault in its code.

    ``math.sin`` and the like raise a ``ValueError`` for what is not finite, and a power one for
    what is too large. Compiled they would return what is not finite. A ``ValueError`` at
    a moderate state has another cause, and is for its author.
    """
    if isinstance(error, OverflowError):
        return True
    return isinstance(error, ValueError) and not all(
        abs(x[i]) < _FAR for x in states for i in range(len(x))
    )


def fastest_rate(plant: Plant) -> float:
    """
    Return the largest eigenvalue magnitude [1/s] of the plant's dynamics at the probe states.

    The Jacobian is taken by differences; where it is not finite, it tells nothing.
    """
    jacobians = np.array([jacobian(plant, x) for x in probe_states(plant.states)])
    known = jacobians[np.isfinite(jacobians).all(axis=(1, 2))]
    return float(np.abs(np.linalg.eigvals(known)).max(initial=0.0))


def substeps_for(plant: Plant, h: float) -> int:
    """
    Return how many Runge-Kutta steps a period of ``h`` [s] needs: at least 4 per time constant.

    One step is unstable beyond 2.78 time constants, and at a quarter it is accurate to 1e-5. This
    matters for the fast current of a motor; most plants need one.

    Raises
    ------
    SettingError
        For more than ``_MOST_SUBSTEPS``: so fast a plant would take for ever.

    """
    fastest = fastest_rate(plant)
    steps = h * fastest / _LARGEST_STEP
    if not steps <= _MOST_SUBSTEPS:
        raise SettingError(
            'rate',
            1.0 / h,
            f'at least {fastest / (_LARGEST_STEP * _MOST_SUBSTEPS):.3g} Hz for this plant, '
            f'whose fastest part has a time constant of {1.0 / fastest:.3g} s',
        )
    return max(1, ceil(steps - 1e-9))


def jacobian(plant: Plant, x: list[float], u: float = 0.0) -> npt.NDArray[np.float64]:
    """Return d(dx/dt)/dx at ``x`` under the command ``u``, shape (states, states)."""
    size, delta = len(x), 1e-6
    slopes = np.zeros((2, size, size))
    for j in range(size):
        for way, shift in enumerate((delta, -delta)):
            dx = [0.0] * size
            plant.derivative(0.0, [x[i] + shift * (i == j) for i in range(size)], u, 0.0, dx)
            slopes[way, :, j] = dx
    found: npt.NDArray[np.float64] = (slopes[0] - slopes[1]) / (2.0 * delta)
    return found
