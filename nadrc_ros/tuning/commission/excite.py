"""Doublets that stay inside the bounds, sized by the model so far, until b0 is known enough."""

from __future__ import annotations

from collections.abc import Sequence

import attrs
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.tuning.commission.fit import fit, Fitted, Segment
from nadrc_ros.tuning.commission.machine import Samples
from nadrc_ros.tuning.commission.model import Model
from nadrc_ros.tuning.commission.nudge import best
from nadrc_ros.tuning.identification.estimate import Estimate
import numpy as np

# Half the width of the interval of b0 that is narrow enough, of b0.
NARROW = 0.1
# Residuals of so many times the noise are worth another search.
_BAD = 1.3
# What is enough to go on with where there is no more: the loop bears a factor of two.
ACCEPTABLE = 0.25
# What no model is better than, of b0, twice that with friction: the machine is not quite it.
_LEAST_ERROR = 0.01
# Of a motion that is hardly more than its noise the slopes tell too little of the uncertainty.
_FAINT = 0.15
# Shares of the bounds that a doublet may take by the model, and of the command.
_TRAVEL, _SPEED, _COMMAND = 0.35, 0.45, 0.9
# Lengths of the shortest pulse that are tried [periods], and how many times the dead time it is.
_LENGTHS, _LATE = (6, 9, 13, 20, 30, 45, 70, 100, 150), 1.5
# Amplitudes that are tried, as shares of the largest; motion over noise that is enough.
_SIZES, _CLEAR = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.05), 40.0


@attrs.frozen(kw_only=True, eq=False)
class Excitation:
    """What the doublets tell: the model and its intervals from all segments so far."""

    samples: tuple[Samples, ...]
    segments: tuple[Segment, ...]
    fitted: Fitted
    noise: float
    seconds: float
    refusal: str = ''

    @property
    def b0(self) -> Estimate:
        """Return b0 with an interval that allows for what the model does not explain."""
        fitted = self.fitted
        strange = max(fitted.residual / self.noise, 1.0) if self.noise > 0.0 else 1.0
        least = _LEAST_ERROR * (2.0 if fitted.model.friction > 0.0 else 1.0)
        least += _FAINT * fitted.residual / max(fitted.moved, fitted.residual)
        least *= abs(fitted.b0.value)
        return attrs.evolve(fitted.b0, error=float(np.hypot(strange * fitted.b0.error, least)))

    @property
    def narrow(self) -> bool:
        """Tell whether b0 is known well enough."""
        return self.b0.half_width <= NARROW

    @property
    def lines(self) -> list[str]:
        """Say so."""
        b0 = self.b0
        lines = [
            f'After {self.seconds:.3g} s of pulses: order {self.fitted.model.order}, b0 '
            f'{b0.value:.4g} (95 %: {b0.low:.4g} to {b0.high:.4g}).'
            if self.samples
            else f'The nudge told enough: order {self.fitted.model.order}, b0 {b0.value:.4g} '
            f'(95 %: {b0.low:.4g} to {b0.high:.4g}).'
        ]
        return [*lines, *filter(None, [self.refusal])]


def sized(model: Model, base: ExperimentSettings) -> ExperimentSettings | None:
    """Return the doublets that this model says are clear of the noise and inside the bounds."""
    room = _COMMAND * min(base.highest - base.center, base.center - base.lowest)
    chosen, most = None, 0.0
    for periods in _LENGTHS:
        length = periods * base.period
        if length < _LATE * model.delay or 14.0 * length > base.longest:
            continue
        for share in _SIZES:
            size = share * room
            rms, farthest, fastest = _response(model, size, periods, base.period)
            if farthest > _TRAVEL * base.travel or fastest > _SPEED * base.speed:
                continue
            clear = rms / max(base.noise, 1e-6 * base.travel)
            if clear > 1.2 * most:
                most = clear
                chosen = attrs.evolve(base, kind='doublet', amplitude=size, segment=length)
            break
        if most > _CLEAR:
            break
    return chosen


def _response(model: Model, size: float, periods: int, h: float) -> tuple[float, float, float]:
    """Return rms, travel and speed of the longest doublet of one size and way, and the other."""
    lead = model.lead(h)
    pulse = 4 * periods
    doublet = [size] * pulse + [-size] * (2 * pulse) + [size] * pulse + [0.0] * periods
    y = np.zeros(1)
    for way in (1.0, -1.0):
        commands = [0.0] * lead + [way * each for each in doublet]
        found, _ = model.response(commands, h)
        y = np.append(y, found)
    speed = np.abs(np.diff(y[: len(doublet)])).max() / h
    return float(np.sqrt(np.mean(y**2))), float(np.abs(y).max()), float(speed)


def refined(
    start: Fitted,
    segments: Sequence[Segment],
    samples: tuple[Samples, ...],
    base: ExperimentSettings,
    pace: float,
    size: float,
    seconds: float,
) -> Excitation:
    """Return what all segments tell, from the model before."""
    fitted = fit(segments, start.model, base.period, pace, size)
    model = fitted.model
    # another search, from all that is known by now
    if len(samples) == 1 or fitted.residual > _BAD * base.noise:
        stop = 1.0 if model.low == 0.0 else -1.0 if model.high == 0.0 else None
        dry = max(model.friction, 0.1 * size)
        other = best(segments, dry, base.period, pace, size, base.sign, stop)
        if other is not None and other.residual < fitted.residual:
            fitted = other
    return Excitation(
        samples=samples,
        segments=tuple(segments),
        fitted=fitted,
        noise=base.noise,
        seconds=seconds,
    )
