"""
Measurement noise: Gaussian, zero mean, held over its own sample time, bit-reproducible.

Source: the paper (Abdul-Adheem & Ibraheem, nested linear extended state observers, section IV)
adds Gaussian noise of variance 1e-4 to the output and does not give the sample time of the noise.
"""

from __future__ import annotations

from math import floor, sqrt

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import integer, number
from nadrc_ros.adrc.settings import LARGEST, LONGEST
import numpy as np
import numpy.typing as npt

NEARLY = 1e-12
CHUNK = 65536


@attrs.frozen(kw_only=True)
class Noise:
    """What the noise is like; the same settings give the same bits on every machine."""

    variance: float = number(0.0, 0.0, LARGEST**2, 'unit of y squared', 'variance of the noise')
    sample_time: float = number(
        0.0,
        0.0,
        LONGEST,
        's',
        'time each noise sample is held, 0 for a new one each period',
        live=False,
    )
    seed: int = integer(0, 0, 2**63 - 1, 'seed of the generator', live=False)


class NoiseSource:
    """
    The noise of one run, read period by period.

    Standard normals are drawn and then scaled, so that a change of the variance leaves the
    sequence as it is.

    Parameters
    ----------
    noise
        The settings.
    period
        Time between two periods [s].

    """

    def __init__(self, noise: Noise, period: float) -> None:
        _check_period(period)
        self.sample_time = noise.sample_time
        self.period = period
        self.set_variance(noise.variance)
        self._generator = _generator(noise.seed)
        self._drawn = 0
        self._normal = 0.0

    def set_variance(self, variance: float) -> None:
        """Scale all that follows to another variance."""
        self._scale = sqrt(Noise(variance=variance).variance)

    def at(self, k: int) -> float:
        """
        Return the noise of period ``k`` = 0, 1, ..., never less than the one before.

        A new sample is drawn when :func:`sample_index` goes up, and one for each index skipped.
        """
        missing = sample_index(k, self.period, self.sample_time) + 1 - self._drawn
        if missing < 0:
            raise ValueError(f'period {k} lies before one that was already read')
        self._drawn += missing
        while missing > 1:
            chunk = min(missing - 1, CHUNK)
            self._generator.standard_normal(chunk)
            missing -= chunk
        if missing:
            self._normal = float(self._generator.standard_normal())
        return self._scale * self._normal

    def block(self, k: int, count: int) -> npt.NDArray[np.float64]:
        """Return the noise of periods ``k`` to ``k + count - 1``: the bits that ``at`` gives."""
        if count < 1:
            return np.zeros(0)
        indices = _sample_indices(k, count, self.period, self.sample_time)
        held = self._drawn - 1
        missing = int(indices[-1]) - held
        if missing > count or indices[0] < held:  # many are skipped, or `at` refuses
            return np.array([self.at(i) for i in range(k, k + count)])
        normals = np.empty(missing + 1)
        normals[0] = self._normal
        self._generator.standard_normal(out=normals[1:])
        self._drawn += missing
        self._normal = float(normals[-1])
        found: npt.NDArray[np.float64] = self._scale * normals[indices - held]
        return found


def sample_index(k: int, period: float, sample_time: float) -> int:
    """
    Return floor(k period / sample_time), or ``k`` if the sample time is 0.

    Rounding makes the quotient miss a whole number by a few units in the last place, so one within
    a relative 1e-12 of a whole number counts as that number.
    """
    if sample_time == 0.0:
        return k
    quotient = k * (period / sample_time)
    nearest = round(quotient)
    return nearest if abs(quotient - nearest) <= NEARLY * quotient else floor(quotient)


def noise_sequence(noise: Noise, period: float, count: int) -> npt.NDArray[np.float64]:
    """Return the noise of periods 0 to ``count`` - 1: the same bits as reading them one by one."""
    return NoiseSource(noise, period).block(0, count)


def _sample_indices(
    k: int, count: int, period: float, sample_time: float
) -> npt.NDArray[np.int64]:
    """Return :func:`sample_index` of ``count`` periods from ``k`` on."""
    periods = np.arange(k, k + count)
    if sample_time in (0.0, period):
        return periods
    quotient = periods * (period / sample_time)
    nearest = np.rint(quotient)
    near = np.abs(quotient - nearest) <= NEARLY * quotient
    indices: npt.NDArray[np.int64] = np.where(near, nearest, np.floor(quotient)).astype(np.int64)
    return indices


def _generator(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def _check_period(period: float) -> None:
    if not 0.0 < period < float('inf'):
        raise SettingError('period', period, 'a finite number of seconds, above 0')
