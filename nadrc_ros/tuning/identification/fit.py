"""
Models of a log by the direct prediction error method.

The parameters and the noise bandwidth that make the innovations smallest (Ljung 1999, 7.2); b, dry
friction and the initial state drop out by variable projection (Golub and Pereyra 1973). They say
which structure the plant has, how late a command acts, how fast the disturbance moves and how
smooth it is. Their b is biased: in a closed loop the command answers the disturbance (Soderstrom
and Stoica, System Identification, 1989, 10.2), and the noise model is only about right.
"""

from __future__ import annotations

import attrs
from nadrc_ros.tuning.identification.delays import Suggestion
from nadrc_ros.tuning.identification.predictor import Array, filtered, Form, Log
import numpy as np
from scipy.optimize import least_squares

# Noise bandwidth times period, up to which it is sought.
FASTEST_W_H = 2.5
# Of a period, from which a lateness counts.
SHORTEST_LATE = 0.02
# Of the record, up to which a lag is sought.
LONGEST_LAG = 0.1
FEW, MANY = 6, 40
TINY = 1e-10


@attrs.frozen(kw_only=True, eq=False)
class Fit:
    """A model with its parameters: b first, then those of :class:`Form`, then the linear ones."""

    form: Form
    bandwidth: float
    parameters: Array
    gain: float
    innovation: float
    rest: Array = attrs.field(factory=lambda: np.zeros(0))


def fit_direct(
    log: Log, form: Form, near: Fit | None = None, late: float = 1.0, rounds: int = MANY
) -> Fit:
    """
    Return the model with the smallest innovations, sought from a similar one.

    The parameters are sought in units of the time scale 1 / bandwidth of the start; ``late`` is
    where a delay or a lag that the similar model has not starts, in periods.
    """
    start = near.bandwidth if near else 0.1 / log.h
    unit = units(form, start, log.h)
    first = np.append(np.zeros(form.order), unit[form.order :] * late)
    if near:
        known = near.form.order + near.form.delayed
        first[:known] = near.parameters[:known]
        if near.form.lagging and form.lagging:
            first[-1] = near.parameters[-1]
    first = first / unit
    low, high = (bound / unit for bound in bounds(log, form))
    low, high = (
        np.append(low, -np.log(30.0)),
        np.append(high, np.log(FASTEST_W_H / (log.h * start))),
    )
    scale = float(np.std(np.diff(log.measurement))) or 1.0

    def innovations(theta: Array) -> Array:
        return eliminated(log, form, theta[:-1] * unit, start * np.exp(theta[-1]))[0] / scale

    theta = np.clip(np.append(first, 0.0), low, high)
    found = least_squares(
        innovations, theta, bounds=(low, high), ftol=1e-5, xtol=1e-5, gtol=1e-7, max_nfev=rounds
    )
    parameters, bandwidth = found.x[:-1] * unit, float(start * np.exp(found.x[-1]))
    e, linear = eliminated(log, form, parameters, bandwidth)
    return Fit(
        form=form,
        bandwidth=bandwidth,
        parameters=parameters,
        gain=float(linear[0]),
        innovation=float(np.sqrt(np.mean(e * e))),
        rest=linear[1:],
    )


def fit_delayed(log: Log, form: Form, start: Suggestion, rounds: int = FEW) -> Fit:
    """Return a model with a delay, sought from one that a regression suggests."""
    near = Fit(
        form=attrs.evolve(form, late=''),
        bandwidth=start.bandwidth,
        parameters=start.parameters,
        gain=0.0,
        innovation=0.0,
    )
    form = attrs.evolve(form, late='delay')
    return fit_direct(log, form, near, late=max(start.periods, 0.5), rounds=rounds)


def innovations_of(log: Log, fit: Fit) -> Array:
    """Return what the fit does not foresee, (N,), without the first ``lead`` rows."""
    output, command, rest = filtered(log, fit.form, fit.parameters, fit.bandwidth)
    return np.asarray(output - fit.gain * command - rest @ fit.rest)


def deviation(log: Log, fit: Fit, bandwidth: float) -> float:
    """Return the size of the fit's innovations behind another prefilter."""
    output, command, rest = filtered(log, fit.form, fit.parameters, bandwidth)
    left = output - fit.gain * command
    return float(np.sqrt(np.mean((left - rest @ np.linalg.lstsq(rest, left)[0]) ** 2)))


def units(form: Form, bandwidth: float, h: float) -> Array:
    """Return by how much parameters change much: of a plant of that bandwidth, and a period."""
    chain = 0.1 * bandwidth ** np.arange(form.order, 0, -1.0)
    return np.append(chain, np.full(form.free - form.order, h))


def bounds(log: Log, form: Form) -> tuple[Array, Array]:
    """Return bounds of the parameters: dynamics within a fraction of a period are none."""
    fastest = (3.0 / log.h) ** np.arange(form.order, 0, -1.0)
    longest = [max(log.lead, 1)] * form.delayed + [LONGEST_LAG * len(log.command)] * form.lagging
    shortest = np.full(len(longest), SHORTEST_LATE * log.h)
    return np.append(-fastest, shortest), np.append(fastest, np.array(longest) * log.h)


def eliminated(log: Log, form: Form, parameters: Array, bandwidth: float) -> tuple[Array, Array]:
    """Return the innovations with the best linear parameters, and those."""
    output, command, rest = filtered(log, form, parameters, bandwidth)
    columns = np.column_stack((command, rest))
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    linear = np.linalg.lstsq(columns / size, output, rcond=TINY)[0] / size
    return output - columns @ linear, linear
