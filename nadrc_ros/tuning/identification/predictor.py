"""
What an innovation predictor makes of a log: linear in b0, in few other parameters it is not.

The plant is y^(n) = a . (y, ..., y^(n-1)) + b u + d with d^(m) = white noise, seen through white
noise. Sampled, it is A(z) (1 - 1/z)^m y = b B(z) (1 - 1/z)^m u + C(z) e, an ARMAX model (Ljung,
System Identification, 2nd ed., 1999, 4.2 and 4.3), of which A and B are those of the plant under
a command held over each period, exactly. C belongs to the Kalman filter of a chain of n + m
integrators: Butterworth poles, and their bandwidth is the only number needed for both noises.
"""

from __future__ import annotations

from math import exp, pi

import attrs
import numpy as np
import numpy.typing as npt
from scipy.linalg import expm
from scipy.signal import lfilter

Array = npt.NDArray[np.float64]
# A loop that starts that many times as far from its reference as it scatters later is stepped.
_FAR = 10.0


@attrs.frozen(kw_only=True)
class Form:
    """
    Which model: order n, smoothness m of the disturbance, and how the command comes late.

    ``late`` is '' (it does not), 'delay' (dead time), 'lag' (the derivative n + 1 that was left
    out: tau y^(n+1) + y^(n) = ...; for a motor the inductance) or 'delay and lag'. ``dry`` is '',
    'friction' (a force against the direction of motion) or 'backlash' (the sensor lags by half
    the play).
    """

    order: int
    smoothness: int = 1
    late: str = ''
    dry: str = ''

    @property
    def free(self) -> int:
        """Return how many parameters the model has besides b: a_0..a_(n-1), delay, lag."""
        return self.order + self.delayed + self.lagging

    @property
    def delayed(self) -> bool:
        """Tell whether there is dead time."""
        return 'delay' in self.late

    @property
    def lagging(self) -> bool:
        """Tell whether there is a lag: the last of the parameters."""
        return 'lag' in self.late


@attrs.frozen(kw_only=True, eq=False)
class Log:
    """
    What is fitted: arrays (N,) of one value each period ``h`` [s], without a gap.

    Of the first ``lead`` rows only the command counts: it is what a delay brings later. ``way``
    and ``side`` are the signs, -1, 0 or 1, of the rate of the measurement and of itself, 0 where
    it stands; None where noise hides them.
    """

    measurement: Array
    command: Array
    reference: Array
    h: float
    lead: int = 0
    way: Array | None = None
    side: Array | None = None

    @property
    def reference_known(self) -> bool:
        """Tell whether the reference is known throughout."""
        return bool(np.isfinite(self.reference).all())

    @property
    def reference_moves(self) -> bool:
        """Tell whether a known reference moves, or is far away where the log starts."""
        if not self.reference_known:
            return False
        away = self.reference - self.measurement
        rests = float(np.std(away[len(away) // 2 :]))
        return bool(np.ptp(self.reference) > 0.0 or abs(away[0]) > _FAR * rests)


def butterworth(count: int, bandwidth: float, h: float) -> Array:
    """Return the monic polynomial (count + 1,) with Butterworth poles [rad/s] sampled at ``h``."""
    angles = pi * (2.0 * np.arange(count) + count + 1.0) / (2.0 * count)
    return np.real(np.poly(np.exp(bandwidth * h * np.exp(1j * angles))))


def plant_polynomials(form: Form, parameters: Array, h: float) -> tuple[Array, Array]:
    """Return A(z) and B(z) of the plant with gain 1, exact for a command held over ``h``."""
    n = form.order
    a, states = parameters[:n], n + form.lagging
    matrix = np.zeros((states + 1, states + 1))
    matrix[np.arange(n - 1), np.arange(1, n)] = 1.0
    if form.lagging:
        tau = parameters[-1]
        matrix[n - 1, n] = 1.0
        matrix[n, :n], matrix[n, n], matrix[n, -1] = a / tau, -1.0 / tau, 1.0 / tau
    else:
        matrix[n - 1, :n], matrix[n - 1, -1] = a, 1.0
    sampled = expm(matrix * h)
    inner, drive = sampled[:states, :states], sampled[:states, -1]
    seen = np.zeros(states)
    seen[0] = 1.0
    poles: Array = np.real(np.poly(inner))
    zeros: Array = np.poly(inner - np.outer(drive, seen)) - poles
    return poles, zeros


def filtered(
    log: Log, form: Form, parameters: Array, bandwidth: float
) -> tuple[Array, Array, Array]:
    """
    Return the parts of the prediction error e = y_f - b u_f - R c: (N,), (N,), (N, columns).

    The columns of R are what friction or backlash does to e, if the form has it, and then what a
    wrong initial state does. The first ``lead`` rows are left out.
    """
    a, b = plant_polynomials(form, parameters, log.h)
    c = noise_polynomial(form, bandwidth, log.h)
    if len(a) > form.order + 1:  # a lag has one more pole, and e must stay white above it
        c = np.convolve(c, [1.0, -exp(-log.h / parameters[-1])])
    flat = differences(form.smoothness)
    at = np.arange(log.lead, len(log.command))
    command = log.command[at]
    if form.delayed:
        command = np.interp(
            at - parameters[form.order] / log.h, np.arange(at[-1] + 1), log.command
        )
    output = log.measurement[at] - log.measurement[log.lead]
    a, b = np.convolve(a, flat), np.convolve(b, flat)
    rest = [initial_columns(c, len(at))]
    way = way_of(log, form)
    if way is not None and form.dry == 'backlash':
        rest.insert(0, lfilter(a, c, way[at]))
    elif way is not None:
        command = np.where(way[at] == 0.0, 0.0, command)
        rest.insert(0, lfilter(b, c, _hastened(form, parameters, way[at], log.h)))
    return lfilter(a, c, output), lfilter(b, c, command), np.column_stack(rest)


def way_of(log: Log, form: Form) -> Array | None:
    """
    Return the direction (N,) that dry friction or backlash goes by, None without either.

    Friction opposes the speed: of a plant of order 1 that is the output. While the plant stands,
    it balances the command; and the play of backlash is passed from one side to the other.
    """
    if form.dry == 'friction':
        return log.side if form.order == 1 else log.way
    if not form.dry or log.way is None:
        return None
    known = np.flatnonzero(log.way)
    return np.asarray(np.interp(np.arange(len(log.way)), known, log.way[known]))


def _hastened(form: Form, parameters: Array, way: Array, h: float) -> Array:
    """Return what acts without the lag of the command, as an input that comes with it."""
    if not form.lagging:
        return way
    pole = exp(-h / parameters[-1])
    return np.asarray(lfilter([1.0, -pole], [1.0 - pole], way))


def initial_columns(c: Array, count: int) -> Array:
    """Return what the initial state of a filter 1 / c of degree k leaves: (count, k)."""
    start = np.zeros(count)
    start[0] = 1.0
    once = lfilter([1.0], c, start)
    return np.stack([np.concatenate((np.zeros(k), once))[:count] for k in range(len(c) - 1)], 1)


def noise_polynomial(form: Form, bandwidth: float, h: float) -> Array:
    """Return C(z) of a chain of n + m integrators."""
    return butterworth(form.order + form.smoothness, bandwidth, h)


def differences(count: int) -> Array:
    """Return (1 - 1/z)^count, which takes a polynomial of that degree out of a signal."""
    return np.atleast_1d(np.poly(np.ones(count)))
