"""The reference as it is received: what comes of it, and what stands for what does not."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.reference import blank_memory, ESTIMATED, estimated, follow
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST, LOWEST
from nadrc_ros.adrc.status import Status


class ReferenceIntake:
    """
    Keeps the last good reference of a controller, and adds those that are not to its ``counts``.

    Attributes
    ----------
    values
        r and its derivatives (n+1,) as they are followed.
    memory
        What the samples of r show of its derivatives, see :mod:`~nadrc_ros.adrc.reference`.
    span
        What was said of the time since the reference before [s], 0 for nothing.
    refused
        The last reference, if it was out of range; nan once a good one came.

    """

    def __init__(self, settings: ControllerSettings, counts: dict[Status, int]) -> None:
        size = settings.plant_order + 1
        self.values = [0.0] * size
        self.memory = blank_memory()
        self.refused = nan
        self.span = 0.0
        self._counts = counts
        self._received = 1 + settings.received_derivatives
        self._auto = settings.reference_derivatives == 'auto'
        self._ages = [0.0] * size
        self._estimated = [self._auto and i > 0 for i in range(size)]
        self._incomplete = self._auto

    def advance(
        self,
        design: Design,
        reference: Sequence[float | None] | None,
        elapsed: float,
        span: float,
    ) -> bool:
        """Let ``elapsed`` seconds pass and take a reference, if one came; tell whether it is."""
        self.span = span
        ages = self._ages
        for i in range(1, len(ages)):
            ages[i] += elapsed
        taken = reference is not None and self._take(design, reference)
        if self._incomplete:
            values = self.values
            if follow(design, self.memory, values[0], taken, elapsed, span):
                for i in range(1, min(len(values), 1 + ESTIMATED)):
                    if self._estimated[i]:
                        values[i] = estimated(self.memory, i)
        return taken

    def drop_old(self, longest: float) -> bool:
        """
        Count derivatives that are older as 0, or as estimated; tell whether others are followed.

        ``longest`` is in [s]. From then on they are estimated, until they come again.
        """
        values, dropped = self.values, False
        for i in range(1, len(values)):
            if self._ages[i] > longest and not self._estimated[i]:
                instead = 0.0
                if self._auto and i < self._received:
                    self._estimated[i] = True
                    instead = estimated(self.memory, i)
                dropped = dropped or values[i] != instead
                values[i] = instead
        return dropped

    def _take(self, design: Design, reference: Sequence[float | None]) -> bool:
        """Keep a received reference with its known derivatives; refuse nonsense, count it."""
        bad = False
        for value in reference:
            if value is not None and not LOWEST <= value <= HIGHEST:
                bad = True
        if bad:
            self._counts[Status.BAD_REFERENCE] += 1
        given = min(self._received, len(reference))
        r = reference[0] if given else None
        if r is None or not LOWEST <= r <= HIGHEST:
            return False
        if not design.reference_min <= r <= design.reference_max:
            self._counts[Status.BAD_REFERENCE] += 1
            self.refused = r
            return False
        self.refused = nan
        self._incomplete = False
        for i in range(len(self.values)):
            value = reference[i] if i < given else None if self._auto else 0.0
            if value is not None and LOWEST <= value <= HIGHEST:
                self.values[i] = value
                self._ages[i] = 0.0
                self._estimated[i] = False
            elif i < self._received:
                self._incomplete = self._auto
        if self._auto and len(self.values) > 3:  # the third one goes with the second
            self._estimated[3] = self._estimated[2]
            if not self._estimated[3]:
                self.values[3] = 0.0
        return True
