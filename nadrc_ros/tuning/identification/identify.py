"""
The plant behind a log: order, input gain b0 with its 95 % interval, damping, lateness, noise.

Assumed: y^(n) = b0 u + a . (y, ..., y^(n-1)) + d, with a disturbance that is slow against the
noise bandwidth and does not go with the reference, white measurement noise, and a command held
over each period. What does not fit (gains that vary, friction, stiffness that bends) is part of d
and widens the interval as far as it does not go with the reference. Method and sources:
:mod:`nadrc_ros.tuning.identification.estimate`; for filters and polynomial models of continuous
time also Unbehauen and Rao (Automatica 26, 1990) and Garnier and Wang (Springer, 2008).
"""

from __future__ import annotations

from collections.abc import Sequence

import attrs
from nadrc_ros.records.recording import RecordingError
from nadrc_ros.tuning.identification.estimate import Estimate, Fit, fit_direct, fit_late, refine
from nadrc_ros.tuning.identification.log import ADVICE, is_one_sine, noise_deviation
from nadrc_ros.tuning.identification.predictor import Form, Log

ORDERS = (1, 2, 3)
SMOOTHNESS = (1, 2, 3)
# What explains the log nearly as well counts as well: the simplest such model is taken.
NEARLY = 1.003
# An interval wider than that many times the estimate on either side is no estimate.
WIDEST = 0.5
WIDE = 0.2
# What follows from the reference alone must predict about as well as what fits best.
WORSE = 1.2


@attrs.frozen(kw_only=True)
class Plant:
    """
    What a log says about its plant.

    Attributes
    ----------
    order
        Number of integrations n from command to output.
    b0
        Input gain [unit of y^(n) per unit command].
    damping
        -a_(n-1) of y^(n) = -damping y^(n-1) + ... [1/s]; its inverse is a time constant if the
        lower coefficients are small.
    late, lateness
        '' or 'delay' or 'lag', and how long [s].
    noise
        Standard deviation of the measurement noise.
    disturbance_bandwidth
        Of the filter that tells noise from disturbance best [rad/s].
    unexplained
        Innovations of the best model of each order tried, relative to the smallest.
    instruments
        Whether a reference was there to tell the command's part from the disturbance's.
    samples, period
        Of the log; period in [s].
    doubts
        What weakens the result, a sentence each.

    """

    order: int
    b0: Estimate
    damping: Estimate
    late: str
    lateness: Estimate | None
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
    orders = (order,) if order else ORDERS
    fits = [fit for order in orders for fit in candidates(log, order)]
    chosen = simplest(fits)
    refined, estimates = refine(log, chosen)
    b0, late = estimates[0], chosen.form.late
    if not refined.innovation <= WORSE * chosen.innovation:
        raise RecordingError(
            'the reference and the command explain too little of the output, as when the loop '
            f'stalls or commands act at odd times: {ADVICE}'
        )
    if not b0.half_width <= WIDEST:
        raise RecordingError(
            f'b0 may be anything from {b0.low:.3g} to {b0.high:.3g}: the command moves too little '
            f'that the disturbance does not: {ADVICE}'
        )
    best = min(fit.innovation for fit in fits)
    top = estimates[chosen.form.order]
    return Plant(
        order=chosen.form.order,
        b0=b0,
        damping=Estimate(value=-top.value, error=top.error),
        late=late,
        lateness=estimates[-1] if late else None,
        noise=noise_deviation(log),
        disturbance_bandwidth=chosen.bandwidth,
        unexplained={
            n: min(f.innovation for f in fits if f.form.order == n) / best for n in orders
        },
        instruments=log.reference_moves,
        samples=len(log.command),
        period=log.h,
        doubts=tuple(_doubts(log, b0)),
    )


def candidates(log: Log, order: int) -> list[Fit]:
    """Return the models of one order, the simple ones first."""
    fits: list[Fit] = []
    for smoothness in SMOOTHNESS:
        near = fits[-1] if fits else None
        fits.append(fit_direct(log, Form(order=order, smoothness=smoothness), near))
    best = simplest(fits)
    fits += fit_late(log, best)
    late = simplest(fits)
    for smoothness in SMOOTHNESS if late.form.late else ():
        fits.append(fit_direct(log, attrs.evolve(late.form, smoothness=smoothness), late))
    return fits


def simplest(fits: Sequence[Fit]) -> Fit:
    """Return the first fit that is nearly as good as the best."""
    best = min(fit.innovation for fit in fits)
    return next(fit for fit in fits if fit.innovation <= NEARLY * best)


def _doubts(log: Log, b0: Estimate) -> list[str]:
    doubts = []
    if not log.reference_moves:
        doubts.append(
            'no reference that moves was recorded: a disturbance that the loop fights may pass '
            'for a wrong b0, and the interval does not know of it'
        )
    elif is_one_sine(log.reference):
        doubts.append(
            'the reference is one sine: stiffness, and a disturbance of nearly that frequency, '
            'cannot be told from b0; a chirp or a square tells more'
        )
    if b0.half_width > WIDE:
        doubts.append(f'the interval is wide, +-{100 * b0.half_width:.0f} %: {ADVICE}')
    return doubts
