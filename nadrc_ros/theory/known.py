"""
One level of the observer with known poles and frequencies, as matrices.

The gains follow from what they do, by another way than the law's: f(t) = C exp(A t) L, of which
they are made of the derivatives at 0, has at t = h, 2 h, ... the values that

    P(z) / A(z) = 1 + f(h) / z + f(2 h) / z^2 + ...,

with A and P the polynomials of the poles as they are and as they shall be. A pole that stays is in
both, and not in f. In continuous time the same quotient in s has the derivatives themselves.
"""

from __future__ import annotations

from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.transition import FASTEST_DECAY, LARGEST_TURN
from nadrc_ros.theory.system import Array, Complex, split_delay
import numpy as np
from scipy import linalg


def known_poles(design: Design, k: int, h: float) -> tuple[Complex, Complex]:
    """Return the poles [rad/s] of a level (from 0): of its model, and of its errors; sorted so."""
    n, w = design.order, design.bandwidths[k]
    turning = design.frequencies if k == 0 else []
    extended = design.sizes[k] - n - 2 * len(turning)
    own: list[complex] = [*design.plant_poles, *[0.0] * extended]
    asked: list[complex] = [-ratio * w for ratio in design.decays[: len(own)]]
    for i in range(n):
        seen = h == 0.0 or -own[i].real * h <= FASTEST_DECAY
        asked[i] = min(own[i].real, asked[i].real) if seen else own[i]
    for i, frequency in enumerate(turning):
        decay = design.decays[n + extended + i] * w
        if h > 0.0 and frequency * h > LARGEST_TURN:
            decay = 0.0
        own += [1j * frequency, -1j * frequency]
        asked += [1j * frequency - decay, -1j * frequency - decay]
    return np.array(own, dtype=complex), np.array(asked, dtype=complex)


def known_level(design: Design, k: int, h: float) -> tuple[Array, Array, Array, Array]:
    """Return the prediction (N, N), its input (N,), the gains (N,) and I - L C or I."""
    n, size = design.order, design.sizes[k]
    own, asked = known_poles(design, k, h)
    unit = h or 1.0 / design.bandwidths[k]  # of time: so that all coordinates are of one size
    plant = np.real(np.poly(own[:n] * unit))[:0:-1]
    generator = np.real(np.poly(own[n:] * unit))[:0:-1]
    matrix = np.eye(size + 1, k=1)
    matrix[n - 1, :n] = -plant
    matrix[n - 1, -1] = 1.0
    matrix[size - 1 :] = 0.0
    matrix[size - 1, n:size] = -generator
    moved = own != asked
    slopes = _slopes(own[moved] * unit, asked[moved] * unit, size, h > 0.0)
    gain = slopes.copy()
    for j in range(n, size):
        gain[j] += plant @ slopes[j - n : j]
    gain *= design.observer_gain_factor
    identity, scale = np.eye(size), unit ** np.arange(float(size))
    gain /= scale
    if h > 0.0:
        full: Array = np.asarray(linalg.expm(matrix), dtype=float)
        predict, push = full[:size, :size], full[:size, -1] * unit**n
        keep = identity - np.outer(gain, identity[0])
        return predict * scale / scale[:, None], push / scale, gain, keep
    predict = matrix[:size, :size] * scale / scale[:, None] / unit
    return predict - np.outer(gain, identity[0]), matrix[:size, -1], gain, identity


def _slopes(own: Complex, asked: Complex, count: int, sampled: bool) -> Array:
    """Return f(0), f'(0), ..., shape (count,), with the unit of time as the period."""
    size = len(own)
    slopes = np.zeros(max(count, size))
    a = np.real(np.poly(own))[1:]
    if not sampled:
        p = np.real(np.poly(asked))[1:]
        for j in range(count):
            slopes[j] = (p - a)[j] if j < size else 0.0
            slopes[j] -= a[: min(j, size)] @ slopes[j - min(j, size) : j][::-1]
        return slopes[:count]
    if size:
        companion = np.eye(size, k=1)
        companion[-1] = -a[::-1]
        step = companion @ _mean(companion)  # exp(companion) - 1
        rows = [np.eye(size)[0] + step[0]]
        while len(rows) < size:
            rows.append(rows[-1] @ step)
        gain = np.linalg.solve(np.array(rows), np.eye(size)[-1]).astype(complex)
        for pole in asked[::-1]:  # those of the frequencies first
            gain = step @ gain - np.expm1(pole) * gain
        slopes[:size] = gain.real
    for j in range(size, count):
        slopes[j] = -a @ slopes[j - size : j][::-1]
    return slopes[:count]


def _mean(matrix: Array) -> Array:
    """Return the integral of exp(matrix t) over 0..1."""
    size = len(matrix)
    block = np.zeros((2 * size, 2 * size))
    block[:size, :size], block[:size, size:] = matrix, np.eye(size)
    return np.asarray(linalg.expm(block), dtype=float)[:size, size:]


def feedback_gains(design: Design, h: float) -> Array:
    """
    Return the gains K (n,) of the linear feedback b0 u = K (r - x) + a x under a held command.

    With g = K - a and the known plant x <- Phi x + B b0 u, det(z - Phi + B g) = det(z - Phi) (1 +
    g (z - Phi)^-1 B) is (z - exp(-wc h))^n at n values of z. Without poles, or in continuous time,
    those of (s + wc)^n.
    """
    n, fastest = design.order, max(map(abs, design.plant_poles))
    if h == 0.0 or fastest == 0.0:
        return np.array(design.feedback_gains)
    h = min(h, FASTEST_DECAY / fastest)
    model = np.eye(n + 1, k=1)
    model[n - 1, :n] = -np.array(design.damping) * h ** np.arange(n, 0.0, -1.0)
    model[n] = 0.0
    step = model @ _mean(model)  # exp(model) - 1, in the time of h
    wanted = np.expm1(-design.controller_bandwidth * h)
    fastest = max(fastest, design.controller_bandwidth)
    scale = fastest ** np.arange(n, 0.0, -1.0)
    points = fastest * h * np.exp(1j * np.pi * (2.0 * np.arange(n) + 1.0) / (2.0 * n))
    away = points[:, None, None] * np.eye(n) - step[:n, :n]
    rows = np.linalg.solve(away, step[None, :n, n:])[..., 0]
    rows = rows * (fastest * h) ** np.arange(n, 0.0, -1.0)
    rest = (points - wanted) ** n / np.linalg.det(away) - 1.0
    both = np.vstack([rows.real, rows.imag]), np.concatenate([rest.real, rest.imag])
    gains = np.linalg.lstsq(*both, rcond=None)[0] * scale
    return np.asarray(gains + np.array(design.damping), dtype=float)


def own_delay(design: Design, h: float) -> tuple[int, float]:
    """
    Return by how many whole periods, and what part of one, the law's own command is late in it.

    Its observers get the mean (1 - part) u[k - whole] + part u[k - whole - 1].

    Raises
    ------
    ValueError
        For a dead time in continuous time, where it is no finite number of states.

    """
    if design.input_delay == 0.0:
        return 0, 0.0
    if h == 0.0:
        raise ValueError('a law with a dead time needs a period')
    whole, rest = split_delay(design.input_delay, h)
    part = rest / h
    return whole, part if part > 1e-9 else 0.0


def vibration_matrix(design: Design, h: float) -> Array:
    """
    Return (Pi; Gamma - (1, 0, ...)), shape (n+1, M): what feedback leaves to known vibrations.

    From Pi S_h = Phi Pi - B Gamma + E with C Pi = 0, Gamma of when a late command arrives; 0 in
    continuous time, where d itself is cancelled, and where nothing is to be seen of a vibration.
    """
    n, size = design.order, design.sizes[0]
    count = size - n
    if not (h > 0.0 and design.frequencies) or max(design.frequencies) * h > LARGEST_TURN:
        return np.zeros((n + 1, count))
    scale = h ** np.arange(float(size))
    predict, push, _, _ = known_level(design, 0, h)
    predict, push = predict * scale[:, None] / scale, push * scale / h**n
    # Of the unknown rows (Pi_1, ..., Pi_{n-1}, Gamma), each M long.
    away = np.vstack([np.zeros(n - 1), np.eye(n - 1)])
    system = np.kron(np.hstack([away, np.zeros((n, 1))]), predict[n:, n:].T)
    system -= np.kron(np.hstack([predict[:n, 1:n], -push[:n, None]]), np.eye(count))
    found = np.linalg.solve(system, predict[:n, n:].ravel()).reshape(n, count) * h**n
    if design.input_delay > 0.0:
        whole, part = own_delay(design, h)
        step = predict[n:, n:]
        late = np.linalg.inv((1.0 - part) * step + part * np.eye(count))
        found[-1] = found[-1] @ np.linalg.matrix_power(step, whole + 1) @ late
    left = np.vstack([np.zeros(count), found]) * h ** np.arange(float(count))
    left[:n] /= scale[:n, None]
    left[n] /= h**n
    left[n, 0] -= 1.0
    return left
