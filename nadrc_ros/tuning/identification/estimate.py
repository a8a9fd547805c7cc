"""
The estimate of b0 from closed-loop data, and an interval that stays honest.

1. Direct prediction error method: the parameters and the noise bandwidth that make the innovations
   smallest (Ljung 1999, 7.2; b and the initial state drop out by variable projection, Golub and
   Pereyra 1973). It says how fast the disturbance moves and how smooth it is. Its b is biased: in
   a closed loop the command answers the disturbance (Soderstrom and Stoica, System Identification,
   1989, 10.2), and C is only about right.
2. Refined instrumental variables at that prefilter: the gradient of the prediction error is
   projected on what the reference alone explains of it, filtered alike (Young; Garnier and Young;
   Gilson and Van den Hof, Automatica 41, 2005, for the closed loop). Neither the noise nor a
   disturbance that does not go with the reference then shifts the estimate.
3. The covariance is robust against coloured and uneven residuals (Newey and West, Econometrica 55,
   1987), of several lag lengths the widest. A gain that varies, or a plant that is not linear,
   widens it too.
"""

from __future__ import annotations

import attrs
from nadrc_ros.tuning.identification.predictor import (
    Array,
    differences,
    filtered,
    Form,
    Log,
    noise_polynomial,
)
import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

Z95 = 1.959964
# Lag lengths of the robust covariance, as parts of the record.
LAGS = (0.0, 0.01, 0.03, 0.1)
# Poles of the instruments, relative to the noise bandwidth.
INSTRUMENT_POLES = (0.1, 0.3, 1.0)
# Of the noise bandwidth, up to which it is sought.
FASTEST_W_H = 2.5
# Delays from which the search starts, and ends of it, in periods.
DELAYS = (1.0, 3.0, 6.0, 12.0, 24.0)
SHORTEST_LATE, LONGEST_DELAY = 0.02, 40.0
ITERATIONS = 8
TINY = 1e-10


@attrs.frozen(kw_only=True, eq=False)
class Fit:
    """A model with its parameters: b first, then those of :class:`Form`, then the initial ones."""

    form: Form
    bandwidth: float
    parameters: Array
    gain: float
    innovation: float
    rest: Array = attrs.field(factory=lambda: np.zeros(0))


@attrs.frozen(kw_only=True)
class Estimate:
    """A number with its standard error."""

    value: float
    error: float

    @property
    def low(self) -> float:
        """Return the lower end of the 95 % interval."""
        return self.value - Z95 * self.error

    @property
    def high(self) -> float:
        """Return the upper end of the 95 % interval."""
        return self.value + Z95 * self.error

    @property
    def half_width(self) -> float:
        """Return half the width of the 95 % interval, relative to the value."""
        return Z95 * self.error / abs(self.value) if self.value else float('inf')


def fit_late(log: Log, near: Fit) -> list[Fit]:
    """Return the best model with a delay, sought from several delays, and that with a lag."""
    delay, lag = (attrs.evolve(near.form, late=late) for late in ('delay', 'lag'))
    tried = [fit_direct(log, delay, near, late=k, rounds=6) for k in DELAYS]
    start = min(tried, key=lambda fit: fit.innovation)
    return [fit_direct(log, delay, start), fit_direct(log, lag, near)]


def fit_direct(
    log: Log, form: Form, near: Fit | None = None, late: float = 1.0, rounds: int = 40
) -> Fit:
    """
    Return the model with the smallest innovations, sought from a similar one.

    The parameters are sought in units of the time scale 1 / bandwidth of the start; ``late`` is
    where the lateness starts if the similar model has none, in periods.
    """
    n, start = form.order, near.bandwidth if near else 0.1 / log.h
    unit = _units(form, start, log.h)
    first = np.append(near.parameters[:n] if near else np.zeros(n), unit[n:] * late) / unit
    if near and near.form.late == form.late:
        first = near.parameters / unit
    fastest = _fastest(form, log.h) / unit[:n]
    limits = [-fastest, fastest]
    if form.late:
        limits = [
            np.append(limits[0], SHORTEST_LATE),
            np.append(limits[1], _latest(form, start, log.h)),
        ]
    low, high = (
        np.append(limits[0], -np.log(30.0)),
        np.append(limits[1], np.log(FASTEST_W_H / (log.h * start))),
    )
    scale = float(np.std(np.diff(log.measurement))) or 1.0

    def innovations(theta: Array) -> Array:
        return _eliminated(log, form, theta[:-1] * unit, start * np.exp(theta[-1]))[0] / scale

    theta = np.clip(np.append(first, 0.0), low, high)
    found = least_squares(
        innovations, theta, bounds=(low, high), ftol=1e-5, xtol=1e-5, gtol=1e-7, max_nfev=rounds
    )
    parameters, bandwidth = found.x[:-1] * unit, float(start * np.exp(found.x[-1]))
    e, linear = _eliminated(log, form, parameters, bandwidth)
    return Fit(
        form=form,
        bandwidth=bandwidth,
        parameters=parameters,
        gain=float(linear[0]),
        innovation=float(np.sqrt(np.mean(e * e))),
        rest=linear[1:],
    )


def refine(log: Log, fit: Fit) -> tuple[Fit, list[Estimate]]:
    """
    Return the fit by instrumental variables, with estimates of b and of the form's parameters.

    Without a reference that moves the loop the gradients are their own instruments: least squares.
    """
    form, unit = fit.form, _units(fit.form, fit.bandwidth, log.h)
    instruments = reference_space(log, form, fit.bandwidth)
    parameters, linear = fit.parameters.copy(), np.append(fit.gain, fit.rest)
    for last in range(ITERATIONS + 1):
        e, slopes = _slopes(log, form, parameters, linear, fit.bandwidth, unit)
        size = np.linalg.norm(slopes, axis=0)
        size[size == 0.0] = 1.0
        slopes = slopes / size
        basis = slopes
        if instruments is not None:
            basis = _projected(slopes, np.column_stack((instruments, slopes[:, 1 + form.free :])))
        inverse = np.linalg.pinv(basis.T @ slopes, rcond=TINY)
        if last == ITERATIONS:
            break
        step = -(inverse @ (basis.T @ e)) / size
        linear = linear + np.append(step[0], step[1 + form.free :])
        moved = parameters + np.clip(step[1 : 1 + form.free], -30.0 * unit, 30.0 * unit)
        parameters = _kept_inside(form, moved, fit.bandwidth, log.h)
    influence = (basis @ inverse.T)[:, : 1 + form.free] * e[:, None] / size[: 1 + form.free]
    values = np.append(linear[0], parameters)
    estimates = [
        Estimate(value=float(v), error=robust_error(p)) for v, p in zip(values, influence.T)
    ]
    refined = attrs.evolve(
        fit,
        parameters=parameters,
        gain=float(linear[0]),
        rest=linear[1:],
        innovation=float(np.sqrt(np.mean(e * e))),
    )
    return refined, estimates


def robust_error(influence: Array) -> float:
    """
    Return the standard error of a sum of correlated terms, (N,): the widest of several lags.

    Newey and West's Bartlett weights, with lags of 0 up to a tenth of the record.
    """
    count = len(influence)
    spectrum = np.fft.rfft(influence, 2 * count)
    covariance = np.fft.irfft(spectrum * spectrum.conj())[:count]
    variances = []
    for part in LAGS:
        length = 1 + int(part * count)
        lag = np.arange(1, length)
        variances.append(covariance[0] + 2.0 * np.sum((1.0 - lag / length) * covariance[1:length]))
    return float(np.sqrt(max(variances)))


def reference_space(log: Log, form: Form, bandwidth: float) -> Array | None:
    """
    Return what the reference can have caused, (N, columns), None if it does not move.

    The reference and its derivatives up to n, prefiltered as the model is, and each through lags
    of several speeds. A loop that starts away from its reference is stepped by it.
    """
    if not log.reference_moves:
        return None
    away = log.reference - log.measurement[0]
    poles = noise_polynomial(form, bandwidth, log.h)
    moved = lfilter(differences(form.smoothness), poles, away)
    columns = []
    for _ in range(form.order + 1):
        columns.append(moved)
        for ratio in INSTRUMENT_POLES:
            pole = np.exp(-ratio * bandwidth * log.h)
            columns.append(lfilter([1.0 - pole], [1.0, -pole], moved))
        moved = np.diff(moved, prepend=0.0) / log.h
    return np.column_stack(columns)


def _eliminated(log: Log, form: Form, parameters: Array, bandwidth: float) -> tuple[Array, Array]:
    """Return the innovations with the best b and initial state, and those."""
    output, command, initial = filtered(log, form, parameters, bandwidth)
    columns = np.column_stack((command, initial))
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    linear = np.linalg.lstsq(columns / size, output, rcond=TINY)[0] / size
    return output - columns @ linear, linear


def _slopes(
    log: Log, form: Form, parameters: Array, linear: Array, bandwidth: float, unit: Array
) -> tuple[Array, Array]:
    """Return e and its derivatives: for b, for the parameters (central), for the initial state."""

    def error(values: Array) -> tuple[Array, Array]:
        output, command, initial = filtered(log, form, values, bandwidth)
        columns = np.column_stack((command, initial))
        return output - columns @ linear, columns

    e, columns = error(parameters)
    curved = []
    for i, step in enumerate(1e-4 * unit):
        moved = np.zeros(form.free)
        moved[i] = step
        curved.append((error(parameters + moved)[0] - error(parameters - moved)[0]) / (2 * step))
    return e, np.column_stack((-columns[:, :1], *curved, -columns[:, 1:]))


def _projected(slopes: Array, instruments: Array) -> Array:
    size = np.linalg.norm(instruments, axis=0)
    size[size == 0.0] = 1.0
    left, values, _ = np.linalg.svd(instruments / size, full_matrices=False)
    left = left[:, values > 1e-6 * values[0]]
    projected: Array = left @ (left.T @ slopes)
    return projected


def _units(form: Form, bandwidth: float, h: float) -> Array:
    chain = 0.1 * bandwidth ** np.arange(form.order, 0, -1.0)
    return np.append(chain, h) if form.late else chain


def _fastest(form: Form, h: float) -> Array:
    """Return bounds of a_0..a_(n-1): dynamics within a fraction of a period are none."""
    return (3.0 / h) ** np.arange(form.order, 0, -1.0)


def _latest(form: Form, bandwidth: float, h: float) -> float:
    """Return the longest lateness in periods; a lag beyond is dynamics of the plant's own."""
    return LONGEST_DELAY if form.late == 'delay' else max(2.0 / (bandwidth * h), 2.0)


def _kept_inside(form: Form, parameters: Array, bandwidth: float, h: float) -> Array:
    fastest = _fastest(form, h)
    inside = np.append(
        np.clip(parameters[: form.order], -fastest, fastest), parameters[form.order :]
    )
    if form.late:
        inside[-1] = np.clip(inside[-1], SHORTEST_LATE * h, _latest(form, bandwidth, h) * h)
    return inside
