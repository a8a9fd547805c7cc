"""Which way a plant moves, as dry friction and backlash go by it, and how noisy its sensor is."""

from __future__ import annotations

from math import comb

from nadrc_ros.tuning.identification.predictor import Array
import numpy as np
from scipy.signal import savgol_filter

NOISE_DIFFERENCES = 4
# The median of |x| of a normal variable of deviation one.
MEDIAN = 0.67449
# Half lengths of the smoothing, in periods, of which the shortest that is quiet enough counts.
HALF_LENGTHS = (1, 2, 3, 5, 8, 12, 18, 27, 40)
# Up to that many deviations of its noise, and up to that part of its mean size, a rate is none.
NOISY, SLOW = 1.0, 0.01
# A rate is known where its noise is that part of its size.
QUIET = 0.05


def noise_deviation(measurement: Array) -> float:
    """
    Return the standard deviation of the measurement noise, from differences of order four.

    They leave nothing of a motion that is slow against the period and of white noise of variance
    v leave C(8, 4) v (von Neumann; Hall, Kay and Titterington, Biometrika 77, 1990). Their median
    does not see the kinks that a square reference makes. A coarse sensor, which gives the same
    value most of the time, has a median of nothing; there all differences count.
    """
    left = np.abs(np.diff(measurement, NOISE_DIFFERENCES))
    scale = float(np.sqrt(comb(2 * NOISE_DIFFERENCES, NOISE_DIFFERENCES)))
    middle = float(np.median(left)) / MEDIAN
    return (middle or float(np.sqrt(np.mean(left**2)))) / scale


def rate_of(measurement: Array, h: float) -> tuple[Array, float] | None:
    """Return the smoothed rate of change [1/s] and the deviation of its noise; None if unclear."""
    noise = noise_deviation(measurement)
    for half in HALF_LENGTHS:
        if 2 * half + 1 > len(measurement) // 10:
            return None
        rate: Array = savgol_filter(measurement, 2 * half + 1, 2, deriv=1, delta=h)
        deviation = noise / h * float(np.sqrt(3.0 / (half * (half + 1) * (2 * half + 1))))
        if deviation < QUIET * float(np.std(rate)):
            return rate, deviation
    return None


def direction(values: Array, deviation: float, noisy: float = NOISY) -> Array:
    """Return the sign of values whose noise has a deviation, and 0 where they are nearly zero."""
    least = max(noisy * deviation, SLOW * float(np.sqrt(np.mean(values**2))))
    return np.where(np.abs(values) > least, np.sign(values), 0.0)
