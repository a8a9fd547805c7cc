"""What a machine does when nothing is sent to it: rate, jitter, noise, drift."""

from __future__ import annotations

from math import sqrt

import attrs
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.tuning.commission.machine import Samples
from nadrc_ros.tuning.identification.log import noise_deviation
import numpy as np

_FEWEST = 20
_MOST_LOST = 0.2
# A sensor of which this share of the samples repeats the last one is a coarse one.
_REPEATS = 0.2
_CERTAIN = 4.0
_SECONDS = 20.0
# Samples that come more irregularly than this share of a period are told.
_IRREGULAR = 0.5


@attrs.frozen(kw_only=True, eq=False)
class Look:
    """
    What was seen: ``rate`` [Hz] of the samples, ``jitter`` of their times as a share of a period.

    ``age`` [s] from the stamp to the tick, nan without stamps; ``noise`` is the deviation of one
    sample, ``grain`` the step of a coarse sensor, 0 of a fine one [output unit]; ``lost`` the
    share of ticks without a sample; ``drift`` [output unit/s]; ``level``, the output.
    """

    samples: Samples
    rate: float
    jitter: float
    age: float
    noise: float
    grain: float
    lost: float
    drift: float
    drifts: bool
    level: float
    refusal: str = ''

    def homed(self, base: ExperimentSettings, sign: int) -> ExperimentSettings:
        """Return settings of which travel counts from here, for a machine of this sign of b0."""
        return attrs.evolve(base, noise=self.noise, homed=True, home=self.level, sign=sign)

    @property
    def lines(self) -> list[str]:
        """Say so."""
        late = '' if np.isnan(self.age) else f', {1e3 * self.age:.1f} ms old'
        grain = f', in steps of {self.grain:.3g}' if self.grain else ''
        lines = [
            f'Measurements: {self.rate:.4g} Hz, jitter {100 * self.jitter:.0f} % of a '
            f'period{late}, {100 * self.lost:.1f} % missing.',
            f'Output: {self.level:.4g}, noise {self.noise:.3g} (standard deviation){grain}.',
        ]
        if self.jitter > _IRREGULAR:
            lines.append(
                'They come irregularly: results become less certain. Is this computer busy?'
            )
        if self.drifts:
            lines.append(
                f'It drifts by {self.drift:+.3g} per second although the command rests: gravity, '
                'or another resting command is needed (--center).'
            )
        return [*lines, *filter(None, [self.refusal])]


def judge_look(samples: Samples, rate: float) -> Look:
    """Return what samples at rest tell, at a nominal ``rate`` [Hz]."""
    known = np.isfinite(samples.measurement)
    y, time = samples.measurement[known], samples.time[known]
    lost = 1.0 - float(known.mean()) if known.size else 1.0
    refusal = ''
    if known.sum() < _FEWEST:
        refusal = f'Only {int(known.sum())} measurements came: is the sensor running?'
    elif lost > _MOST_LOST:
        refusal = f'{100 * lost:.0f} % of the periods have no measurement: mend that first.'
    if known.sum() < 3:
        nothing = dict.fromkeys(('rate', 'jitter', 'age', 'noise', 'grain', 'drift', 'level'), 0.0)
        return Look(samples=samples, lost=lost, drifts=False, refusal=refusal, **nothing)
    stamps = samples.stamp[known]
    clock = stamps if np.isfinite(stamps).all() else time
    spans = np.diff(clock)
    steps = np.abs(np.diff(y))
    # A fit to samples that are all the same has a slope by rounding, and no noise to compare with.
    line = np.polyfit(time - time[0], y, 1) if steps.any() else np.array([0.0, y[0]])
    slope, left = float(line[0]), y - np.polyval(line, time - time[0])
    moved = steps[steps > 0.0]
    coarse = moved.size > 0 and float(np.mean(steps == 0.0)) > _REPEATS
    grain = float(moved.min()) if coarse else 0.0
    noise = max(float(np.std(left)), noise_deviation(y) if len(y) > 8 else 0.0, grain / sqrt(12.0))
    length = float(time[-1] - time[0])
    uncertain = noise * sqrt(12.0 / len(y)) / length if length > 0.0 else 0.0
    return Look(
        samples=samples,
        rate=1.0 / float(np.mean(spans)) if float(np.mean(spans)) > 0.0 else rate,
        jitter=float(np.std(spans)) * rate,
        age=float(np.median(time - stamps)),
        noise=noise,
        grain=grain,
        lost=lost,
        drift=slope,
        drifts=abs(slope) > _CERTAIN * uncertain and abs(slope) * _SECONDS > 6.0 * noise,
        level=float(np.median(y)),
        refusal=refusal,
    )
