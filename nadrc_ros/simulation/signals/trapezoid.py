"""A move from one point to another with a trapezoidal velocity."""

from __future__ import annotations

from math import sqrt

import attrs
from nadrc_ros.simulation.signals import vocabulary
from nadrc_ros.simulation.vector import MutableVector


@attrs.frozen(kw_only=True)
class Trapezoid:
    """
    Move from offset by amplitude: accelerate, cruise at velocity, decelerate, rest.

    A move shorter than velocity^2 / acceleration never cruises: its peak speed is
    sqrt(|amplitude| acceleration). From the third derivative on all are 0, also at the jumps of
    the acceleration.
    """

    offset: float = vocabulary.offset()
    amplitude: float = vocabulary.amplitude()
    velocity: float = vocabulary.velocity()
    acceleration: float = vocabulary.acceleration()
    start_time: float = vocabulary.start_time()

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        for k in range(len(out)):
            out[k] = 0.0
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
