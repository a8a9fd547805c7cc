"""
Dead times that a log suggests, all of them tried at once.

For each of several bandwidths the model is a regression: the filtered n-th derivative of the
output on its lower derivatives and on the command (state variable filters, Young; Garnier and
Wang, Springer, 2008). The command of every delay is the same signal shifted, so that correlations
by fast Fourier transform give the residual of all delays at the price of one. Noise biases each
of them, but hardly where the least one is; the models that start there are compared afterwards.
"""

from __future__ import annotations

import attrs
from nadrc_ros.tuning.identification.predictor import Array, butterworth, differences, Log
import numpy as np
from scipy.signal import lfilter

# Bandwidths of the filters times the period.
BANDWIDTHS = (0.01, 0.03, 0.1, 0.3, 1.0)
# Of the record, up to which a dead time is sought.
LONGEST = 0.25
# A delay is worth a try where it leaves less unexplained than none, by that factor.
WORTH = 0.99
# Valleys that differ by that part of their depth are one and the same.
NEAR = 0.05


@attrs.frozen(kw_only=True, eq=False)
class Suggestion:
    """A delay in periods, with the bandwidth [rad/s] and a_0..a_(n-1) of its regression."""

    periods: int
    bandwidth: float
    parameters: Array


def likely_delays(log: Log, order: int) -> list[Suggestion]:
    """Return the best delay of each bandwidth, of equal ones the first."""
    found: dict[int, Suggestion] = {}
    for ratio in BANDWIDTHS:
        best = _best(log, order, ratio / log.h)
        if best is not None:
            found.setdefault(best.periods, best)
    return list(found.values())


def _best(log: Log, order: int, bandwidth: float) -> Suggestion | None:
    count = len(log.command)
    longest = int(LONGEST * count)
    poles = butterworth(order + 1, bandwidth, log.h)
    gain = poles.sum()
    output = log.measurement - log.measurement[0]
    derivatives = [
        lfilter(gain * differences(i + 1) / log.h**i, poles, output)[longest:]
        for i in range(order + 1)
    ]
    command = lfilter(gain * differences(1), poles, log.command - log.command[0])
    known = np.column_stack(derivatives[:-1])
    basis, triangle = np.linalg.qr(known)
    target = derivatives[-1] - basis @ (basis.T @ derivatives[-1])
    with_basis = np.stack([_correlated(column, command, longest) for column in basis.T])
    with_target = _correlated(target, command, longest)
    power = np.concatenate(([0.0], np.cumsum(command**2)))
    starts = longest - np.arange(longest + 1)
    rest = power[count - np.arange(longest + 1)] - power[starts] - np.sum(with_basis**2, axis=0)
    explained = np.where(rest > 1e-6 * power[-1], with_target**2 / np.maximum(rest, 1e-300), 0.0)
    left = float(target @ target) - explained
    if not left.min() < WORTH * left[0]:
        return None
    periods = _first_low(left)
    slope = with_target[periods] / rest[periods]
    delayed = command[longest - periods : count - periods]
    parameters = np.linalg.lstsq(triangle, basis.T @ (derivatives[-1] - slope * delayed))[0]
    return Suggestion(periods=periods, bandwidth=bandwidth, parameters=parameters)


def _first_low(left: Array) -> int:
    """Return the first valley that is nearly as deep as the deepest; a period later is another."""
    deep = left <= left.min() + NEAR * (left[0] - left.min())
    first = int(np.argmax(deep))
    end = first + int(np.argmin(np.append(deep[first:], False)))
    return first + int(np.argmin(left[first:end]))


def _correlated(values: Array, command: Array, longest: int) -> Array:
    """Return the sums of values_t times command_(t - k) for k = 0..longest, t from longest on."""
    size = 1 << int(np.ceil(np.log2(2 * len(command))))
    padded = np.concatenate((np.zeros(longest), values))
    product = np.fft.rfft(padded, size) * np.fft.rfft(command, size).conj()
    return np.asarray(np.fft.irfft(product, size)[: longest + 1])
