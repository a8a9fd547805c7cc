"""What a signal is: a function of time that knows its own derivatives."""

from __future__ import annotations

from typing import Protocol

from nadrc_ros.simulation.vector import MutableVector


class Signal(Protocol):
    """A scalar function of time, used as reference or as disturbance."""

    def derivatives(self, t: float, out: MutableVector) -> None:
        """
        Write s(t), s'(t), ... into ``out``: 1 to 6 entries, the k-th in unit/s^k.

        At a jump or a corner the right-hand value is written, without the impulse of a jump.
        """
        ...
