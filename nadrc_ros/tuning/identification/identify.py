"""
The plant behind a log: order, input gain b0 with its 95 % interval, damping, lateness, noise.

Assumed: y^(n) = b0 u + a . (y, ..., y^(n-1)) + d, with a disturbance that is slow against the
noise bandwidth and does not go with the reference, white measurement noise, and a command held
over each period; dead time, one lag, dry friction or backlash where the log shows them. What does
not fit (gains that vary, stiffness that bends, more lags) is part of d and widens the interval.
Method and sources: :mod:`nadrc_ros.tuning.identification.candidates` and
:mod:`nadrc_ros.tuning.identification.estimate`; for filters and polynomial models of continuous
time also Unbehauen and Rao (Automatica 26, 1990) and Garnier and Wang (Springer, 2008).
"""

from __future__ import annotations

from collections.abc import Sequence

import attrs
from nadrc_ros.records.recording import RecordingError
from nadrc_ros.tuning.identification.candidates import (
    candidates,
    explored,
    simplest,
    with_room,
    with_ways,
)
from nadrc_ros.tuning.identification.estimate import Estimate, is_open, refine, Z95
from nadrc_ros.tuning.identification.fit import deviation, Fit
from nadrc_ros.tuning.identification.log import ADVICE, is_one_sine, noise_deviation
from nadrc_ros.tuning.identification.predictor import Log
import numpy as np

_ORDERS = (1, 2, 3)
# Bandwidths of the prefilters that are tried, relative to that of the noise model.
_PREFILTERS = (1.0, 0.5, 0.25)
# Standard error that remains of the best log, of the value: no plant is quite as its model is.
_LEAST_ERROR = 0.005
# A slower one is taken where its error is that much smaller: the smallest of several flatters.
_MUCH_SMALLER = 0.6
# A slower one whose error is that many times as large tells nothing of the model.
_TELLING_ERROR = 2.0
# An interval wider than that many times the estimate on either side is no estimate, or a doubt.
_WIDEST, _WIDE = 0.5, 0.2
# Deviations of noise, below which it may well be that a plant stands.
_DOUBTFUL_DEVIATIONS = 3.0
# A model with dry friction or backlash may be that much worse and yet be true.
_TENABLE = 1.03
# Noise that every sensor has, as a share of how far the output moves: of a simulation without any
# the models would differ by rounding alone, of which the most complicated one makes the least.
_LEAST_NOISE = 1e-5
# What follows from the reference alone must predict about as well as what fits best.
_STALLED = 1.2


@attrs.frozen(kw_only=True)
class Plant:
    """
    What a log says about its plant.

    y^(order) = b0 u - damping y^(order-1) + ..., with b0 in units of y^(order) per unit command
    and the damping in 1/s. ``late`` is '', 'delay', 'lag' or 'delay and lag', and ``lateness`` how
    long [s]; ``dry`` is '', or 'friction' or 'backlash', without which the log is explained worse.
    ``noise`` is the standard deviation of the measurement's, ``disturbance_bandwidth`` that of the
    filter that tells noise from disturbance best [rad/s]. ``unexplained`` has the innovations of
    the best model of each order tried, relative to the smallest. ``instruments`` tells whether a
    reference, or a command that answers nothing, tells the command's part from the disturbance's.
    ``samples`` and ``period`` [s] are those of the log; ``doubts`` weaken the result, a sentence
    each.
    """

    order: int
    b0: Estimate
    damping: Estimate
    late: str
    lateness: Estimate | None
    dry: str
    noise: float
    disturbance_bandwidth: float
    unexplained: dict[int, float]
    instruments: bool
    samples: int
    period: float
    doubts: tuple[str, ...]


def identify(log: Log, order: int | None = None) -> Plant:
    """
    Return the plant of a log, of the given order or of the one that explains it best.

    Raises
    ------
    RecordingError
        When the data cannot tell b0, with what is missing and what to do.

    """
    orders = (order,) if order else _ORDERS
    noise = noise_deviation(log.measurement)
    log = with_noise(log, noise)
    log, delayed = explored(with_ways(log), orders)
    fits = [fit for n in orders for fit in candidates(log, n, delayed[n], order is None)]
    chosen = simplest(fits)
    closed = not log.reference_moves and not is_open(log, chosen)
    if closed and log.reference_known:
        raise RecordingError(
            f'the reference stands at {log.reference[0]:g}: the effect of the command cannot be '
            f'separated from that of the disturbance to which it responds: {ADVICE}'
        )
    # As if the order had been given: what other orders had to leave out for their delays counts.
    log = with_room(log, delayed[chosen.form.order])
    asked = ADVICE if order else f'give --order if you know it, or {ADVICE}'
    refined, estimates = in_the_best_band(log, chosen, asked)
    b0, late = estimates[0], chosen.form.late
    if chosen.form.dry:
        b0 = however_it_turns(log, refined, b0)
    b0 = or_dry(log, chosen, fits, b0)
    if not b0.half_width <= _WIDEST:
        raise RecordingError(
            f'b0 may be anything from {b0.low:.3g} to {b0.high:.3g}: the command hardly moves '
            'independently of the disturbance, or the noise is colored, as behind a filter: '
            f'{asked}'
        )
    best = min(fit.innovation for fit in fits)
    top = estimates[chosen.form.order]
    return Plant(
        order=chosen.form.order,
        b0=b0,
        damping=Estimate(value=-top.value, error=top.error),
        late=late,
        lateness=total(estimates[1 + chosen.form.order :]),
        dry=chosen.form.dry,
        noise=min(noise, deviation(log, refined, chosen.bandwidth)),
        disturbance_bandwidth=chosen.bandwidth,
        unexplained={
            n: min(fit.innovation for fit in fits if fit.form.order == n) / best
            for n in sorted({fit.form.order for fit in fits})
        },
        instruments=not closed,
        samples=len(log.command),
        period=log.h,
        doubts=tuple(_doubts(log, b0, closed)),
    )


def with_noise(log: Log, noise: float) -> Log:
    """Return the log with the least noise that a sensor has, where its own is less."""
    least = _LEAST_NOISE * float(np.std(log.measurement))
    if noise >= least:
        return log
    added = np.random.Generator(np.random.PCG64(0)).standard_normal(len(log.measurement))
    return attrs.evolve(log, measurement=log.measurement + least * added)


def in_the_best_band(log: Log, chosen: Fit, asked: str = ADVICE) -> tuple[Fit, list[Estimate]]:
    """
    Return the fit and its estimates behind the prefilter that leaves b0 a small error.

    What a model leaves out, lags and backlash, acts most in the fast band where the innovations
    are smallest. Slower prefilters tell the same of a plant that is as the model is (Hausman,
    Econometrica 46, 1978); what they differ by more than their errors widens the interval.
    """
    tried = [
        refine(log, attrs.evolve(chosen, bandwidth=ratio * chosen.bandwidth))
        for ratio in _PREFILTERS
    ]
    found = [
        (fit, estimates)
        for fit, estimates in tried
        if deviation(log, fit, fit.bandwidth) <= _STALLED * deviation(log, chosen, fit.bandwidth)
    ]
    if not found:
        raise RecordingError(
            'the reference and the command explain too little of the output, as when the loop '
            f'stalls, commands act at odd times, or there is much backlash: {asked}'
        )
    gains = [estimates[0] for _, estimates in found]
    best = 0
    for k, gain in enumerate(gains):
        if gain.error < _MUCH_SMALLER * gains[best].error:
            best = k
    own = gains[best]
    telling = [slow for slow in gains[best + 1 :] if slow.error < _TELLING_ERROR * own.error]
    apart = [(abs(slow.value - own.value), slow.error) for slow in telling]
    wrong = max((far**2 - error**2 for far, error in apart if far > Z95 * error), default=0.0)
    fit, estimates = found[best]
    wrong += (_LEAST_ERROR * own.value) ** 2
    widened = attrs.evolve(own, error=float(np.hypot(own.error, np.sqrt(wrong))))
    return fit, [widened, *estimates[1:]]


def however_it_turns(log: Log, fit: Fit, b0: Estimate) -> Estimate:
    """Return b0 with an interval that allows for when exactly the plant stops and turns."""
    other = refine(with_ways(log, _DOUBTFUL_DEVIATIONS), fit)[1][0].value
    return attrs.evolve(b0, error=float(np.hypot(b0.error, 0.5 * (other - b0.value))))


def or_dry(log: Log, chosen: Fit, fits: Sequence[Fit], b0: Estimate) -> Estimate:
    """
    Return b0 with an interval that holds that of dry friction and of backlash as well.

    Under a square friction goes with the motion as stiffness does, and noise blurs when the plant
    stands: where its model is hardly worse, the log does not tell which is true.
    """
    low, high = b0.low, b0.high
    for fit in fits:
        same = fit.form == attrs.evolve(chosen.form, dry=fit.form.dry)
        if not same or fit.form.dry in ('', chosen.form.dry):
            continue
        if fit.innovation <= _TENABLE * chosen.innovation:
            other = refine(log, fit)[1][0]
            if other.half_width <= _WIDE:
                low, high = min(low, other.low), max(high, other.high)
    return Estimate.between(low, high)


def total(parts: Sequence[Estimate]) -> Estimate | None:
    """Return the sum of delay and lag, None without them."""
    if not parts:
        return None
    return Estimate(
        value=sum(part.value for part in parts),
        error=float(np.linalg.norm([part.error for part in parts])),
    )


def _doubts(log: Log, b0: Estimate, closed: bool) -> list[str]:
    doubts = []
    if closed:
        doubts.append(
            'no reference that moves was recorded: a disturbance that the loop fights may pass '
            'for a wrong b0, and the interval does not know of it'
        )
    elif log.reference_moves and is_one_sine(log.reference):
        doubts.append(
            'the reference is a single sine: stiffness, or a disturbance of nearly that '
            'frequency, cannot be distinguished from b0; record a chirp or a square'
        )
    if b0.half_width > _WIDE:
        doubts.append(f'the interval is wide, +-{100 * b0.half_width:.0f} %: {ADVICE}')
    return doubts
