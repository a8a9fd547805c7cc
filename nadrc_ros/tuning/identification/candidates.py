"""
The models that may explain a log, and the simplest of those that do.

Dead time is sought first, over a quarter of the record, and room is made for it: the models are
compared on rows of which every command is known. Then each order comes without and with delay and
lag, with three degrees of smoothness of the disturbance, and with dry friction or backlash.
"""

from __future__ import annotations

from collections.abc import Sequence

import attrs
from nadrc_ros.tuning.identification.delays import likely_delays, Suggestion
from nadrc_ros.tuning.identification.fit import (
    FEW,
    Fit,
    fit_delayed,
    fit_direct,
    innovations_of,
    MANY,
)
from nadrc_ros.tuning.identification.motion import direction, noise_deviation, NOISY, rate_of
from nadrc_ros.tuning.identification.predictor import Form, Log
import numpy as np
import numpy.typing as npt

SMOOTHNESS = (1, 2, 3)
# What explains the log nearly as well counts as well: the simplest such model is taken.
NEARLY = 1.003
# Rows more than a suggested delay takes.
ROOM = 10
# Lags beyond that part of 1 / bandwidth of the noise model are no lags, and poles beyond that
# many bandwidths are no dynamics.
SLOW_LAG = 2.0
# No loop holds a plant that grows by more than that many powers of e within its dead time.
HOPELESS = 2.0


def explored(log: Log, orders: Sequence[int]) -> tuple[Log, dict[int, Suggestion | None]]:
    """
    Return the delay of each order that is worth a try, and a log that leaves room for all of them.

    What a delay brings in the first rows was sent before the log began, and nobody knows it: the
    models are compared on the rows after that.
    """
    found: dict[int, Suggestion | None] = {}
    for order in orders:
        form = Form(order=order)
        without = innovations_of(log, fit_direct(log, form, rounds=FEW))
        least, found[order] = 1.0 / NEARLY, None
        for suggestion in likely_delays(log, order):
            lead = room_for(suggestion.periods)
            fit = fit_delayed(attrs.evolve(log, lead=lead), form, suggestion)
            left = fit.innovation / float(np.sqrt(np.mean(without[lead:] ** 2)))
            if left < least:
                least, found[order] = left, suggestion
    longest = max((s.periods for s in found.values() if s), default=0)
    return attrs.evolve(log, lead=room_for(longest) if longest else 0), found


def with_all_rows(log: Log, fit: Fit) -> Log:
    """Return the log with the rows that only models with a longer delay had to leave out."""
    if not fit.form.delayed:
        return attrs.evolve(log, lead=0)
    periods = round(float(fit.parameters[fit.form.order]) / log.h)
    return attrs.evolve(log, lead=min(log.lead, room_for(periods)))


def room_for(periods: int) -> int:
    """Return how many rows a delay about that long may need."""
    return periods + periods // 8 + ROOM


def candidates(log: Log, order: int, suggestion: Suggestion | None, open_order: bool) -> list[Fit]:
    """Return the models of one order, the simple ones first."""
    fits = smooth(log, Form(order=order))
    starts = [fit_direct(log, Form(order=order, late='lag'), fits[0])]
    if suggestion:
        starts.insert(0, fit_delayed(log, Form(order=order), suggestion, MANY))
    starts = [start for start in starts if start.innovation < fits[0].innovation / NEARLY]
    late = [fit for start in starts for fit in smooth(log, start.form, start)]
    if len(starts) > 1:
        near = simplest(late[: len(SMOOTHNESS)])
        late.append(fit_direct(log, attrs.evolve(near.form, late='delay and lag'), near))
    if open_order:  # a slow lag is dynamics of the plant's own: of the next order
        slow = SLOW_LAG / simplest(fits).bandwidth
        late = [fit for fit in late if not fit.form.lagging or fit.parameters[-1] <= slow]
    fits += [fit for fit in late if not hopeless(fit)]
    for near in {fit.form: fit for fit in (fits[0], simplest(fits))}.values():
        fits += [
            fit_direct(log, attrs.evolve(near.form, dry=dry), near) for dry in dry_of(log, order)
        ]
    return [fit for fit in fits if not (open_order and is_lag(fit))]


def is_lag(fit: Fit) -> bool:
    """
    Tell whether the highest order is but a lag that is fast against the noise: of the order below.

    Backlash looks like one, and its b0 is that of the plant over the lag.
    """
    n = fit.form.order
    poles = poles_of(fit)
    fastest = poles[np.argmax(np.abs(poles))]
    return bool(n > 1 and not fastest.imag and fastest.real < -SLOW_LAG * fit.bandwidth)


def hopeless(fit: Fit) -> bool:
    """Tell whether no loop holds the plant: a period of the reference passes for dead time."""
    if not fit.form.delayed:
        return False
    return bool(poles_of(fit).real.max() * fit.parameters[fit.form.order] > HOPELESS)


def poles_of(fit: Fit) -> npt.NDArray[np.complex128]:
    """Return the roots of s^n - a, without those of a lag."""
    return np.asarray(np.roots(np.append(1.0, -fit.parameters[: fit.form.order][::-1])), complex)


def smooth(log: Log, form: Form, near: Fit | None = None) -> list[Fit]:
    """Return models that differ in how smooth the disturbance is."""
    fits: list[Fit] = []
    for smoothness in SMOOTHNESS:
        near = fit_direct(log, attrs.evolve(form, smoothness=smoothness), near)
        fits.append(near)
    return fits


def dry_of(log: Log, order: int) -> tuple[str, ...]:
    """Return which of friction and backlash can be told, as the direction of motion is known."""
    if log.way is None:
        return ()
    if order == 1 and log.side is None:
        return ('backlash',)
    return ('friction', 'backlash')


def simplest(fits: Sequence[Fit]) -> Fit:
    """Return the first fit that is nearly as good as the best."""
    best = min(fit.innovation for fit in fits)
    return next(fit for fit in fits if fit.innovation <= NEARLY * best)


def with_ways(log: Log, noisy: float = NOISY) -> Log:
    """Return the log with its direction of motion, where ``noisy`` deviations do not hide it."""
    moving = rate_of(log.measurement, log.h)
    side = direction(log.measurement, noise_deviation(log.measurement), noisy)
    return attrs.evolve(
        log,
        way=direction(*moving, noisy) if moving else None,
        side=side if side.min() < 0.0 < side.max() else None,
    )
