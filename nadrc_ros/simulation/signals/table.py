"""A signal that is given by its values at some times."""

from __future__ import annotations

from array import array

import attrs
from nadrc_ros.simulation.vector import MutableVector


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
        for k in range(len(out)):
            out[k] = 0.0
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
