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


@attrs.frozen(kw_only=True)
class Form:
    """
    Which model: order n, smoothness m of the disturbance, and how the command comes late.

    ``late`` is '' (it does not), 'delay' (dead time) or 'lag' (the derivative n + 1 that was left
    out: tau y^(n+1) + y^(n) = ...; for a motor the inductance).
    """

    order: int
    smoothness: int = 1
    late: str = ''

    @property
    def free(self) -> int:
        """Return how many parameters the model has besides b: a_0..a_(n-1), then the lateness."""
        return self.order + bool(self.late)


@attrs.frozen(kw_only=True, eq=False)
class Log:
    """What is fitted: arrays (N,) of one value each period ``h`` [s], without a gap."""

    measurement: Array
    command: Array
    reference: Array
    h: float

    @property
    def reference_moves(self) -> bool:
        """Tell whether the reference is known throughout, and no constant."""
        return bool(np.isfinite(self.reference).all() and np.ptp(self.reference) > 0.0)


def butterworth(count: int, bandwidth: float, h: float) -> Array:
    """Return the monic polynomial (count + 1,) with Butterworth poles [rad/s] sampled at ``h``."""
    angles = pi * (2.0 * np.arange(count) + count + 1.0) / (2.0 * count)
    return np.real(np.poly(np.exp(bandwidth * h * np.exp(1j * angles))))


def plant_polynomials(form: Form, parameters: Array, h: float) -> tuple[Array, Array]:
    """Return A(z) and B(z) of the plant with gain 1, exact for a command held over ``h``."""
    n = form.order
    a, states = parameters[:n], n + (form.late == 'lag')
    matrix = np.zeros((states + 1, states + 1))
    matrix[np.arange(n - 1), np.arange(1, n)] = 1.0
    if form.late == 'lag':
        tau = parameters[n]
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
    Return the parts of the prediction error e = y_f - b u_f - I c: (N,), (N,), (N, n + m).

    The columns of I are what a wrong initial state does to e.
    """
    a, b = plant_polynomials(form, parameters, log.h)
    c = noise_polynomial(form, bandwidth, log.h)
    if len(a) > form.order + 1:  # a lag has one more pole, and e must stay white above it
        c = np.convolve(c, [1.0, -exp(-log.h / parameters[form.order])])
    flat = differences(form.smoothness)
    command = log.command
    if form.late == 'delay':
        at = np.arange(len(command))
        command = np.interp(at - parameters[form.order] / log.h, at, command)
    start = np.zeros(len(command))
    start[0] = 1.0
    once = lfilter([1.0], c, start)
    count = len(c) - 1
    initial = np.stack([np.concatenate((np.zeros(k), once))[: len(once)] for k in range(count)], 1)
    output = log.measurement - log.measurement[0]
    return (
        lfilter(np.convolve(a, flat), c, output),
        lfilter(np.convolve(b, flat), c, command),
        initial,
    )


def noise_polynomial(form: Form, bandwidth: float, h: float) -> Array:
    """Return C(z) of a chain of n + m integrators."""
    return butterworth(form.order + form.smoothness, bandwidth, h)


def differences(count: int) -> Array:
    """Return (1 - 1/z)^count, which takes a polynomial of that degree out of a signal."""
    polynomial = np.ones(1)
    for _ in range(count):
        polynomial = np.convolve(polynomial, [1.0, -1.0])
    return polynomial
