"""
Measurement noise: Gaussian, zero mean, held over its own sample time, bit-reproducible.

Source: the paper (Abdul-Adheem & Ibraheem, nested linear extended state observers, section IV)
adds Gaussian noise of variance 1e-4 to the output and does not give the sample time of the noise.
"""

from __future__ import annotations

from math import inf, sqrt

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import integer, number, numbers
from nadrc_ros.adrc.settings import HIGHEST, LONGEST
import numpy as np
import numpy.typing as npt

# Of a whole number, relative: rounding makes a quotient miss it by a few units in the last place.
_NEARLY = 1e-12
_CHUNK = 65536


@attrs.frozen(kw_only=True)
class Noise:
    """What the noise is like; the same settings give the same bits on every machine."""

    variance: float = number(0.0, 0.0, HIGHEST**2, 'unit of y squared', 'variance of the noise')
    sample_time: float = number(
        0.0,
        0.0,
        LONGEST,
        's',
        'time each noise sample is held, 0 for a new one each period',
        live=False,
    )
    seed: int = integer(0, 0, 2**63 - 1, 'seed of the generator', live=False)
    derivative_variances: tuple[float, ...] = numbers(
        (0.0,),
        0.0,
        HIGHEST**2,
        "units of y', y'', ... squared",
        'variances of the noise on derivatives, as inner loops measure them; 0 for those left out',
    )

    def variance_of(self, derivative: int) -> float:
        """Return the variance of the noise on y^(derivative)."""
        return ([self.variance, *self.derivative_variances] + [0.0] * derivative)[derivative]

    @property
    def random(self) -> bool:
        """Tell whether there is any."""
        return self.variance > 0.0 or max(self.derivative_variances) > 0.0


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
    derivative
        Of what it is: y^(derivative), with random numbers of its own.

    """

    def __init__(self, noise: Noise, period: float, derivative: int = 0) -> None:
        if not 0.0 < period < inf:
            raise SettingError('period', period, 'a finite number of seconds, above 0')
        self.sample_time = noise.sample_time
        self.period = period
        self.set_variance(noise.variance_of(derivative))
        # Three numbers, as those of the faults are two.
        seed = (noise.seed, 0, derivative) if derivative else noise.seed
        self._generator = np.random.Generator(np.random.PCG64(seed))
        self._drawn = 0
        self._normal = 0.0

    def set_variance(self, variance: float) -> None:
        """Scale all that follows to another variance."""
        self._scale = sqrt(Noise(variance=variance).variance)

    def at(self, k: int) -> float:
        """Return the noise of period ``k`` = 0, 1, ..., never less than the one before."""
        return float(self.block(k, 1)[0])

    def block(self, k: int, count: int) -> npt.NDArray[np.float64]:
        """
        Return the noise of periods ``k`` to ``k + count - 1``, whatever the blocks: the same bits.

        A new sample is drawn when :func:`sample_indices` go up, and one for each index skipped.
        """
        if count < 1:
            return np.zeros(0)
        indices = sample_indices(k, count, self.period, self.sample_time)
        held = self._drawn - 1
        if indices[0] < held:
            raise ValueError(f'period {k} lies before one that was already read')
        missing = int(indices[-1]) - held
        # However the periods are cut into blocks, each sample is drawn once and in order: drawn
        # for one that nobody reads too, or a run that skips periods had other noise after it.
        if missing > count > 1:  # more samples than periods need not all be there at once
            return np.concatenate([self.block(i, 1) for i in range(k, k + count)])
        while count == 1 < missing:
            skipped = min(missing - 1, _CHUNK)
            self._generator.standard_normal(skipped)
            held, missing = held + skipped, missing - skipped
        normals = np.empty(missing + 1)
        normals[0] = self._normal
        self._generator.standard_normal(out=normals[1:])
        self._drawn = held + missing + 1
        self._normal = float(normals[-1])
        found: npt.NDArray[np.float64] = self._scale * normals[indices - held]
        return found


def sample_indices(k: int, count: int, period: float, sample_time: float) -> npt.NDArray[np.int64]:
    """
    Return floor(i period / sample_time) of ``count`` periods i from ``k`` on, i for no such time.

    A quotient within a relative 1e-12 of a whole number counts as that number.
    """
    periods = np.arange(k, k + count)
    if sample_time in (0.0, period):
        return periods
    quotient = periods * (period / sample_time)
    nearest = np.rint(quotient)
    near = np.abs(quotient - nearest) <= _NEARLY * quotient
    indices: npt.NDArray[np.int64] = np.where(near, nearest, np.floor(quotient)).astype(np.int64)
    return indices
