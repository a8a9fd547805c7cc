"""
The tracking differentiator: a transition profile for the reference and its derivative.

Eq. (1) of the paper (with 2R in the denominator, where it prints 2r) is time-optimal control of a
double integrator with |acceleration| <= R. Integrated with sign() it chatters; Han's discrete fhan
reaches the reference without.

Source: J. Han, From PID to active disturbance rejection control, IEEE Trans. Ind. Electron. 56(3),
2009.
"""

from __future__ import annotations

from math import copysign, sqrt

from nadrc_ros.adrc.design import Vector


def fhan(x1: float, x2: float, acceleration: float, h: float) -> float:
    """Return the acceleration in [-R, R] that brings (x1, x2) to 0 soonest, in steps of ``h``."""
    d = acceleration * h * h
    a0 = h * x2
    y = x1 + a0
    if abs(y) > d:
        a = a0 + copysign(0.5 * (sqrt(d * (d + 8.0 * abs(y))) - d), y)
    else:
        a = a0 + y
    if abs(a) < d:
        return -acceleration * a / d
    return -copysign(acceleration, a)


def track(reference: float, acceleration: float, dt: float, profile: Vector) -> None:
    """
    Advance the profile r1, r2, ... (n+1,) towards ``reference`` by one step of ``dt`` seconds.

    r1 <- r1 + h r2, r2 <- r2 + h fhan(r1 - r, r2, R, h); for n >= 3, r3 is the acceleration just
    used. For n = 2 it would enter the command directly and is 0, as is any beyond r3: the
    bang-bang acceleration is not a feed-forward. A reference that moves at v, with |r''| < R, is
    trailed by v^2 / (2 R) + 0.5 h v: the profile could always stop where the reference is.
    """
    r1 = profile[0]
    r2 = profile[1]
    used = fhan(r1 - reference, r2, acceleration, dt)
    profile[0] = r1 + dt * r2
    profile[1] = r2 + dt * used
    for i in range(2, len(profile)):
        profile[i] = used if i == 2 and len(profile) > 3 else 0.0
