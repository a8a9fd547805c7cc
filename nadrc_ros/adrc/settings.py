"""The settings of the controller: every number a user may choose, with unit, range and meaning."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import choice, flag, integer, number, numbers
from nadrc_ros.adrc.known_checks import check_known
from nadrc_ros.adrc.rate_checks import check_known_rate, check_times
from nadrc_ros.adrc.structures import STRUCTURES

MAX_LEVELS = 6
# Bounds of what may be real. They are there for the arithmetic alone: products of what the law
# multiplies, powers of bandwidths among them, stay far from 1e308 and from 0.
# Of every signal, in any unit. What is larger counts as no number at all: the observers forget it
# in ln(1e15) / (w h) samples, which is as long as one wrong sample may last.
HIGHEST = 1e15
LOWEST = -HIGHEST
# Of positive numbers that something is divided by: one over it is within HIGHEST.
LEAST = 1e-15
# Of bandwidths and frequencies [rad/s]: the tenth power of either is a float.
SLOWEST, FASTEST = 1e-9, 1e6
# Of times [s], 30 years: in ns they fit in 63 bits, and t = k / rate tells 1e-7 s apart.
LONGEST = 1e9
# Of rates [Hz]: a million periods are within LONGEST, and one is 10,000 steps of a clock in ns.
SLOWEST_RATE, FASTEST_RATE = 1e-3, 1e5
# Of gains and slopes: a signal within HIGHEST changes so fast in the shortest step of time, 1 ns.
STEEPEST = 1e24
# How many derivatives of the reference have a topic: the rate and the acceleration.
REFERENCE_DERIVATIVES = 2
# What b0 may be a function of.
GAIN_SOURCES = ('measurement', 'reference', 'topic')


def _signal(default: float, unit: str, description: str, **more: bool) -> Any:
    return number(default, LOWEST, HIGHEST, unit, description, **more)


def _bandwidth(default: float, description: str) -> Any:
    return number(default, SLOWEST, FASTEST, 'rad/s', description)


def _seconds(default: float, description: str, **more: bool) -> Any:
    return number(default, 0.0, LONGEST, 's', description, **more)


@attrs.frozen(kw_only=True)
class ControllerSettings:
    """
    Everything that defines one N-ADRC controller, validated at construction.

    Raises
    ------
    SettingError
        For a wrong type, a value that is not finite or out of range, a minimum that is not below
        its maximum, a ``safe_command`` outside the limits, or a list of the wrong length.

    """

    plant_order: int = integer(
        2, 1, 5, 'order n of the plant: y^(n) = b0 u + total disturbance', live=False
    )
    b0: float = _signal(
        1.0, 'y^(n) per unit command', 'nominal input gain of the plant', nonzero=True
    )
    b0_table: tuple[float, ...] = numbers(
        (0.0,),
        LOWEST,
        HIGHEST,
        '',
        'b0 as a function of a variable, piecewise linear between points and constant beyond: '
        '[x1, b1, x2, b2, ...], x ascending, every b of the sign of b0, which holds until the '
        'variable is known; [0] = off: b0 is constant',
    )
    b0_source: str = choice(
        'measurement',
        GAIN_SOURCES,
        'the variable of b0_table: the output as estimated, the reference as followed, or what '
        'comes on b0_variable',
        live=False,
    )
    structure: str = choice(
        'nested',
        tuple(STRUCTURES),
        'observer: ' + '; '.join(f'{name} = {s.description}' for name, s in STRUCTURES.items()),
    )
    inner_bandwidth: float = _bandwidth(40.0, 'bandwidth of level 1, the inner observer')
    outer_bandwidth: float = _bandwidth(
        30.0, 'bandwidth of level 2, the outer observer; ignored with one level'
    )
    levels: int = integer(
        2,
        1,
        MAX_LEVELS,
        'levels K of the nested, cascade and nonlinear structures; ignored by the others',
    )
    bandwidth_ratio: float = number(
        0.5,
        0.01,  # the sixth level is within 1e-8 to 1e4 of the first: all poles are floats
        10.0,
        '',
        'bandwidth of each level beyond the second, relative to the one before',
    )
    extended_states: int = integer(
        2,
        1,
        5,  # the poles of n + m = 10 states are where they should be to 1e-11
        'extended states m of the generalized structure; ignored by the others',
    )
    pole_ratios: tuple[float, ...] = numbers(
        (1.0,),
        1e-3,  # a pole six decades from another is no part of the same observer
        1e3,
        'of the bandwidth',
        'observer poles, one entry for each of the n + m states; the last one counts for the '
        'rest; then one for each of disturbance_frequencies, 0.1 without',
    )
    plant_poles: tuple[float, ...] = numbers(
        (0.0,),
        -FASTEST,
        FASTEST,
        'rad/s',
        'known real poles of the plant, such as -1 / time constant of a lag, up to n; those that '
        'are left out are 0 = integrators, of which nothing is known',
    )
    disturbance_frequencies: tuple[float, ...] = numbers(
        (0.0,),
        0.0,
        FASTEST,
        'rad/s',
        'known frequencies of the disturbance, up to 3, which level 1 models; 0 = none',
    )
    observer_gain_factor: float = number(
        1.0,
        0.5,  # half-gain tuning; no use of less is known
        1.0,
        '',
        'share of the observer gains that acts; 0.5 = half-gain tuning: nearly the same rejection '
        'with less noise, for some of the upper gain margin',
    )
    startup_time: float = _seconds(
        0.0, 'time after the first start over which the observer bandwidths rise as t^3; 0 = off'
    )
    eso_delta: float = number(
        0.01,
        LEAST,
        HIGHEST,
        'output unit',
        'innovation up to which the nonlinear structure is the nested one; ignored by the others',
    )
    controller_bandwidth: float = _bandwidth(
        4.0, 'closed-loop bandwidth wc: feedback gains from (s + wc)^n'
    )
    feedback: str = choice(
        'linear', ('linear', 'fal'), 'state error feedback: linear, or the nonlinear fal (NLSEF)'
    )
    fal_gains: tuple[float, ...] = numbers(
        (0.0,),
        0.0,
        FASTEST**5,  # as the linear ones
        '',
        'gains k_1..k_n of fal; one entry for all; 0 = from controller_bandwidth',
    )
    fal_exponents: tuple[float, ...] = numbers(
        (0.75,),
        0.01,  # less is a switch; more than 1 grows with the error
        1.0,
        '',
        'exponents alpha_1..alpha_n of fal; one entry for all; 1 = linear',
    )
    fal_delta: float = number(
        0.01, LEAST, HIGHEST, 'of the state error', 'half-width of the linear zone of fal'
    )
    feedback_level: str = choice(
        'inner',
        ('inner', 'outer', *(str(k) for k in range(1, MAX_LEVELS + 1))),
        'level whose states the feedback uses; a number above the count means the last level',
    )
    tracking_acceleration: float = number(
        0.0,
        0.0,
        STEEPEST,
        'reference unit/s^2',
        'acceleration R of the tracking differentiator, which replaces received derivatives; '
        '0 = off',
    )
    reference_derivatives: str = choice(
        'auto',
        ('auto', 'topics', 'differentiator', 'none'),
        'derivatives of the reference: received, and from its own samples while they do not come; '
        'only received; from the tracking differentiator; or taken as 0',
        live=False,
    )
    error_based: bool = flag(
        False,
        'observe y - r with reference zero, for references with unknown derivatives',
    )
    error_deadband: float = number(
        0.0,
        0.0,
        HIGHEST,
        'output unit',
        'error up to which a loop that came to rest within half of it leaves its command as it '
        'is; 0 = off',
    )
    command_min: float = _signal(-100.0, 'command unit', 'lowest command ever published')
    command_max: float = _signal(100.0, 'command unit', 'highest command ever published')
    command_rate_limit: float = number(
        0.0, 0.0, STEEPEST, 'command unit/s', 'fastest change of the command; 0 = off'
    )
    safe_command: float = _signal(
        0.0, 'command unit', 'command when there is nothing to control with; inside the limits'
    )
    input_delay: float = _seconds(
        0.0,
        'dead time of the plant: from a sample until the command that answers it acts; the '
        'observers are driven by the command of so long ago, while the feedback acts on the '
        'present estimate (no predictor); 0 = off',
    )
    measurement_min: float = _signal(
        LOWEST,
        'output unit',
        'lowest value that the sensor can give; a measurement below counts as none',
    )
    measurement_max: float = _signal(
        HIGHEST,
        'output unit',
        'highest value that the sensor can give; a measurement above counts as none',
    )
    reference_min: float = _signal(
        LOWEST, 'reference unit', 'lowest reference that is taken; one below counts as none'
    )
    reference_max: float = _signal(
        HIGHEST, 'reference unit', 'highest reference that is taken; one above counts as none'
    )
    measurement_period: float = number(
        0.0,
        0.0,
        HIGHEST,
        'output unit',
        'period of an angle, as 6.283185307179586 or 360: measurement and reference mean the same '
        'a period further; 0 = no angle',
        live=False,
    )
    measurement_timeout: float = _seconds(
        0.25, 'silence of valid measurements that starts the fault action; 0 = off'
    )
    reference_timeout: float = _seconds(
        0.0, 'silence of valid references that starts the fault action; 0 = off'
    )
    applied_timeout: float = _seconds(
        0.0, 'how long a report counts of the command that really acts; 0 = off', live=False
    )
    feed_forward_timeout: float = _seconds(
        0.0, 'how long a feed-forward counts; then it is ramped out; 0 = off', live=False
    )
    hold_time: float = _seconds(0.1, 'time the fault action holds before it ramps to safe_command')
    max_dt: float = number(
        0.5,
        1.0 / FASTEST,
        LONGEST,
        's',
        'longest gap between samples; beyond it the observers restart',
    )
    good_samples: int = integer(
        3, 1, 1000000, 'valid samples in a row before the law acts, at the start and after a fault'
    )
    stall_time: float = number(
        0.0,
        0.0,
        3600.0,
        's',
        'time at a limit of the command, not the safe one, without coming nearer to the reference '
        'that is a stall; 0 = off',
    )
    stall_action: str = choice(
        'warn',
        ('warn', 'fault'),
        'effect of a stall: a warning, or the fault action until the loop is enabled again',
    )

    def __attrs_post_init__(self) -> None:
        for signal in ('command', 'measurement', 'reference'):
            low, high = getattr(self, f'{signal}_min'), getattr(self, f'{signal}_max')
            if not low < high:
                raise SettingError(f'{signal}_min', low, f'below {signal}_max = {high!r}')
        if not self.command_min <= self.safe_command <= self.command_max:
            raise SettingError(
                'safe_command',
                self.safe_command,
                f'from command_min = {self.command_min!r} to command_max = {self.command_max!r}',
            )
        how, tracked = self.reference_derivatives, self.tracking_acceleration > 0.0
        if (how == 'differentiator' and not tracked) or (how == 'none' and tracked):
            allowed = f'{"0 (off)" if tracked else "above 0"} with reference_derivatives = {how}'
            raise SettingError('tracking_acceleration', self.tracking_acceleration, allowed)
        travel = self.measurement_max - self.measurement_min
        if 0.99 * self.measurement_period > travel:  # counts lack the last one: 4095 of 4096
            raise SettingError(
                'measurement_period',
                self.measurement_period,
                f'at most measurement_max - measurement_min = {travel:g}, or 0: where the output '
                'cannot turn all the way round, as in a joint with end stops, the short way ends '
                'at a stop',
            )
        self._check_table()
        check_known(
            self.known_poles, self.disturbance_frequencies, SLOWEST, self.measurement_period
        )
        if 0.0 < 0.5 * self.measurement_period <= self.error_deadband:
            allowed = f'less than half of measurement_period = {self.measurement_period!r}'
            raise SettingError('error_deadband', self.error_deadband, allowed)
        n = self.plant_order
        if len(self.plant_poles) > n:
            allowed = f'a list of at most plant_order = {n} entries'
            raise SettingError('plant_poles', self.plant_poles, allowed)
        self._check_length('fal_gains', n)
        self._check_length('fal_exponents', n)

    @property
    def known_poles(self) -> tuple[float, ...]:
        """Return a pole of the plant for each order [rad/s], 0 where none is known."""
        return self.plant_poles + (0.0,) * (self.plant_order - len(self.plant_poles))

    @property
    def received_derivatives(self) -> int:
        """How many derivatives of the reference the law takes from outside."""
        if self.reference_derivatives not in ('auto', 'topics'):
            return 0
        return min(self.plant_order, REFERENCE_DERIVATIVES)

    def check_rate(self, rate: float) -> None:
        """Refuse, by a ``SettingError``, what is too fast for a loop at ``rate`` [Hz]."""
        check_known_rate(self.plant_poles, self.disturbance_frequencies, rate)
        check_times(
            rate,
            measurement_timeout=self.measurement_timeout,
            max_dt=self.max_dt,
            applied_timeout=self.applied_timeout,
            feed_forward_timeout=self.feed_forward_timeout,
            input_delay=self.input_delay,
        )

    def _check_table(self) -> None:
        table = self.b0_table
        if table == (0.0,):
            return
        x, b = table[::2], table[1::2]
        if len(b) < 2 or len(x) != len(b):
            raise SettingError('b0_table', table, '[0] or a list x1, b1, x2, b2, ... of pairs')
        if not all(left < right for left, right in pairwise(x)):
            raise SettingError('b0_table', table, 'a list with x1 < x2 < ...')
        if not all(abs(gain) >= LEAST and gain * self.b0 > 0.0 for gain in b):
            raise SettingError(
                'b0_table',
                table,
                f'a list with b1, b2, ... not 0 and of the sign of b0 = {self.b0!r}',
            )

    def check_inner(self, inner: ControllerSettings, of: str = 'the inner loop') -> None:
        """
        Refuse an inner loop that would not take every command of this one as it is.

        Raises
        ------
        SettingError
            Names the limit of the command, and that ``of`` the inner loop; or its period of an
            angle, or what is asked of others that the inner loop knows.

        """
        if inner.measurement_period > 0.0:
            allowed = f'0 of {of}: it would follow another command than the one that it is given'
            raise SettingError('measurement_period', inner.measurement_period, allowed)
        if self.applied_timeout > 0.0:
            allowed = f'0 (off): {of} says what it made of the command'
            raise SettingError('applied_timeout', self.applied_timeout, allowed)
        if self.command_min < inner.reference_min:
            allowed = f'at least reference_min = {inner.reference_min!r} of {of}'
            raise SettingError('command_min', self.command_min, allowed)
        if self.command_max > inner.reference_max:
            allowed = f'at most reference_max = {inner.reference_max!r} of {of}'
            raise SettingError('command_max', self.command_max, allowed)

    def _check_length(self, name: str, count: int) -> None:
        values = getattr(self, name)
        if len(values) not in (1, count):
            raise SettingError(name, values, f'a list of 1 or {count} entries')
