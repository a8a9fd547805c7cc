"""Doublets that stay inside the bounds, sized by the model so far, until b0 is known enough."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import attrs
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST
from nadrc_ros.tuning.commission.fit import arriving, fit, Fitted, Segment, with_mode
from nadrc_ros.tuning.commission.machine import Samples, Simulated
from nadrc_ros.tuning.commission.model import Model, ModelPlant
from nadrc_ros.tuning.commission.nudge import best
from nadrc_ros.tuning.identification.estimate import Estimate
import numpy as np

# Half the width of the interval of b0 that is narrow enough, of b0.
NARROW = 0.1
# Residuals of so many times the noise are worth another search.
_BAD = 1.3
# What is enough to go on with where there is no more: the loop bears a factor of two.
ACCEPTABLE = 0.25
# What no model is better than, of b0: the machine is not quite it.
_LEAST_ERROR = 0.01
# Shares of the bounds that a doublet may take by the model, and of the command.
_TRAVEL, _SPEED, _COMMAND = 0.35, 0.45, 0.9
# Segments of more than that share of the largest command are fitted, where there are so many.
_LARGE, _FEWEST = 0.5, 10
# Lengths of the shortest pulse that are tried [periods], and how many times the dead time it is.
_LENGTHS, _LATE = (6, 9, 13, 20, 30, 45, 70, 100, 150), 1.5
# Of the bounds, what an experiment may take where the model runs it; how often it is made smaller,
# and by what factors.
_FORESEEN, _TRIES, _LEAST, _MOST = 0.55, 6, 0.4, 0.9
# Amplitudes that are tried, as shares of the largest; motion over noise that is enough.
_SIZES, _CLEAR = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.05), 40.0


@attrs.frozen(kw_only=True, eq=False)
class Excitation:
    """What the doublets tell: the model and its intervals from all segments so far."""

    samples: tuple[Samples, ...]
    fitted: Fitted
    noise: float
    refusal: str = ''

    @property
    def seconds(self) -> float:
        """Return how long it was moved [s]."""
        return sum(float(each.time[-1] - each.time[0]) for each in self.samples)

    @property
    def b0(self) -> Estimate:
        """Return b0 with an interval that allows for what the model does not explain."""
        fitted = self.fitted
        least = _LEAST_ERROR * abs(fitted.b0.value)
        return attrs.evolve(fitted.b0, error=float(np.hypot(fitted.b0.error, least)))

    @property
    def narrow(self) -> bool:
        """Tell whether b0 is known well enough, from enough pulses to know how well."""
        return self.b0.half_width <= NARROW and len(self.fitted.segments) >= _FEWEST

    @property
    def lines(self) -> list[str]:
        """Say so."""
        b0 = self.b0
        lines = [
            f'After {self.seconds:.3g} s of pulses: order {self.fitted.model.order}, b0 '
            f'{b0.value:.4g} (95 %: {b0.low:.4g} to {b0.high:.4g}).'
            if self.samples
            else f'From the nudge alone: order {self.fitted.model.order}, b0 {b0.value:.4g} '
            f'(95 %: {b0.low:.4g} to {b0.high:.4g}).'
        ]
        return [*lines, *filter(None, [self.refusal])]


def sized(model: Model, base: ExperimentSettings) -> ExperimentSettings | None:
    """Return the doublets that this model says are clear of the noise and inside the bounds."""
    room = _COMMAND * min(base.highest - base.center, base.center - base.lowest)
    chosen, most = None, 0.0
    if room <= 0.0:  # an actuator that pushes only
        return None
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


def inside(
    planned: ExperimentSettings,
    controller: ControllerSettings | None,
    model: Model,
    away: float,
    present: ControllerSettings,
) -> ExperimentSettings | None:
    """
    Return the experiment, smaller where the model comes near its bounds; None if it always does.

    It begins where the machine is, ``away`` [output unit] from where travel counts from, and the
    controller that catches the machine moves it, too.
    """
    for _ in range(_TRIES):
        plant = ModelPlant(model, planned.period, planned.center, 0.0, 0, away)
        foreseen = Simulated(plant, 1.0 / planned.period, present).run(
            attrs.evolve(planned, homed=True, home=0.0), controller
        )
        y = np.array(plant.outputs)
        farthest, fastest = np.abs(y).max(), np.abs(np.diff(y)).max() / planned.period
        share = float(max(farthest / planned.travel, fastest / planned.speed)) / _FORESEEN
        if share <= 1.0 and foreseen.outcome != 'bound':
            return planned
        # what friction takes moves nothing
        dry = min(model.friction, planned.amplitude)
        smaller = dry + min(max(1.0 / share, _LEAST), _MOST) * (planned.amplitude - dry)
        planned = attrs.evolve(planned, amplitude=smaller)
    return None


def _response(model: Model, size: float, periods: int, h: float) -> tuple[float, float, float]:
    """Return rms, travel and speed of the longest doublet of one size and way, and the other."""
    pulse = 4 * periods
    doublet = [size] * pulse + [-size] * (2 * pulse) + [size] * pulse + [0.0] * periods
    y = np.zeros(1)
    edges = h * np.arange(len(doublet), dtype=np.float64)
    for way in (1.0, -1.0):
        sent = way * h * np.append(0.0, np.cumsum(doublet[:-1]))
        y = np.append(
            y, model.outputs(arriving(edges, sent, model.delay, len(doublet), h), h, 0.0, 0.0)
        )
    if not np.abs(y).max() < HIGHEST:  # it runs away
        return inf, inf, inf
    speed = np.abs(np.diff(y[: len(doublet)])).max() / h
    return float(np.sqrt(np.mean(y**2))), float(np.abs(y).max()), float(speed)


def telling(segments: Sequence[Segment]) -> Sequence[Segment]:
    """
    Return the segments with the largest commands, all where these are few.

    Friction is most of what a machine does just above its breakaway, and no model is right there.
    """
    most = max(each.size for each in segments)
    large = [each for each in segments if each.size > _LARGE * most]
    return large if len(large) >= _FEWEST else segments


def refined(
    start: Fitted,
    segments: Sequence[Segment],
    samples: tuple[Samples, ...],
    base: ExperimentSettings,
    pace: float,
    size: float,
    latest: float,
    stop: float | None,
) -> Excitation:
    """Return what all segments tell, from the model before."""
    segments = telling(segments)
    fitted = fit(segments, start.model, base.period, pace, size, latest, base.noise)
    model = fitted.model
    # another search, from all that is known by now
    if len(samples) == 1 or fitted.residual > _BAD * base.noise:
        dry = max(model.friction, 0.1 * size)
        other = best(segments, dry, base.period, pace, size, base.sign, latest, base.noise, stop)
        if other is not None and other.residual < fitted.residual:
            fitted = other
    fitted = _with_mode(fitted, base, pace, size, latest)
    return Excitation(samples=samples, fitted=fitted, noise=base.noise)


def _with_mode(
    fitted: Fitted, base: ExperimentSettings, pace: float, size: float, latest: float
) -> Fitted:
    """Return the model with a mode beside it, if that explains more than chance does."""
    start = with_mode(fitted, base.period) if not fitted.model.mode_frequency else None
    if start is None:
        return fitted
    swinging = fit(fitted.segments, start, base.period, pace, size, latest, base.noise)
    return swinging if swinging.residual < fitted.residual else fitted
