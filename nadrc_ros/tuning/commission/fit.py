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
# What is known of parameters before anything is measured, in their units: standard deviations.
_BEFORE = {
    'b0': 3.0,
    'damping': 3.0,
    'stiffness': 3.0,
    'load': 2.0,
    'friction': 2.0,
    'delay': 10.0,
}
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
    # What the data do not tell is as uncertain as it is before: as a row more for each parameter.
    rms = float(np.sqrt(error @ error / max(len(error) - len(units), 1)))
    known = rms * np.diag([1.0 / _BEFORE[name] for name in units])
    inverse = np.linalg.pinv(np.vstack((gradient, known)))
    count = len(error)
    errors = {
        name: unit
        * float(np.hypot(robust_error(row[:count] * error), rms * np.linalg.norm(row[count:])))
        for (name, unit), row in zip(units.items(), inverse)
    }
    seen = np.concatenate([each.measurement - each.y for each in segments])
    return Fitted(
        model=model,
        b0=Estimate(value=model.b0, error=errors['b0']),
        delay=Estimate(value=model.delay, error=errors['delay']),
        residual=rms,
        moved=float(np.sqrt(np.nanmean(seen**2))),
        samples=count,
    )


def scan(segments: Sequence[Segment], kinds: Sequence[Model], h: float, sign: int) -> Model | None:
    """
    Return the one of some kinds of models that fits best, with a dead time, to begin a search.

    The response is b0 times that for b0 = 1, for friction and load are in units of the command
    (without stiffness): the best b0 is a quotient, of the ``sign`` that is known, 0 for either.
    """
    chosen, least = None, inf
    for kind in kinds:
        zero = attrs.evolve(kind, b0=0.0)
        seen = np.concatenate([_left(each, zero, h) for each in segments])
        for late in range(_SCANNED):
            model = attrs.evolve(kind, delay=late * h)
            unit = seen - np.concatenate([_left(each, model, h) for each in segments])
            power = float(unit @ unit)
            if not power > 0.0:
                continue
            ratio = float(unit @ seen) / power
            left = float(seen @ seen) - ratio * ratio * power
            # what may move one way only tells which way that is
            held = kind.low > -inf or kind.high < inf
            if sign * ratio * kind.b0 < 0.0:
                continue
            if left < least and (ratio > 0.0 or (ratio < 0.0 and not held)):
                chosen, least = attrs.evolve(model, b0=kind.b0 * ratio), left
    return chosen


def _left(segment: Segment, model: Model, h: float) -> Array:
    """Return measurement - model, without what the initial state explains."""
    commands = segment.commands[segment.before - model.lead(h) :]
    found, _ = model.response(commands, h, segment.y, segment.v)
    left: Array = segment.measurement - np.array(found)
    known = np.isfinite(left)
    left = left[known]
    held = segment.resting and (model.friction > 0.0 or model.low == 0.0 or model.high == 0.0)
    if model.order == 1:
        if held:
            return left
        decay = np.exp(-np.clip(model.damping * h * np.flatnonzero(known), -50.0, 50.0))
        left -= decay * (float(decay @ left) / float(decay @ decay))
        return left
    left -= left.mean()
    if not held:
        time = np.flatnonzero(known) - np.flatnonzero(known).mean()
        left -= time * (float(time @ left) / float(time @ time))
    return left


def _moved(model: Model, steps: dict[str, float], start: Model, h: float) -> Model:
    values = {name: getattr(model, name) + float(step) for name, step in steps.items()}
    near = values['b0'] / start.b0
    values['b0'] = start.b0 * min(max(near, 1.0 / _FARTHEST), _FARTHEST)
    values['delay'] = min(max(values['delay'], 0.0), _LONGEST_DELAY * h)
    values['damping'] = min(max(values['damping'], -0.3 / h), 1.0 / h)
    if 'friction' in values:
        values['friction'] = max(values['friction'], 0.0)
    return attrs.evolve(model, **values)
