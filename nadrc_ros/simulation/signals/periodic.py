"""Signals that repeat: sine, cosine, square. Before start_time they are the offset alone."""

from __future__ import annotations

from math import cos, floor, pi, sin

import attrs
from nadrc_ros.simulation.signals import vocabulary
from nadrc_ros.simulation.vector import MutableVector


@attrs.frozen(kw_only=True)
class Sine:
    """
    s(t) = offset + amplitude sin(frequency (t - start_time) + phase).

    Each derivative multiplies by the frequency and turns the angle on by a right angle.
    """

    offset: float = vocabulary.offset()
    amplitude: float = vocabulary.amplitude()
    frequency: float = vocabulary.frequency()
    phase: float = vocabulary.phase()
    start_time: float = vocabulary.start_time()

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        gain = 0.0
        if t >= self.start_time:
            gain = self.amplitude
        angle = self.frequency * (t - self.start_time) + self.phase
        now = sin(angle)
        ahead = cos(angle)
        for k in range(len(out)):
            out[k] = gain * now
            gain = gain * self.frequency
            now, ahead = ahead, -now
        out[0] = self.offset + out[0]


@attrs.frozen(kw_only=True)
class Cosine:
    """s(t) = offset + amplitude cos(frequency (t - start_time) + phase), derived like a sine."""

    offset: float = vocabulary.offset()
    amplitude: float = vocabulary.amplitude()
    frequency: float = vocabulary.frequency()
    phase: float = vocabulary.phase()
    start_time: float = vocabulary.start_time()

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        gain = 0.0
        if t >= self.start_time:
            gain = self.amplitude
        angle = self.frequency * (t - self.start_time) + self.phase
        now = cos(angle)
        ahead = -sin(angle)
        for k in range(len(out)):
            out[k] = gain * now
            gain = gain * self.frequency
            now, ahead = ahead, -now
        out[0] = self.offset + out[0]


@attrs.frozen(kw_only=True)
class Square:
    """
    s(t) = offset +- amplitude: plus in the first half of each cycle, minus in the second.

    All derivatives are 0, also at the jumps. A jump that should fall on a sample may come one
    sample early or late, since a half cycle of pi / frequency is not a float.
    """

    offset: float = vocabulary.offset()
    amplitude: float = vocabulary.amplitude()
    frequency: float = vocabulary.frequency()
    phase: float = vocabulary.phase()
    start_time: float = vocabulary.start_time()

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        for k in range(len(out)):
            out[k] = 0.0
        out[0] = self.offset
        if t >= self.start_time:
            cycles = (self.frequency * (t - self.start_time) + self.phase) / (2.0 * pi)
            if cycles - floor(cycles) < 0.5:
                out[0] = self.offset + self.amplitude
            else:
                out[0] = self.offset - self.amplitude
