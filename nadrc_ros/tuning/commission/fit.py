"""
The model that repeats what was seen: output errors, least squares, an interval for b0.

Each segment begins on its own (multiple shooting): what a wrong initial output leaves, and where
nothing holds the machine a wrong initial speed, is projected out of its residuals. The steps are
those of Levenberg and Marquardt with numerical slopes. The interval is robust against residuals
that are no white noise (:func:`nadrc_ros.tuning.identification.estimate.robust_error`).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import attrs
from nadrc_ros.tuning.commission.machine import Array
from nadrc_ros.tuning.commission.model import Model
from nadrc_ros.tuning.identification.estimate import Estimate, robust_error
import numpy as np

_ITERATIONS, _GAINED, _DAMPED = 30, 1e-4, 1e6
_STEP = 1e-3
# What is found of b0 is not farther from where the search began than that factor.
_FARTHEST = 30.0
_LONGEST_DELAY = 20
# Dead times that are tried before a search [periods].
_SCANNED = 14


@attrs.frozen(kw_only=True, eq=False)
class Segment:
    """
    A part of a log: the ``measurement`` (N,) at the end of each period, nan where none came.

    ``commands``, relative to the resting one, begin ``before`` periods earlier; ``y`` and ``v``
    are the state at its begin as it was measured, ``resting`` whether it stood.
    """

    measurement: Array
    commands: list[float]
    before: int
    y: float
    v: float
    resting: bool


@attrs.frozen(kw_only=True, eq=False)
class Fitted:
    """
    The model, b0 and delay [s] with their intervals, and what is left over.

    ``residual`` is the rms of the ``samples`` residuals, ``moved`` that of the motion.
    """

    model: Model
    b0: Estimate
    delay: Estimate
    residual: float
    moved: float
    samples: int


def fit(segments: Sequence[Segment], start: Model, h: float, pace: float, size: float) -> Fitted:
    """
    Return the model nearest to all segments, from ``start`` on.

    ``pace`` [s] and ``size`` [command unit] are what times and commands are measured in; friction
    is sought where ``start`` has some.
    """
    units = {'b0': abs(start.b0), 'damping': 1.0 / pace, 'load': size, 'delay': h}
    if start.order == 2:
        units['stiffness'] = 1.0 / pace**2
    if start.friction > 0.0:
        units['friction'] = size

    def residual(model: Model) -> Array:
        return np.concatenate([_left(each, model, h) for each in segments])

    def slopes(model: Model, at: Array) -> Array:
        columns = []
        for name, unit in units.items():
            step = _STEP * unit if name != 'delay' else 0.05 * h
            changed = attrs.evolve(model, **{name: getattr(model, name) + step})
            columns.append((residual(changed) - at) / (step / unit))
        return np.column_stack(columns)

    model, error = start, residual(start)
    wander = 1e-2
    gradient = slopes(model, error)
    for _ in range(_ITERATIONS):
        matrix = gradient.T @ gradient
        matrix += wander * np.diag(np.diag(matrix) + 1e-9 * np.trace(matrix))
        step = np.linalg.lstsq(matrix, -gradient.T @ error, rcond=None)[0]
        trial = _moved(model, dict(zip(units, step * list(units.values()))), start, h)
        left = residual(trial)
        gained = 1.0 - float(left @ left) / float(error @ error)
        if not gained > 0.0:
            wander *= 8.0
            if wander > _DAMPED:
                break
            continue
        model, error, wander = trial, left, max(0.1 * wander, 1e-8)
        if gained < _GAINED:
            break
        gradient = slopes(model, error)
    gradient = slopes(model, error)
    inverse = np.linalg.pinv(gradient, rcond=1e-6)
    errors = {
        name: unit * robust_error(row * error) for (name, unit), row in zip(units.items(), inverse)
    }
    seen = np.concatenate([each.measurement - each.y for each in segments])
    return Fitted(
        model=model,
        b0=Estimate(value=model.b0, error=errors['b0']),
        delay=Estimate(value=model.delay, error=errors['delay']),
        residual=float(np.sqrt(error @ error / max(len(error) - len(units), 1))),
        moved=float(np.sqrt(np.nanmean(seen**2))),
        samples=len(error),
    )


def scan(
    segments: Sequence[Segment], order: int, frictions: Sequence[float], h: float
) -> Model | None:
    """
    Return the undamped model of one order that fits best, to begin a search with.

    Of given dead time and friction, in units of the command, the response is b0 times that for
    b0 = 1: the best b0 is a quotient, of either sign.
    """
    chosen, least = None, inf
    for friction in frictions:
        for late in range(_SCANNED):
            model = Model(order=order, b0=1.0, friction=friction, delay=late * h)
            zero = attrs.evolve(model, b0=0.0)
            seen = np.concatenate([_left(each, zero, h) for each in segments])
            unit = seen - np.concatenate([_left(each, model, h) for each in segments])
            power = float(unit @ unit)
            if not power > 0.0:
                continue
            b0 = float(unit @ seen) / power
            left = float(seen @ seen) - b0 * b0 * power
            if left < least and b0 != 0.0:
                chosen, least = attrs.evolve(model, b0=b0), left
    return chosen


def _left(segment: Segment, model: Model, h: float) -> Array:
    """Return measurement - model, without what the initial state explains."""
    commands = segment.commands[segment.before - model.lead(h) :]
    found, _ = model.response(commands, h, segment.y, segment.v)
    left = segment.measurement - np.array(found)
    known = np.isfinite(left)
    time = np.arange(1, len(left) + 1)[known] * h
    if model.order == 1:
        if model.friction > 0.0 and segment.resting:
            alone: Array = left[known]
            return alone
        columns = np.exp(-np.clip(model.damping * time, -50.0, 50.0))[:, None]
    elif segment.resting and model.friction > 0.0:
        columns = np.ones((len(time), 1))
    else:
        columns = np.column_stack((np.ones(len(time)), time))
    basis, _ = np.linalg.qr(columns)
    rest: Array = left[known] - basis @ (basis.T @ left[known])
    return rest


def _moved(model: Model, steps: dict[str, float], start: Model, h: float) -> Model:
    values = {name: getattr(model, name) + float(step) for name, step in steps.items()}
    near = values['b0'] / start.b0
    values['b0'] = start.b0 * min(max(near, 1.0 / _FARTHEST), _FARTHEST)
    values['delay'] = min(max(values['delay'], 0.0), _LONGEST_DELAY * h)
    values['damping'] = min(max(values['damping'], -0.3 / h), 1.0 / h)
    if 'friction' in values:
        values['friction'] = max(values['friction'], 0.0)
    return attrs.evolve(model, **values)
