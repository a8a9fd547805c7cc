"""
Models of a log by the direct prediction error method, and the dead times worth a start.

The parameters and the noise bandwidth that make the innovations smallest (Ljung 1999, 7.2); b, dry
friction and the initial state drop out by variable projection (Golub and Pereyra 1973). They say
which structure the plant has, how late a command acts, how fast the disturbance moves and how
smooth it is. Their b is biased: in a closed loop the command answers the disturbance (Soderstrom
and Stoica, System Identification, 1989, 10.2), and the noise model is only about right.
"""

from __future__ import annotations

from math import nan

import attrs
from nadrc_ros.tuning.identification.predictor import (
    Array,
    butterworth,
    differences,
    filtered,
    Form,
    Log,
)
import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

# Noise bandwidth times period, up to which it is sought.
_FASTEST_NOISE = 2.5
# Of a period, from which a lateness counts, and of the record, up to which a lag is sought.
_SHORTEST_LATENESS, _LONGEST_LAG = 0.02, 0.1
# Rounds of the search, of a trial and of a model that counts.
TRIAL_ROUNDS, _MOST_ROUNDS = 6, 40
# Singular values below that part of the largest are none.
RANK_TOLERANCE = 1e-10
# Dead time: bandwidths of the filters times the period, and the longest one as part of the record.
_DELAY_BANDWIDTHS, _LONGEST_DELAY = (0.01, 0.03, 0.1, 0.3, 1.0), 0.25
# A delay is worth a try where it leaves less unexplained than none, by that factor.
_WORTH_A_TRY = 0.99
# Valleys that differ by that part of their depth are one and the same.
_EQUAL_DEPTH = 0.05


@attrs.frozen(kw_only=True, eq=False)
class Fit:
    """
    A model of a log.

    ``bandwidth`` is that of its noise model [rad/s], ``parameters`` (form.free,) are those of
    :class:`Form`, ``gain`` is its b and ``innovation`` the root mean square of what it does not
    foresee.
    """

    form: Form
    bandwidth: float
    parameters: Array
    gain: float = nan
    innovation: float = nan

    @property
    def delay(self) -> float:
        """Return the dead time [s]."""
        return float(self.parameters[self.form.order]) if self.form.delayed else 0.0


def fit_direct(log: Log, form: Form, near: Fit | None = None, rounds: int = _MOST_ROUNDS) -> Fit:
    """
    Return the model with the smallest innovations, sought from a similar one.

    The parameters are sought in units of the time scale 1 / bandwidth of the start. A delay or a
    lag that the similar model has not starts at one period.
    """
    start = near.bandwidth if near else 0.1 / log.h
    unit = units(form, start, log.h)
    first = np.append(np.zeros(form.order), unit[form.order :])
    if near:
        known = near.form.order + near.form.delayed
        first[:known] = near.parameters[:known]
        if near.form.lagging and form.lagging:
            first[-1] = near.parameters[-1]
    low, high = (bound / unit for bound in bounds(log, form))
    low = np.append(low, -np.log(30.0))
    high = np.append(high, np.log(_FASTEST_NOISE / (log.h * start)))
    scale = float(np.std(np.diff(log.measurement))) or 1.0

    def innovations(theta: Array) -> Array:
        return eliminated(log, form, theta[:-1] * unit, start * np.exp(theta[-1]))[0] / scale

    theta = np.clip(np.append(first / unit, 0.0), low, high)
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
    )


def eliminated(log: Log, form: Form, parameters: Array, bandwidth: float) -> tuple[Array, Array]:
    """
    Return the innovations e (N,) with the best linear parameters, and those: b, then the others.

    Rows of the log's lead are left out.
    """
    output, command, rest = filtered(log, form, parameters, bandwidth)
    columns = np.column_stack((command, rest))
    # Of unit length: in their own units the columns differ by powers of the bandwidth, and the
    # tolerance would take the small ones for none.
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    linear = np.linalg.lstsq(columns / size, output, rcond=RANK_TOLERANCE)[0] / size
    return output - columns @ linear, linear


def innovations_of(log: Log, fit: Fit) -> Array:
    """Return what the fit does not foresee, (N,), without the first ``lead`` rows."""
    return eliminated(log, fit.form, fit.parameters, fit.bandwidth)[0]


def deviation(log: Log, fit: Fit, bandwidth: float) -> float:
    """Return the size of the fit's innovations behind another prefilter [rad/s]."""
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
    longest = [max(log.lead, 1)] * form.delayed + [_LONGEST_LAG * len(log.command)] * form.lagging
    shortest = np.full(len(longest), _SHORTEST_LATENESS * log.h)
    return np.append(-fastest, shortest), np.append(fastest, np.array(longest) * log.h)


def likely_delays(log: Log, order: int) -> list[Fit]:
    """
    Return starts with the dead times that a log suggests, one for each of several filters.

    For each bandwidth the model is a regression: the filtered n-th derivative of the output on
    its lower derivatives and on the command (state variable filters, Young; Garnier and Wang,
    Springer, 2008). The command of every delay is the same signal shifted, so that correlations by
    fast Fourier transform give the residual of all delays at the price of one. Noise biases each
    of them, but hardly where the least one is. Of equal delays the first counts.
    """
    found: dict[float, Fit] = {}
    for ratio in _DELAY_BANDWIDTHS:
        best = _delayed_regression(log, order, ratio / log.h)
        if best is not None:
            found.setdefault(best.delay, best)
    return list(found.values())


def _delayed_regression(log: Log, order: int, bandwidth: float) -> Fit | None:
    count = len(log.command)
    longest = int(_LONGEST_DELAY * count)
    poles = butterworth(order + 1, bandwidth, log.h)
    gain = poles.sum()
    output = log.measurement - log.measurement[0]
    derivatives = [
        lfilter(gain * differences(i + 1) / log.h**i, poles, output)[longest:]
        for i in range(order + 1)
    ]
    command = lfilter(gain * differences(1), poles, log.command - log.command[0])
    # What the lower derivatives explain is taken out of the highest and of every shifted command;
    # of each shift, only the products with it are ever formed.
    basis, triangle = np.linalg.qr(np.column_stack(derivatives[:-1]))
    target = derivatives[-1] - basis @ (basis.T @ derivatives[-1])
    with_basis = np.stack([_correlated(column, command, longest) for column in basis.T])
    with_target = _correlated(target, command, longest)
    power = np.concatenate(([0.0], np.cumsum(command**2)))
    starts = longest - np.arange(longest + 1)
    rest = power[count - np.arange(longest + 1)] - power[starts] - np.sum(with_basis**2, axis=0)
    explained = np.where(rest > 1e-6 * power[-1], with_target**2 / np.maximum(rest, 1e-300), 0.0)
    left = float(target @ target) - explained
    if not left.min() < _WORTH_A_TRY * left[0]:
        return None
    periods = _first_valley(left)
    slope = with_target[periods] / rest[periods]
    delayed = command[longest - periods : count - periods]
    parameters = np.linalg.lstsq(triangle, basis.T @ (derivatives[-1] - slope * delayed))[0]
    return Fit(
        form=Form(order=order, late='delay'),
        bandwidth=bandwidth,
        parameters=np.append(parameters, max(periods, 0.5) * log.h),
    )


def _first_valley(left: Array) -> int:
    """
    Return the first valley that is nearly as deep as the deepest.

    Under a periodic command a delay that is a period of it longer is as good, and no delay.
    """
    deep = left <= left.min() + _EQUAL_DEPTH * (left[0] - left.min())
    first = int(np.argmax(deep))
    end = first + int(np.argmin(np.append(deep[first:], False)))
    return first + int(np.argmin(left[first:end]))


def _correlated(values: Array, command: Array, longest: int) -> Array:
    """Return the sums of values_t times command_(t - k) for k = 0..longest, t from longest on."""
    size = 1 << int(np.ceil(np.log2(2 * len(command))))
    padded = np.concatenate((np.zeros(longest), values))
    product = np.fft.rfft(padded, size) * np.fft.rfft(command, size).conj()
    return np.asarray(np.fft.irfft(product, size)[: longest + 1])
