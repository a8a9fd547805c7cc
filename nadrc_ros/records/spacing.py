"""The usual time between the samples of a stream, and what is so much longer that it is a gap."""

from __future__ import annotations

from collections import deque
from math import ceil

# So many spacings tell the usual one, so few are enough to tell a gap.
_LAST_SPANS, _FEWEST_SPANS = 21, 4
# The rank of the usual one among them: below the middle, as samples get lost.
_USUAL_RANK = 0.4
# A sample so many usual spacings behind another is the same one again, unless it goes on so.
_SAME_AGAIN = 0.05
# A gap is longer than so many usual spacings, and than so many times any of the last ones.
GAP_SPACINGS, _GAP_OVER_LONGEST = 10.0, 2.0


class Spacing:
    """
    The usual spacing of a stream, from the last few: that of a new rate after a dozen samples.

    Attributes
    ----------
    usual
        The spacing, in the unit of the spans; 0 before the second sample.

    """

    def __init__(self) -> None:
        self.usual = 0.0
        self._last: deque[float] = deque(maxlen=_LAST_SPANS)
        self._again = False

    def add(self, span: float) -> None:
        """Note the time between two samples."""
        before, self._again = self._again, span < _SAME_AGAIN * self.usual
        if self._again and not before:
            return
        self._last.append(span)
        ordered = sorted(self._last)
        self.usual = ordered[ceil(_USUAL_RANK * (len(ordered) - 1))]

    def is_gap(self, span: float) -> bool:
        """Tell whether the stream fell silent for so long; a burst is followed by no gap."""
        if len(self._last) < _FEWEST_SPANS or span <= GAP_SPACINGS * self.usual:
            return False
        return span > _GAP_OVER_LONGEST * max(self._last)
