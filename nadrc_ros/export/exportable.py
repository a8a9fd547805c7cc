"""What of the settings an export can have, and the period that it runs at."""

from __future__ import annotations

from collections.abc import Callable
from math import frexp, ldexp

import attrs
from nadrc_ros.adrc.design import bandwidths
from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.adrc.settings import ControllerSettings, FASTEST_RATE, SLOWEST_RATE
from nadrc_ros.adrc.structures import STRUCTURES

# A period has so many zeros at its end that all sums of fewer than 2^10 periods are exact: so the
# time since the last sample is the same float however it came about, and its gains fit a table.
_SPARE_BITS = 10
LONGEST_GAP = 2**_SPARE_BITS - 1
_DIGITS = {False: 53, True: 24}
# With float32 the output is off by up to 3e-7 / (w h) of the range in which it moves, with the
# slowest bandwidth w of an observer: what one sample adds to an estimate is lost below its last
# digit. Measured over 60 time constants, for orders 1 to 3: 2e-5 at 1e-2, 4e-4 at 1e-3, 6e-3 at
# 3e-5, where the command is off by up to 16 % of its range.
_LEAST_ANGLE = 1e-3
# Sums of more periods than these have lost 0.2 % with float32.
_MOST_PERIODS = 2**16

# Settings that are not exported: what their value must be, and why.
NOT_EXPORTED: dict[str, tuple[Callable[[ControllerSettings], bool], str]] = {
    'plant_poles': (lambda s: not any(s.plant_poles), '[0.0]: known poles are not exported'),
    'disturbance_frequencies': (
        lambda s: not any(s.disturbance_frequencies),
        '[0.0]: known vibrations are not exported',
    ),
    'b0_table': (lambda s: len(s.b0_table) == 1, '[0.0]: a b0 that varies is not exported'),
    'input_delay': (lambda s: s.input_delay == 0.0, '0: a dead time is not exported'),
    'measurement_period': (lambda s: s.measurement_period == 0.0, '0: angles are not exported'),
    'error_deadband': (lambda s: s.error_deadband == 0.0, '0: a deadband is not exported'),
    'feed_forward_timeout': (
        lambda s: s.feed_forward_timeout == 0.0,
        '0: a feed-forward is not exported; add it in the loop, and report the sum as applied',
    ),
    'applied_timeout': (
        lambda s: s.applied_timeout == 0.0,
        '0: a report counts in the call that it is handed over in; hand it over in each',
    ),
}


def exact_period(rate: float, single: bool) -> float:
    """Return 1 / rate [s], rounded so that few periods have an exact sum."""
    mantissa, exponent = frexp(1.0 / rate)
    digits = _DIGITS[single] - _SPARE_BITS
    return ldexp(round(ldexp(mantissa, digits)), exponent - digits)


def without_estimates(settings: ControllerSettings) -> ControllerSettings:
    """Return the settings with derivatives of the reference only where they are handed over."""
    if settings.reference_derivatives == 'auto':
        return attrs.evolve(settings, reference_derivatives='topics')
    return settings


def check_exportable(settings: ControllerSettings, rate: float | None) -> None:
    """
    Refuse what an export cannot have, at a fixed ``rate`` [Hz] or with measured time steps (None).

    Raises
    ------
    SettingError
        Names the setting, and what it may be.

    """
    for name, (is_off, allowed) in NOT_EXPORTED.items():
        if not is_off(settings):
            raise SettingError(name, getattr(settings, name), allowed)
    if rate is None:
        return
    if not SLOWEST_RATE <= rate <= FASTEST_RATE:
        raise SettingError('rate', rate, f'from {SLOWEST_RATE:g} to {FASTEST_RATE:g} Hz')
    settings.check_rate(rate)
    if settings.startup_time > 0.0:
        allowed = '0 at a fixed rate, where no gain is computed at run time; or use --measured-dt'
        raise SettingError('startup_time', settings.startup_time, allowed)
    longest = LONGEST_GAP / rate
    if settings.max_dt > longest:
        allowed = (
            f'at most {LONGEST_GAP} periods, {longest:g} s at {rate:g} Hz: there is a row of '
            'gains for each number of periods up to it'
        )
        raise SettingError('max_dt', settings.max_dt, allowed)


def check_single(settings: ControllerSettings, rate: float | None) -> None:
    """
    Refuse what cannot be computed with float32.

    Raises
    ------
    SettingError
        Names the setting, and what it may be.

    """
    if rate is None:
        raise UserError('--float needs a fixed rate: its own gains would be too coarse')
    structure = STRUCTURES[settings.structure]
    if structure.nonlinear or settings.feedback != 'linear':
        name = 'structure' if structure.nonlinear else 'feedback'
        allowed = 'another one with --float: powf differs in its last digits between C libraries'
        raise SettingError(name, getattr(settings, name), allowed)
    slowest = min(settings.pole_ratios)
    for level, w in enumerate(bandwidths(settings, structure.levels(settings.levels))):
        if w * slowest < _LEAST_ANGLE * rate:
            name = 'outer_bandwidth' if level else 'inner_bandwidth'
            allowed = (
                f'such that every observer pole is at {_LEAST_ANGLE * rate:g} rad/s or beyond '
                f'with --float at {rate:g} Hz: below, the last digit loses what a sample adds'
            )
            raise SettingError(name, getattr(settings, name), allowed)
    for name in ('measurement_timeout', 'reference_timeout', 'hold_time', 'stall_time'):
        if getattr(settings, name) * rate > _MOST_PERIODS:
            allowed = f'at most {_MOST_PERIODS / rate:g} s with --float at {rate:g} Hz'
            raise SettingError(name, getattr(settings, name), allowed)
