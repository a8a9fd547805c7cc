"""What measurement noise does to estimates: variances from the Lyapunov equation."""

from __future__ import annotations

from nadrc_ros.adrc.design import Design
from nadrc_ros.theory.model import disturbance_weights
from nadrc_ros.theory.system import Array, balanced, is_stable, pick, StateSpace
from nadrc_ros.theory.transfer import observer
import numpy as np
from scipy import linalg


def output_covariance(system: StateSpace, variance: float = 1.0) -> Array:
    """
    Return the covariance of the outputs, (outputs, outputs), under white noise on every input.

    Discrete: X = a X a' + b b' variance, covariance c X c' + d d' variance. Continuous: a X + X a'
    = -b b' S with ``variance`` the intensity S (two-sided density [unit^2 s]); d must be 0. A
    sampled noise of variance sigma^2 and period h has about S = sigma^2 h. Infinite when unstable.
    """
    if not is_stable(system):
        return np.full((len(system.c), len(system.c)), np.inf)
    system = balanced(system)
    drive = system.b @ system.b.T * variance
    if system.h > 0.0:
        inside = linalg.solve_discrete_lyapunov(system.a, drive)
    elif np.any(system.d):
        raise ValueError('white noise of infinite variance passes d')
    else:
        inside = linalg.solve_continuous_lyapunov(system.a, -drive)
    return np.asarray(system.c @ inside @ system.c.T + system.d @ system.d.T * variance)


def estimate_covariance(design: Design, h: float = 0.0, variance: float = 1.0) -> Array:
    """
    Return the covariance (K N, K N) of the estimates' part that comes from measurement noise.

    The command moves plant and observers alike (for the right b0), so it holds in any loop.
    """
    system = observer(design, h)
    return output_covariance(pick(system, [1], range(len(system.c))), variance)


def disturbance_variance(design: Design, h: float = 0.0, variance: float = 1.0) -> float:
    """Return the variance of d_1 + ... + d_K; over S w^5 it is 3/16 for one level and n = 2."""
    row = disturbance_weights(design)
    return float(row @ estimate_covariance(design, h, variance) @ row)
