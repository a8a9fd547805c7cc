"""A cosine under an exponential envelope: the disturbance of the paper."""

from __future__ import annotations

from math import cos, exp, sin

import attrs
from nadrc_ros.simulation.signals import vocabulary
from nadrc_ros.simulation.vector import MutableVector


@attrs.frozen(kw_only=True)
class DecayingCosine:
    """
    s(t) = offset + amplitude exp(-decay tau) cos(frequency tau + phase), tau = t - start_time.

    It is the real part of a complex exponential, whose k-th derivative is itself times
    (-decay + i frequency)^k. The defaults give w(t) = exp(-t) cos t of the paper (Abdul-Adheem &
    Ibraheem, nested linear extended state observers, below eq. 26). Before start_time: offset.
    """

    offset: float = vocabulary.offset()
    amplitude: float = vocabulary.amplitude()
    frequency: float = vocabulary.frequency()
    phase: float = vocabulary.phase()
    decay: float = vocabulary.decay()
    start_time: float = vocabulary.start_time()

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
