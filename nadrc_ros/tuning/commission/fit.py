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
from nadrc_ros.tuning.identification.estimate import Estimate, robust_error, Z95
import numpy as np
from scipy.stats import t

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
    'mode_share': 1.0,
    'mode_frequency': 0.3,
    'mode_damping': 3.0,
}
# A mode swings so many radians in a period at least and at most, and is damped so; where one is
# sought, at so many frequencies, with one damping; what is found there by chance is less than so
# many variances of the noise.
_SLOWEST, _QUICKEST, _LEAST_DAMPED, _MOST_DAMPED = 0.08, 2.0, 5e-3, 0.7
_FREQUENCIES, _LIGHTLY, _BY_CHANCE = 36, 0.06, 40.0
# What runs away grows by no more than the exponential of that within a part of a log.
_FASTEST = 40.0
# What is found of b0 is not farther from where the search began than that factor.
_FARTHEST = 30.0
# So many parts of a log tell how much they differ.
_PARTS = 4
# Correlation of what a model leaves with what a parameter does, and what is still noise.
_IN_STEP, _NOISIER = 0.25, 1.1
# Dead times that are tried before a search grow by that factor, at first by a period.
_LATER = 1.4


@attrs.frozen(kw_only=True, eq=False)
class Segment:
    """
    A part of a log: the ``measurement`` (N,) and its ``time`` (N,) [s] since the part began.

    ``sent`` (M,) is the integral of the command, relative to the resting one, until each of the
    ``edges`` (M,) [s] at which it changes, and ``size`` the farthest that it goes; ``y`` and ``v``
    are the state at the begin as it was measured, ``resting`` whether it stood.
    """

    time: Array
    measurement: Array
    edges: Array
    sent: Array
    size: float
    y: float
    v: float
    resting: bool


@attrs.frozen(kw_only=True, eq=False)
class Fitted:
    """
    The model, b0 and delay [s] with their intervals, and what is left over.

    ``residual`` is the rms of the ``samples`` residuals, ``moved`` that of the motion; ``others``
    are models that are a standard deviation away, each in a direction of its own, and
    ``segments`` what it was fitted to.
    """

    model: Model
    b0: Estimate
    delay: Estimate
    residual: float
    moved: float
    samples: int
    others: tuple[Model, ...]
    segments: tuple[Segment, ...]


def fit(
    segments: Sequence[Segment],
    start: Model,
    h: float,
    pace: float,
    size: float,
    latest: float,
    noise: float,
) -> Fitted:
    """
    Return the model nearest to all segments, from ``start`` on.

    ``pace`` [s] and ``size`` [command unit] are what times and commands are measured in; friction
    is sought where ``start`` has some, and no dead time is longer than ``latest`` [s].
    """
    units = {'b0': abs(start.b0), 'damping': 1.0 / pace, 'load': size, 'delay': h}
    if start.order == 2:
        units['stiffness'] = 1.0 / pace**2
    if start.friction > 0.0:
        units['friction'] = size
    if start.mode_frequency > 0.0:
        units |= {'mode_share': 1.0, 'mode_frequency': start.mode_frequency, 'mode_damping': 0.1}

    def residual(model: Model) -> Array:
        return np.concatenate([_left(each, model, h) for each in segments])

    def slopes(model: Model, at: Array) -> Array:
        columns = []
        for name, unit in units.items():
            step = _STEP * unit if name != 'delay' else 0.05 * h
            changed = attrs.evolve(model, **{name: getattr(model, name) + step})
            columns.append((residual(changed) - at) / (step / unit))
        return np.column_stack(columns)

    fastest = min(_FASTEST / max(float(each.time[-1]) for each in segments), 0.3 / h)
    model, error = start, residual(start)
    wander = 1e-2
    gradient = slopes(model, error)
    for _ in range(_ITERATIONS):
        matrix = gradient.T @ gradient
        matrix += wander * np.diag(np.diag(matrix) + 1e-9 * np.trace(matrix))
        step = np.linalg.lstsq(matrix, -gradient.T @ error, rcond=None)[0]
        trial = _moved(
            model, dict(zip(units, step * list(units.values()))), start, h, latest, fastest
        )
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
    strange = _IN_STEP * max(rms**2 - (_NOISIER * noise) ** 2, 0.0) ** 0.5
    ends = np.cumsum([len(each.time) for each in segments])[:-1]

    def uncertain(row: Array) -> float:
        """Return the error of a parameter, from the residuals that move it."""
        influence = row[:count] * error
        parts = np.array([part.sum() for part in np.split(influence, ends)])
        apart = 0.0
        if len(parts) >= _PARTS:
            # what the parts of the log have in common is right: what they do not have is an error
            spare = len(parts) - 1
            apart = float(t.ppf(0.975, spare)) / Z95 * float(np.linalg.norm(parts))
            apart *= (len(parts) / spare) ** 0.5
        before = rms * float(np.linalg.norm(row[count:]))
        # what the model does not explain may go with what the parameter does
        wrong = strange * float(np.linalg.norm(row[:count])) * count**0.5
        return float(np.linalg.norm([max(robust_error(influence), apart), before, wrong]))

    errors = np.array([uncertain(row) for row in inverse])
    # along the axes of the ellipsoid in which the parameters are, all their errors as they are
    together = inverse @ inverse.T
    scale = errors / np.sqrt(np.maximum(np.diag(together), np.finfo(float).tiny))
    size2, axes = np.linalg.eigh(together * np.outer(scale, scale))
    away = [np.sqrt(max(value, 0.0)) * axis for value, axis in zip(size2, axes.T)]
    others = [
        _moved(model, dict(zip(units, each * list(units.values()))), model, h, latest, fastest)
        for each in away
    ]
    error_of = dict(zip(units, errors * list(units.values())))
    seen = np.concatenate([each.measurement - each.y for each in segments])
    return Fitted(
        model=model,
        b0=Estimate(value=model.b0, error=error_of['b0']),
        delay=Estimate(value=model.delay, error=error_of['delay']),
        residual=rms,
        moved=float(np.sqrt(np.mean(seen**2))),
        samples=count,
        others=tuple(others),
        segments=tuple(segments),
    )


def scan(
    segments: Sequence[Segment], kinds: Sequence[Model], h: float, sign: int, latest: float
) -> Model | None:
    """
    Return the one of some kinds of models that fits best, with a dead time, to begin a search.

    The response is b0 times that for b0 = 1, for friction and load are in units of the command
    (without stiffness): the best b0 is a quotient, of the ``sign`` that is known, 0 for either.
    """
    chosen, least = None, inf
    delays = [0.0]
    while delays[-1] < latest:
        delays.append(max(delays[-1] + h, _LATER * delays[-1]))
    for kind in kinds:
        zero = attrs.evolve(kind, b0=0.0)
        seen = np.concatenate([_left(each, zero, h) for each in segments])
        for late in delays:
            model = attrs.evolve(kind, delay=late)
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


def with_mode(fitted: Fitted, h: float) -> Model | None:
    """
    Return the model with the mode that explains most of what is left, None if that is chance.

    The residuals are linear in the mode's share: for each frequency the best one is a quotient.
    """
    chosen, most = None, _BY_CHANCE * fitted.residual**2
    for turn in np.geomspace(_SLOWEST, _QUICKEST, _FREQUENCIES):
        kind = attrs.evolve(
            fitted.model, mode_frequency=float(turn) / h, mode_damping=_LIGHTLY, mode_share=0.0
        )
        seen = np.concatenate([_left(each, kind, h) for each in fitted.segments])
        whole = attrs.evolve(kind, mode_share=1.0)
        unit = seen - np.concatenate([_left(each, whole, h) for each in fitted.segments])
        power = float(unit @ unit)
        share = float(unit @ seen) / power if power > 0.0 else 0.0
        if share * share * power > most:
            chosen, most = attrs.evolve(kind, mode_share=share), share * share * power
    return chosen


def arriving(edges: Array, sent: Array, delay: float, count: int, h: float) -> Array:
    """Return the mean command (count,) in each period of ``h`` [s], of what was ``sent``."""
    changes: Array = np.diff(np.interp(h * np.arange(count + 1) - delay, edges, sent)) / h
    return changes


def _left(segment: Segment, model: Model, h: float) -> Array:
    """Return measurement - model, without what the initial state explains."""
    count = int(segment.time[-1] / h - 1e-6) + 1
    forces = arriving(segment.edges, segment.sent, model.delay, count, h)
    found = model.outputs(forces, h, segment.y, segment.v)
    grid = h * np.arange(count + 1)
    left: Array = segment.measurement - np.interp(segment.time, grid, np.append(segment.y, found))
    for column in _initial(segment, model, h, count):
        left -= column * float(column @ left)
    return left


def _initial(segment: Segment, model: Model, h: float, count: int) -> list[Array]:
    """Return what a wrong initial state leaves, as columns (N,) of length 1 at right angles."""
    time = segment.time
    held = segment.resting and (model.friction > 0.0 or model.low == 0.0 or model.high == 0.0)
    found: list[Array] = []
    if model.order == 1:
        if not held:
            found.append(np.exp(-np.clip(model.damping * time, -50.0, 50.0)))
    elif held:
        found.append(np.ones(len(time)))
    else:  # a wrong initial output, and a wrong initial speed
        free = attrs.evolve(model, friction=0.0, load=0.0, low=-inf, high=inf, mode_share=0.0)
        grid, nothing = h * np.arange(count + 1), np.zeros(count)
        for y, v in ((1.0, 0.0), (0.0, 1.0)):
            found.append(np.interp(time, grid, np.append(y, free.outputs(nothing, h, y, v))))
    if model.mode_frequency > 0.0:  # and it swings already
        fades = np.exp(-model.mode_damping * model.mode_frequency * time)
        turns = model.mode_frequency * time
        found += [fades * np.cos(turns), fades * np.sin(turns)]
    for k, column in enumerate(found):
        for other in found[:k]:
            column = column - other * float(other @ column)
        found[k] = column / (float(column @ column) ** 0.5 or 1.0)
    return found


def _moved(
    model: Model,
    steps: dict[str, float],
    start: Model,
    h: float,
    latest: float,
    fastest: float,
) -> Model:
    values = {name: getattr(model, name) + float(step) for name, step in steps.items()}
    near = values['b0'] / start.b0
    values['b0'] = start.b0 * min(max(near, 1.0 / _FARTHEST), _FARTHEST)
    values['delay'] = min(max(values['delay'], 0.0), latest)
    values['damping'] = min(max(values['damping'], -fastest), 1.0 / h)
    if 'stiffness' in values:
        values['stiffness'] = max(values['stiffness'], -(fastest**2))
    if 'mode_frequency' in values:
        turn = min(max(values['mode_frequency'] * h, _SLOWEST), _QUICKEST)
        values['mode_frequency'] = turn / h
        damping = min(max(values['mode_damping'], _LEAST_DAMPED), _MOST_DAMPED)
        values['mode_damping'] = damping
    if 'friction' in values:
        values['friction'] = max(values['friction'], 0.0)
    return attrs.evolve(model, **values)
