"""
The estimate of b0 from closed-loop data, and an interval that stays honest.

1. Refined instrumental variables at the prefilter of a direct fit: the gradient of the prediction
   error is projected on what the reference alone explains of it, filtered alike (Young; Garnier
   and Young; Gilson and Van den Hof, Automatica 41, 2005, for the closed loop). Neither the noise
   nor a disturbance that does not go with the reference then shifts the estimate.
2. The covariance is robust against coloured and uneven residuals (Newey and West, Econometrica 55,
   1987), of several lag lengths the widest, each with the critical value that belongs to it
   (Kiefer and Vogelsang, Econometric Theory 21, 2005). A gain that varies widens it too.
3. There are more instruments than parameters. What they still explain of the residuals is what the
   model gets wrong in step with the reference (Sargan, Econometrica 26, 1958): if that is more
   than noise would leave, the interval is wider in that ratio (Birge, Physical Review 40, 1932).
"""

from __future__ import annotations

import attrs
from nadrc_ros.tuning.identification.fit import (
    bounds,
    eliminated,
    Fit,
    innovations_of,
    TINY,
    units,
)
from nadrc_ros.tuning.identification.instruments import answers, outside_space
from nadrc_ros.tuning.identification.predictor import Array, filtered, Form, Log
import numpy as np

Z95 = 1.959964
# Lag lengths of the robust covariance, as parts of the record.
LAGS = (0.0, 0.01, 0.03, 0.1, 0.2)
ITERATIONS = 8


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


def refine(log: Log, fit: Fit) -> tuple[Fit, list[Estimate]]:
    """
    Return the fit by instrumental variables, with estimates of b and of the form's parameters.

    Without a signal that moves the loop the gradients are their own instruments: least squares.
    """
    form, unit = fit.form, units(fit.form, fit.bandwidth, log.h)
    instruments = outside_space(log, form, fit.bandwidth, is_open(log, fit))
    low, high = bounds(log, form)
    parameters = fit.parameters
    linear = eliminated(log, form, parameters, fit.bandwidth)[1]
    space = None
    for last in range(ITERATIONS + 1):
        e, slopes = _slopes(log, form, parameters, linear, fit.bandwidth, unit)
        size = np.linalg.norm(slopes, axis=0)
        size[size == 0.0] = 1.0
        slopes = slopes / size
        basis = slopes
        if instruments is not None:
            space = _orthonormal(np.column_stack((instruments, slopes[:, 1 + form.free :])))
            basis = space @ (space.T @ slopes)
        inverse = np.linalg.pinv(basis.T @ slopes, rcond=TINY)
        if last == ITERATIONS:
            break
        step = -(inverse @ (basis.T @ e)) / size
        linear = linear + np.append(step[0], step[1 + form.free :])
        moved = parameters + np.clip(step[1 : 1 + form.free], -30.0 * unit, 30.0 * unit)
        parameters = np.clip(moved, low, high)
    weights = (basis @ inverse.T)[:, : 1 + form.free] / size[: 1 + form.free]
    wrong = 0.0 if space is None else _unexplained(space, e, slopes.shape[1])
    estimates = [
        Estimate(
            value=float(v),
            error=max(robust_error(w * e), wrong * float(np.linalg.norm(w))),
        )
        for v, w in zip(np.append(linear[0], parameters), weights.T)
    ]
    refined = attrs.evolve(
        fit,
        parameters=parameters,
        gain=float(linear[0]),
        rest=linear[1:],
        innovation=float(np.sqrt(np.mean(e * e))),
    )
    return refined, estimates


def is_open(log: Log, fit: Fit) -> bool:
    """Tell whether the command does not answer what the fit cannot foresee."""
    return not answers(log, innovations_of(log, fit))


def robust_error(influence: Array) -> float:
    """
    Return the standard error of a sum of correlated terms, (N,): the widest of several lags.

    Newey and West's Bartlett weights with lags up to a fifth of the record. A covariance of few
    independent parts is uncertain itself: the errors are those that make 1.96 of them the critical
    value of Kiefer and Vogelsang.
    """
    count = len(influence)
    spectrum = np.fft.rfft(influence, 2 * count)
    covariance = np.fft.irfft(spectrum * spectrum.conj())[:count]
    errors = []
    for b in LAGS:
        length = 1 + int(b * count)
        lag = np.arange(1, length)
        variance = covariance[0] + 2.0 * np.sum((1.0 - lag / length) * covariance[1:length])
        critical = Z95 + 2.9694 * b + 0.4160 * b**2 - 0.5324 * b**3
        errors.append(critical / Z95 * float(np.sqrt(max(variance, 0.0))))
    return max(errors)


def _unexplained(space: Array, e: Array, parameters: int) -> float:
    """Return the size of residuals in each direction of the instruments that is left over."""
    spare = space.shape[1] - parameters
    return float(np.linalg.norm(space.T @ e)) / spare**0.5 if spare > 0 else 0.0


def _slopes(
    log: Log, form: Form, parameters: Array, linear: Array, bandwidth: float, unit: Array
) -> tuple[Array, Array]:
    """Return e and its derivatives: for b, for the parameters (central), for the linear ones."""

    def error(values: Array) -> tuple[Array, Array]:
        output, command, rest = filtered(log, form, values, bandwidth)
        columns = np.column_stack((command, rest))
        return output - columns @ linear, columns

    e, columns = error(parameters)
    curved = []
    for i, step in enumerate(1e-4 * unit):
        moved = np.zeros(form.free)
        moved[i] = step
        curved.append((error(parameters + moved)[0] - error(parameters - moved)[0]) / (2 * step))
    return e, np.column_stack((-columns[:, :1], *curved, -columns[:, 1:]))


def _orthonormal(columns: Array) -> Array:
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    left, values, _ = np.linalg.svd(columns / size, full_matrices=False)
    return np.asarray(left[:, values > 1e-6 * values[0]])
