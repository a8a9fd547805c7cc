"""
The models that may explain a log, and the simplest of those that do.

Dead time is sought first, over a quarter of the record, and room is made for it: the models are
compared on rows of which every command is known. Then each order comes without and with delay and
lag, with three degrees of smoothness of the disturbance, and with dry friction or backlash.
"""

from __future__ import annotations

from collections.abc import Sequence

import attrs
from nadrc_ros.tuning.identification.fit import (
    Fit,
    fit_direct,
    innovations_of,
    likely_delays,
    TRIAL_ROUNDS,
)
from nadrc_ros.tuning.identification.log import noise_deviation
from nadrc_ros.tuning.identification.predictor import Array, Form, Log
import numpy as np
import numpy.typing as npt
from scipy.signal import savgol_filter

_SMOOTHNESS = (1, 2, 3)
# What explains the log nearly as well counts as well: the simplest such model is taken.
_EQUALLY_GOOD = 1.003
# Rows more than a suggested delay takes.
_SPARE_ROWS = 10
# Lags beyond that part of 1 / bandwidth of the noise model are no lags, and poles beyond that
# many bandwidths are no dynamics.
_SLOW_LAG = 2.0
# No loop holds a plant that grows by more than that many powers of e within its dead time.
_HOPELESS_GROWTH = 2.0
# Half lengths of the smoothing of a rate, in periods, of which the shortest that is quiet enough
# counts: where the noise is that part of the rate's size.
_HALF_LENGTHS, _QUIET = (1, 2, 3, 5, 8, 12, 18, 27, 40), 0.05
# Up to that many deviations of its noise, and up to that part of its mean size, a rate is none.
_NOISY, _SLOW = 1.0, 0.01


def explored(log: Log, orders: Sequence[int]) -> tuple[Log, dict[int, Fit | None]]:
    """
    Return a start with the delay of each order that is worth a try, and a log with room for all.

    What a delay brings in the first rows was sent before the log began, and nobody knows it: the
    models are compared on the rows after that.
    """
    starts: dict[int, Fit | None] = {}
    for order in orders:
        without = innovations_of(log, fit_direct(log, Form(order=order), rounds=TRIAL_ROUNDS))
        least, starts[order] = 1.0 / _EQUALLY_GOOD, None
        for start in likely_delays(log, order):
            lead = _room_for(start.delay, log.h)
            fit = fit_direct(attrs.evolve(log, lead=lead), start.form, start, TRIAL_ROUNDS)
            left = fit.innovation / float(np.sqrt(np.mean(without[lead:] ** 2)))
            if left < least:
                least, starts[order] = left, start
    return with_room(log, *starts.values()), starts


def with_room(log: Log, *starts: Fit | None) -> Log:
    """Return the log without the first rows that the longest delay of the starts takes."""
    longest = max((start.delay for start in starts if start), default=0.0)
    return attrs.evolve(log, lead=_room_for(longest, log.h) if longest >= log.h else 0)


def _room_for(delay: float, h: float) -> int:
    """Return how many rows a delay about that long [s] may need."""
    periods = round(delay / h)
    return periods + periods // 8 + _SPARE_ROWS


def candidates(log: Log, order: int, delayed: Fit | None, open_order: bool) -> list[Fit]:
    """
    Return the models of one order, the simple ones first.

    ``delayed`` is the start of one with dead time, from :func:`explored`. ``open_order`` tells
    that other orders are compared with this one.
    """
    fits = _of_each_smoothness(log, Form(order=order))
    starts = [fit_direct(log, Form(order=order, late='lag'), fits[0])]
    if delayed:
        starts.insert(0, fit_direct(log, delayed.form, delayed))
    starts = [start for start in starts if start.innovation < fits[0].innovation / _EQUALLY_GOOD]
    late = [fit for start in starts for fit in _of_each_smoothness(log, start.form, start)]
    if len(starts) > 1:
        near = simplest(late[: len(_SMOOTHNESS)])
        late.append(fit_direct(log, attrs.evolve(near.form, late='delay and lag'), near))
    if open_order:  # a slow lag is dynamics of the plant's own: of the next order
        slow = _SLOW_LAG / simplest(fits).bandwidth
        late = [fit for fit in late if not fit.form.lagging or fit.parameters[-1] <= slow]
    fits += [fit for fit in late if not _is_hopeless(fit)]
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
    poles = _poles_of(fit)
    fastest = poles[np.argmax(np.abs(poles))]
    return bool(n > 1 and not fastest.imag and fastest.real < -_SLOW_LAG * fit.bandwidth)


def _is_hopeless(fit: Fit) -> bool:
    """Tell whether no loop holds the plant: a period of the reference passes for dead time."""
    return bool(_poles_of(fit).real.max() * fit.delay > _HOPELESS_GROWTH)


def _poles_of(fit: Fit) -> npt.NDArray[np.complex128]:
    """Return the roots of s^n - a, without those of a lag."""
    return np.asarray(np.roots(np.append(1.0, -fit.parameters[: fit.form.order][::-1])), complex)


def _of_each_smoothness(log: Log, form: Form, near: Fit | None = None) -> list[Fit]:
    """Return models that differ in how smooth the disturbance is."""
    fits: list[Fit] = []
    for smoothness in _SMOOTHNESS:
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
    return next(fit for fit in fits if fit.innovation <= _EQUALLY_GOOD * best)


def with_ways(log: Log, noisy: float = _NOISY) -> Log:
    """Return the log with its direction of motion, where ``noisy`` deviations do not hide it."""
    moving = rate_of(log.measurement, log.h)
    side = direction(log.measurement, noise_deviation(log.measurement), noisy)
    return attrs.evolve(
        log,
        way=direction(*moving, noisy) if moving else None,
        side=side if side.min() < 0.0 < side.max() else None,
    )


def rate_of(measurement: Array, h: float) -> tuple[Array, float] | None:
    """Return the smoothed rate of change [1/s] and the deviation of its noise; None if unclear."""
    noise = noise_deviation(measurement)
    for half in _HALF_LENGTHS:
        if 2 * half + 1 > len(measurement) // 10:
            return None
        rate: Array = savgol_filter(measurement, 2 * half + 1, 2, deriv=1, delta=h)
        deviation = noise / h * float(np.sqrt(3.0 / (half * (half + 1) * (2 * half + 1))))
        if deviation < _QUIET * float(np.std(rate)):
            return rate, deviation
    return None


def direction(values: Array, deviation: float, noisy: float = _NOISY) -> Array:
    """Return the sign of values whose noise has a deviation, and 0 where they are nearly zero."""
    least = max(noisy * deviation, _SLOW * float(np.sqrt(np.mean(values**2))))
    return np.where(np.abs(values) > least, np.sign(values), 0.0)
