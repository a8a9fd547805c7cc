"""A sine whose frequency sweeps linearly."""

from __future__ import annotations

from math import cos, sin

import attrs
from nadrc_ros.simulation.signals import vocabulary
from nadrc_ros.simulation.vector import MutableVector


@attrs.frozen(kw_only=True)
class Chirp:
    """
    s(t) = offset + amplitude sin(phi), phi' from frequency to end_frequency in sweep_time.

    With g = exp(i phi) the Leibniz rule gives g^(k+1) = i (phi' g^(k) + k phi'' g^(k-1)), as phi
    is at most quadratic. After the sweep phi' stays at end_frequency and phi goes on without a
    jump. Before start_time the signal is the offset alone.
    """

    offset: float = vocabulary.offset()
    amplitude: float = vocabulary.amplitude()
    frequency: float = vocabulary.frequency()
    end_frequency: float = vocabulary.end_frequency()
    sweep_time: float = vocabulary.sweep_time()
    phase: float = vocabulary.phase()
    start_time: float = vocabulary.start_time()

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
