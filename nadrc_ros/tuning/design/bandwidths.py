"""
Rules for the bandwidths of controller and observer.

Sources: Z. Gao, Scaling and bandwidth-parameterization based controller tuning, Proc. American
Control Conference, 2003 (one bandwidth each for controller and observer); G. Herbst, A simulative
study on active disturbance rejection control (ADRC) as a control tool for practitioners,
Electronics 2(3), 2013 (wc about 4 or 6 over the settling time for n = 1, 2; an observer 3 to 10
times as fast).
"""

from __future__ import annotations

from math import expm1, factorial, floor, log, log10

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.tuning.design.requirements import Requirements, STEP_SHARE
import numpy as np
from scipy import special

# Timeouts of a loop so slow that the usual ones would be too short for lost samples [periods].
_TIMEOUT = 5.0
# In time constants of the loop, when the command of a step is looked at: from, to, how often.
_STEP_TIMES = 1e-4, 40.0, 2000
BAND = 0.02  # in which a step has settled, as a share of it


def readable(value: float) -> float:
    """Return ``value``, positive, rounded down to four digits."""
    digit = 10.0 ** (floor(log10(value)) - 3)
    return float(f'{floor(value / digit * (1.0 + 1e-12)) * digit:.4g}')


def settling_factor(order: int, band: float = BAND) -> float:
    """
    Return wc times the settling time of (wc / (s + wc))^n: 3.912, 5.834, 7.517, 9.084, 10.580.

    The error of the step response is exp(-x) sum_{k<n} x^k / k! at x = wc t, the regularised
    incomplete gamma function Q(n, x), here solved for ``band``.
    """
    return float(special.gammainccinv(order, band))


def controller_bandwidth(wanted: Requirements) -> float:
    """
    Return the wc [rad/s] with which the loop of the sampled law settles in time.

    It is :func:`settling_factor` / settling time; for n = 1 without known poles corrected for the
    command being held over each period h, with which the error decays as (1 - wc h)^k. Without
    correction that would be 5 % at wc h = 0.1; for n > 1 it is below 0.7 %. With known poles the
    feedback knows of the hold. The right b0 and no delay assumed.
    """
    settling, h = wanted.settling_time, wanted.period
    if wanted.order == 1 and not any(wanted.poles):
        return -expm1(log(BAND) * h / settling) / h
    return settling_factor(wanted.order) / settling


def command_of_step(wanted: Requirements, wc: float) -> float:
    """
    Return the largest |b0 u| that a unit step of the reference asks for at ``wc`` [1/s^n].

    At first, wc^n, or later, where known poles need more to move the output, or to hold it:
    b0 u = prod_i (s - p_i) y and y = (wc / (s + wc))^n r.
    """
    n = wanted.order
    poles, t = np.array(wanted.poles) / wc, np.geomspace(*_STEP_TIMES)
    # In powers of q = 1 / (s + 1), time times wc: s - p is 1 / q - (1 + p), and a step through q^m
    # is 1 - exp(-t) sum_{k < m} t^k / k!.
    command = np.full(len(t), float(np.prod(-poles)))
    for m, coefficient in enumerate(np.poly(1.0 + poles)):
        for k in range(m):
            command -= coefficient * np.exp(-t) * t**k / factorial(k)
    return float(max(1.0, np.abs(command).max()) * wc**n)


def reference_step(wanted: Requirements) -> float:
    """Return the step [output unit]: the one named, or one that takes a share of the command."""
    if wanted.reference_step:
        return wanted.reference_step
    each = command_of_step(wanted, controller_bandwidth(wanted))
    step = STEP_SHARE * wanted.command_limit * abs(wanted.b0) / each
    return float(f'{step:.3g}')


def settings_of(
    wanted: Requirements, structure: str, levels: int, wc: float, w: float
) -> ControllerSettings:
    """
    Return the settings with ``w`` [rad/s] as the bandwidth of the first level.

    All levels are equally fast, those of a cascade excepted: it filters the measurement slowly
    first, and each level is twice as fast as the one before. The law is fed by the first level:
    the last one would reject slow disturbances better, but nearer to instability.
    """
    usual = ControllerSettings()
    ratio = 2.0 if structure == 'cascade' else 1.0
    settings = ControllerSettings(
        plant_order=wanted.order,
        b0=wanted.b0,
        structure=structure,
        levels=levels,
        inner_bandwidth=w,
        observer_gain_factor=0.5 if wanted.half_gain else 1.0,
        controller_bandwidth=wc,
        command_min=wanted.lowest_command,
        command_max=wanted.command_limit,
        plant_poles=wanted.plant_poles,
        disturbance_frequencies=wanted.disturbance_frequencies,
        input_delay=wanted.delay,
        outer_bandwidth=ratio * w if levels > 1 else usual.outer_bandwidth,
        bandwidth_ratio=ratio if levels > 2 else usual.bandwidth_ratio,
    )
    return patient(settings, wanted.period)


def patient(settings: ControllerSettings, period: float) -> ControllerSettings:
    """Return the settings with timeouts that bear a few lost samples, ``period`` [s] apart."""
    least = _TIMEOUT * period
    return attrs.evolve(
        settings,
        measurement_timeout=max(settings.measurement_timeout, least),
        max_dt=max(settings.max_dt, least),
    )
