"""
The signals by name, references and disturbances. One more is a class and a line at the end.

Every class here keeps to :class:`~nadrc_ros.simulation.protocols.Signal`. One field name means one
thing, with one default, unit and range, as fields are inherited: a node that declares each once
can offer every signal under flat parameter names. With all defaults ``decaying_cosine`` is the
disturbance exp(-t) cos t of the paper (Abdul-Adheem & Ibraheem, nested linear extended state
observers, section IV); its reference cos 0.5 t is ``cosine`` with ``frequency`` 0.5.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from math import cos, exp, floor, pi, sin, sqrt
from typing import Any, ClassVar

import attrs
from nadrc_ros.adrc.fields import (
    build,
    Declared,
    declared,
    number,
    refuse_unknown_keys,
    Registry,
)
from nadrc_ros.adrc.settings import FASTEST, HIGHEST, LEAST, LONGEST, LOWEST, STEEPEST
from nadrc_ros.simulation.protocols import MutableVector, Signal


@attrs.frozen(kw_only=True)
class _Level:
    offset: float = number(
        0.0, LOWEST, HIGHEST, '', 'constant part, and the value before start_time'
    )


@attrs.frozen(kw_only=True)
class _Change(_Level):
    start_time: float = number(
        0.0, 0.0, LONGEST, 's', 'time at which the changing part begins; offset before'
    )


@attrs.frozen(kw_only=True)
class _Move(_Change):
    amplitude: float = number(
        1.0, LOWEST, HIGHEST, '', 'size of the changing part (of the move, for a trapezoid)'
    )


@attrs.frozen(kw_only=True)
class _Wave(_Move):
    frequency: float = number(
        1.0, 0.0, FASTEST, 'rad/s', 'angular frequency (at the start, for a chirp)'
    )
    # Larger ones are no other angles, and have fewer digits.
    phase: float = number(0.0, -1e3, 1e3, 'rad', 'angle at start_time')


@attrs.frozen(kw_only=True)
class Nothing:
    """s(t) = 0."""

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        out[0] = 0.0


@attrs.frozen(kw_only=True)
class Constant(_Level):
    """s(t) = offset."""

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        out[0] = self.offset


@attrs.frozen(kw_only=True)
class Step(_Move):
    """s(t) = offset, then offset + amplitude; all derivatives are 0, also at the jump."""

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        out[0] = self.offset
        if t >= self.start_time:
            out[0] = self.offset + self.amplitude


@attrs.frozen(kw_only=True)
class Ramp(_Change):
    """s(t) = offset + slope (t - start_time) from start_time on, offset before."""

    slope: float = number(1.0, -STEEPEST, STEEPEST, '1/s', 'rate of change after start_time')

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        out[0] = self.offset
        if t >= self.start_time:
            out[0] = self.offset + self.slope * (t - self.start_time)
            if len(out) > 1:
                out[1] = self.slope


@attrs.frozen(kw_only=True)
class Trapezoid(_Move):
    """
    Move from offset by amplitude: accelerate, cruise at velocity, decelerate, rest.

    A move shorter than velocity^2 / acceleration never cruises: its peak speed is
    sqrt(|amplitude| acceleration). From the third derivative on all are 0, also at the jumps of
    the acceleration.
    """

    velocity: float = number(1.0, LEAST, HIGHEST, '1/s', 'largest speed of the move')
    acceleration: float = number(
        1.0, LEAST, HIGHEST, '1/s^2', 'acceleration and deceleration of the move'
    )

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        distance = abs(self.amplitude)
        direction = 1.0
        if self.amplitude < 0.0:
            direction = -1.0
        speed = self.velocity
        if distance * self.acceleration < speed * speed:
            speed = sqrt(distance * self.acceleration)
        rise = speed / self.acceleration
        cruise = 0.0
        if speed > 0.0:
            cruise = max(distance / speed - rise, 0.0)
        tau = t - self.start_time
        left = 2.0 * rise + cruise - tau
        place = 0.0
        rate = 0.0
        push = 0.0
        if tau < 0.0:
            place = 0.0
        elif left <= 0.0:
            place = distance
        elif tau < rise:
            place = 0.5 * self.acceleration * tau * tau
            rate = self.acceleration * tau
            push = self.acceleration
        elif tau < rise + cruise:
            place = speed * (tau - 0.5 * rise)
            rate = speed
        else:
            place = distance - 0.5 * self.acceleration * left * left
            rate = self.acceleration * left
            push = -self.acceleration
        out[0] = self.offset + direction * place
        if len(out) > 1:
            out[1] = direction * rate
        if len(out) > 2:
            out[2] = direction * push


@attrs.frozen(kw_only=True)
class Sine(_Wave):
    """
    s(t) = offset + amplitude sin(frequency (t - start_time) + phase).

    Each derivative multiplies by the frequency and turns the angle on by a right angle.
    """

    quarter_ahead: ClassVar[bool] = False

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        gain = 0.0
        if t >= self.start_time:
            gain = self.amplitude
        angle = self.frequency * (t - self.start_time) + self.phase
        now = sin(angle)
        ahead = cos(angle)
        if self.quarter_ahead:
            now, ahead = ahead, -now
        for k in range(len(out)):
            out[k] = gain * now
            gain = gain * self.frequency
            now, ahead = ahead, -now
        out[0] = self.offset + out[0]


@attrs.frozen(kw_only=True)
class Cosine(Sine):
    """s(t) = offset + amplitude cos(frequency (t - start_time) + phase)."""

    quarter_ahead: ClassVar[bool] = True


@attrs.frozen(kw_only=True)
class Square(_Wave):
    """
    s(t) = offset +- amplitude: plus in the first half of each cycle, minus in the second.

    All derivatives are 0, also at the jumps. A jump that should fall on a sample may come one
    sample early or late, since a half cycle of pi / frequency is not a float.
    """

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        out[0] = self.offset
        if t >= self.start_time:
            cycles = (self.frequency * (t - self.start_time) + self.phase) / (2.0 * pi)
            if cycles - floor(cycles) < 0.5:
                out[0] = self.offset + self.amplitude
            else:
                out[0] = self.offset - self.amplitude


@attrs.frozen(kw_only=True)
class Chirp(_Wave):
    """
    s(t) = offset + amplitude sin(phi), phi' from frequency to end_frequency in sweep_time.

    With g = exp(i phi) the Leibniz rule gives g^(k+1) = i (phi' g^(k) + k phi'' g^(k-1)), as phi
    is at most quadratic. After the sweep phi' stays at end_frequency and phi goes on without a
    jump. Before start_time the signal is the offset alone.
    """

    end_frequency: float = number(
        10.0, 0.0, FASTEST, 'rad/s', 'angular frequency at and after the end of the sweep'
    )
    sweep_time: float = number(
        10.0, 1.0 / FASTEST, LONGEST, 's', 'duration of the sweep from frequency to end_frequency'
    )

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        tau = t - self.start_time
        gain = 0.0
        if tau >= 0.0:
            gain = self.amplitude
        rate = (self.end_frequency - self.frequency) / self.sweep_time
        speed = self.frequency + rate * tau
        angle = self.phase + (self.frequency + 0.5 * rate * tau) * tau
        if tau >= self.sweep_time:
            mean = 0.5 * (self.frequency + self.end_frequency)
            angle = (
                self.phase + mean * self.sweep_time + self.end_frequency * (tau - self.sweep_time)
            )
            speed = self.end_frequency
            rate = 0.0
        re = cos(angle)
        im = sin(angle)
        last_re = 0.0
        last_im = 0.0
        for k in range(len(out)):
            out[k] = gain * im
            next_re = -(speed * im + k * rate * last_im)
            next_im = speed * re + k * rate * last_re
            last_re = re
            last_im = im
            re = next_re
            im = next_im
        out[0] = self.offset + out[0]


@attrs.frozen(kw_only=True)
class DecayingCosine(_Wave):
    """
    s(t) = offset + amplitude exp(-decay tau) cos(frequency tau + phase), tau = t - start_time.

    It is the real part of a complex exponential, whose k-th derivative is itself times
    (-decay + i frequency)^k. The defaults give w(t) = exp(-t) cos t of the paper (Abdul-Adheem &
    Ibraheem, nested linear extended state observers, below eq. 26). Before start_time: offset.
    """

    decay: float = number(1.0, 0.0, FASTEST, '1/s', 'rate of the exponential envelope')

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        tau = t - self.start_time
        envelope = 0.0
        if tau >= 0.0:
            envelope = self.amplitude * exp(-self.decay * tau)
        angle = self.frequency * tau + self.phase
        re = envelope * cos(angle)
        im = envelope * sin(angle)
        for k in range(len(out)):
            out[k] = re
            next_re = -self.decay * re - self.frequency * im
            im = self.frequency * re - self.decay * im
            re = next_re
        out[0] = self.offset + out[0]


@attrs.frozen(kw_only=True, eq=False)
class Table:
    """
    s(t_i) = v_i at increasing times; between them a straight line, or the earlier value held.

    The first derivative is the slope of the line to the right, all others are 0, and so is it
    where a value is held: before the first time, from the last one on.
    """

    times: array[float]
    values: array[float]
    linear: bool

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        after = 0  # the first index with times[after] > t
        end = len(self.times)
        while after < end:
            middle = (after + end) // 2
            if self.times[middle] <= t:
                after = middle + 1
            else:
                end = middle
        before = max(after - 1, 0)
        out[0] = self.values[before]
        if self.linear and 0 < after < len(self.times):
            span = self.times[after] - self.times[before]
            slope = (self.values[after] - self.values[before]) / span
            out[0] += slope * (t - self.times[before])
            if len(out) > 1:
                out[1] = slope


SIGNALS = Registry[type[Signal]](
    'signal',
    {
        'none': Nothing,
        'constant': Constant,
        'step': Step,
        'ramp': Ramp,
        'sine': Sine,
        'cosine': Cosine,
        'square': Square,
        'chirp': Chirp,
        'trapezoid': Trapezoid,
        'decaying_cosine': DecayingCosine,
    },
)


def signal_fields() -> dict[str, Declared]:
    """Return the union of the fields of all signals, by name: what a node declares."""
    return {name: field for cls in SIGNALS.values() for name, field in declared(cls).items()}


def make_signal(name: str, values: Mapping[str, Any]) -> Signal:
    """
    Return the signal of that name, picking its own fields out of ``values``.

    ``values`` may hold fields that only other signals have (a node holds them all); those are not
    looked at.

    Raises
    ------
    SettingError
        For an unknown name, a key that no signal has, or a value that the signal refuses.

    """
    cls = SIGNALS[name]
    own = declared(cls)
    refuse_unknown_keys(values, signal_fields())
    return build(cls, {key: value for key, value in values.items() if key in own})
