"""
ADRC with one LESO as the filtered PI or PID controller that it is.

With the law of the paper's (17) put into the LESO (3), and v linear, the command is

    u = K(s) (F(s) r - y),   K = (Kp + Ki / s + Kd s) / (1 + T1 s + T2 s^2),

for n = 1 with Kd = T2 = 0: the gains are fixed by w, wc and b0, F by k_1 times the observer
polynomial. Source: G. Herbst, Transfer function analysis and implementation of active disturbance
rejection control, Control Theory and Technology 19, 2021.
"""

from __future__ import annotations

from typing import NamedTuple

from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.model import pole_frequencies
from nadrc_ros.theory.system import Array
import numpy as np


class FilteredPID(NamedTuple):
    """
    Gains and filter of K, and the numerator of the reference path.

    ``kp`` [command / output], ``ki`` [.../s], ``kd`` [... s]; ``t1`` [s] and ``t2`` [s^2] of the
    filter; ``setpoint`` (n+2,), coefficients of s^0..s^(n+1): with a reference whose derivatives
    are taken as 0, u = setpoint(s) / (s (1 + t1 s + t2 s^2)) r - K y.
    """

    kp: float
    ki: float
    kd: float
    t1: float
    t2: float
    setpoint: Array


def equivalent_pid(design: Design) -> FilteredPID:
    """
    Return the PI (n = 1) or PID (n = 2) controller that the continuous law is.

    Eliminating the estimates from x1' = x2 + beta_1 e, x2' = -k1 x1 - k2 x2 + beta_2 e, d' =
    beta_3 e, e = y - x1, b0 u = -k1 x1 - k2 x2 - d gives, for n = 2,

        b0 K = ((k1 b1 + k2 b2 + b3) s^2 + (k1 b2 + k2 b3) s + k1 b3) / (s D),
        D = s^2 + (k2 + b1) s + k1 + k2 b1 + b2,

    and for n = 1 b0 K = ((k1 b1 + b2) s + k1 b2) / (s (s + k1 + b1)).

    Raises
    ------
    ValueError
        With more than one level or extended state (two integrators: no PID), n > 2, fal, known
        poles or frequencies, or error based (where F = 1).

    """
    if design.levels > 1 or design.states != design.order + 1 or design.order > 2:
        raise ValueError('only one LESO of a plant of order 1 or 2 is a PI or PID controller')
    if design.known:
        raise ValueError('with known poles or frequencies it is no PI or PID controller')
    if not design.linear or design.error_based:
        raise ValueError('only the linear law fed with the output is a PI or PID controller')
    monic = np.asarray(np.poly([-w for w in pole_frequencies(design, 0)]), dtype=float)
    monic[1:] *= design.observer_gain_factor
    b1, b2 = float(monic[1]), float(monic[2])
    k1 = design.feedback_gains[0]
    if design.order == 1:
        d0, d1, d2 = k1 + b1, 1.0, 0.0
        kp, ki, kd = k1 * b1 + b2, k1 * b2, 0.0
    else:
        k2, b3 = design.feedback_gains[1], float(monic[3])
        d0, d1, d2 = k1 + k2 * b1 + b2, k2 + b1, 1.0
        kp, ki, kd = k1 * b2 + k2 * b3, k1 * b3, k1 * b1 + k2 * b2 + b3
    scale = 1.0 / (design.b0 * d0)
    setpoint = k1 * scale * monic[::-1]
    return FilteredPID(kp * scale, ki * scale, kd * scale, d1 / d0, d2 / d0, setpoint)
