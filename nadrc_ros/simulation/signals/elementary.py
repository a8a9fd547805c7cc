"""Signals that are polynomials after their start: none, constant, step, ramp."""

from __future__ import annotations

import attrs
from nadrc_ros.simulation.signals import vocabulary
from nadrc_ros.simulation.vector import MutableVector


@attrs.frozen(kw_only=True)
class Nothing:
    """s(t) = 0."""

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        for k in range(len(out)):
            out[k] = 0.0


@attrs.frozen(kw_only=True)
class Constant:
    """s(t) = offset."""

    offset: float = vocabulary.offset()

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        for k in range(len(out)):
            out[k] = 0.0
        out[0] = self.offset


@attrs.frozen(kw_only=True)
class Step:
    """s(t) = offset, then offset + amplitude; all derivatives are 0, also at the jump."""

    offset: float = vocabulary.offset()
    amplitude: float = vocabulary.amplitude()
    start_time: float = vocabulary.start_time()

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        for k in range(len(out)):
            out[k] = 0.0
        out[0] = self.offset
        if t >= self.start_time:
            out[0] = self.offset + self.amplitude


@attrs.frozen(kw_only=True)
class Ramp:
    """s(t) = offset + slope (t - start_time) from start_time on, offset before."""

    offset: float = vocabulary.offset()
    slope: float = vocabulary.slope()
    start_time: float = vocabulary.start_time()

    def derivatives(self, t: float, out: MutableVector) -> None:
        """Write s(t), s'(t), ... into ``out``."""
        for k in range(len(out)):
            out[k] = 0.0
        out[0] = self.offset
        if t >= self.start_time:
            out[0] = self.offset + self.slope * (t - self.start_time)
            if len(out) > 1:
                out[1] = self.slope
