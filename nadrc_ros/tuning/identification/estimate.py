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
    RANK_TOLERANCE,
    units,
)
from nadrc_ros.tuning.identification.predictor import (
    Array,
    differences,
    filtered,
    Form,
    Log,
    noise_polynomial,
)
import numpy as np
from scipy.signal import lfilter
from scipy.stats import spearmanr

# Of 95 % of a normal variable.
Z95 = 1.959964
# Lag lengths of the robust covariance, as parts of the record.
_COVARIANCE_LAGS = (0.0, 0.01, 0.03, 0.1, 0.2)
_ITERATIONS = 8
# A step of a parameter is at most so many of its units.
_LONGEST_STEP = 30.0
# Poles of the instruments, relative to the noise bandwidth, and how many of each.
_INSTRUMENT_POLES, _INSTRUMENT_STAGES = (0.1, 0.3, 1.0), 5
# How many past changes make the habit of a command, and in how many rows it may answer.
_HABIT, _ROWS_TO_ANSWER = 6, 4
# Changes of the command below that part of the largest are none, and so many must be.
_STEADY_COMMAND, _FEWEST_CHANGES = 1e-6, 10
# Correlations of ranks that are an answer: larger than that, and than so many standard errors.
_RELATED, _CERTAIN = 0.2, 4.0


@attrs.frozen(kw_only=True)
class Estimate:
    """A number with its standard error."""

    value: float
    error: float

    @classmethod
    def between(cls, low: float, high: float) -> Estimate:
        """Return the estimate whose 95 % interval that is."""
        return cls(value=0.5 * (low + high), error=0.5 * (high - low) / Z95)

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

    With e(theta) the prediction error (N,), G = de/dtheta (N, p) and Z what the instruments
    explain of G, it solves Z' e = 0 by Gauss and Newton: theta -= (Z'G)^-1 Z' e. The prefilter of
    the fit stays. Without a signal that moves the loop the gradients are their own instruments:
    least squares.
    """
    form, unit = fit.form, units(fit.form, fit.bandwidth, log.h)
    instruments = outside_space(log, form, fit.bandwidth, is_open(log, fit))
    low, high = bounds(log, form)
    parameters = fit.parameters
    linear = eliminated(log, form, parameters, fit.bandwidth)[1]
    space = None
    for last in range(_ITERATIONS + 1):
        e, slopes = _slopes(log, form, parameters, linear, fit.bandwidth, unit)
        size = np.linalg.norm(slopes, axis=0)
        size[size == 0.0] = 1.0
        slopes = slopes / size
        basis = slopes
        if instruments is not None:
            # Initial state and dry friction are instruments of their own, as the reference does
            # not explain them. The projection combines all instruments to one for each parameter
            # (two-stage least squares): the more of G they explain, the narrower the interval.
            space = _orthonormal(np.column_stack((instruments, slopes[:, 1 + form.free :])))
            basis = space @ (space.T @ slopes)
        # Where the reference does not excite a direction, a truncated inverse leaves it alone.
        inverse = np.linalg.pinv(basis.T @ slopes, rcond=RANK_TOLERANCE)
        if last == _ITERATIONS:  # e and its slopes are those of the last step
            break
        step = -(inverse @ (basis.T @ e)) / size
        linear = linear + np.append(step[0], step[1 + form.free :])
        # e is no line in a, delay and lag: a weak instrument can ask for a step out of the world.
        step = np.clip(step[1 : 1 + form.free], -_LONGEST_STEP * unit, _LONGEST_STEP * unit)
        parameters = np.clip(parameters + step, low, high)
    # theta is off by the sum of weights times e: its variance is that of this sum, whatever e is.
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
        innovation=float(np.sqrt(np.mean(e * e))),
    )
    return refined, estimates


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
    for b in _COVARIANCE_LAGS:
        length = 1 + int(b * count)
        lag = np.arange(1, length)
        variance = covariance[0] + 2.0 * np.sum((1.0 - lag / length) * covariance[1:length])
        critical = Z95 + 2.9694 * b + 0.4160 * b**2 - 0.5324 * b**3
        errors.append(critical / Z95 * float(np.sqrt(max(variance, 0.0))))
    return max(errors)


def is_open(log: Log, fit: Fit) -> bool:
    """Tell whether the command does not answer what the fit cannot foresee: no loop is closed."""
    return not answers(log, innovations_of(log, fit))


def answers(log: Log, innovations: Array) -> bool:
    """
    Tell whether the command answers the measurement, as in a closed loop.

    A surprise of the measurement is then one of the command in that row or in the next ones. The
    command's is what it does not do by its own habit, an autoregression of its changes; ranks
    keep a step of the reference from hiding it.
    """
    moved = np.diff(log.command)
    past = np.column_stack([moved[_HABIT - k - 1 : -k - 1] for k in range(_HABIT)])
    new = moved[_HABIT:]
    new = new - past @ np.linalg.lstsq(past, new)[0]
    count = min(len(new), len(innovations))
    new, surprise = new[-count:], innovations[-count:]
    changed = np.abs(new) > _STEADY_COMMAND * np.abs(new).max()
    for late in range(_ROWS_TO_ANSWER):
        used = changed[late:]
        if used.sum() < _FEWEST_CHANGES:
            return False
        related = abs(spearmanr(new[late:][used], surprise[: count - late][used]).statistic)
        if related > max(_RELATED, _CERTAIN / float(np.sqrt(used.sum()))):
            return True
    return False


def outside_space(log: Log, form: Form, bandwidth: float, open_loop: bool) -> Array | None:
    """
    Return what the reference, in an open loop the command, can have caused: (N, columns).

    The signal prefiltered as the model is, through chains of all-pass filters behind lags of
    several speeds (Laguerre's functions; Wahlberg, IEEE Trans. Automatic Control 36, 1991): they
    stand for its derivatives, and are not spoiled by a row that repeats the one before. A loop
    that starts away from its reference is stepped by it. None if there is no such signal.
    """
    if log.reference_moves:
        signal = log.reference - log.measurement[0]
    elif open_loop:
        signal = log.command - log.command[0]
    else:
        return None
    moved = lfilter(differences(form.smoothness), noise_polynomial(form, bandwidth, log.h), signal)
    columns = [moved]
    for ratio in _INSTRUMENT_POLES:
        pole = np.exp(-ratio * bandwidth * log.h)
        stage = lfilter([1.0 - pole], [1.0, -pole], moved)
        for _ in range(_INSTRUMENT_STAGES):
            columns.append(stage)
            stage = lfilter([-pole, 1.0], [1.0, -pole], stage)
    return np.column_stack(columns)[log.lead :]


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
    """Return an orthonormal basis of what the columns span, to rounding errors."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    left, values, _ = np.linalg.svd(columns / size, full_matrices=False)
    return np.asarray(left[:, values > 1e-6 * values[0]])
