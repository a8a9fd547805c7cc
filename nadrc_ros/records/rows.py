"""
Samples of several streams, each with the time at which it left, as rows that belong to instants.

An instant is that of a measurement, or of a true output while measurements are overdue: so a
sensor that falls silent leaves rows without a measurement where the truth is known, and no rows
where nothing is. A row lasts until the next one, or for the usual time where a gap follows, and
nothing that came later gets into it.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from math import inf, isfinite, nan

import attrs
from nadrc_ros.adrc.angle import short
from nadrc_ros.records.spacing import GAP_SPACINGS, Spacing

_MEASUREMENT, _REFERENCE, _OUTPUT, _COMMAND = 'measurement', 'reference', 'output', 'command'
# A true output so many usual spacings away from every measurement is an instant of its own.
_OVERDUE_SPACINGS = 0.75
# A reference that comes at most so many times slower than the rows is one that moves with them.
_SLOWEST_MOVING = 2.0
SECOND = 1e9


@attrs.frozen
class Row:
    """The values of all signals at ``time`` [s], and when their samples left (``stamps``)."""

    time: float
    values: dict[str, float]
    stamps: dict[str, float] = attrs.field(factory=dict)


@attrs.frozen
class Gap:
    """A stream fell silent at ``time`` for ``length`` [ns], in which so many samples were lost."""

    signal: str
    time: int
    length: int
    lost: int


class Track:
    """The samples of one stream, in order of time, as long as a row may need them."""

    def __init__(self) -> None:
        self.times: list[int] = []
        self.values: list[float] = []
        self.stamps: list[float] = []
        self.spacing = Spacing()
        self._lost: list[int] = []
        self._settled = 0  # so many of them were in order when they were looked at
        self._missed = 0  # by those that were dropped

    def take(self, time: int, value: float, stamp: float, lost: int) -> None:
        """Add a sample, which may be older than those that are there."""
        place = len(self.times)
        if place and time < self.times[-1]:
            place = bisect_right(self.times, time)
        if place < self._settled:
            self._settled += 1
        self.times.insert(place, time)
        self.values.insert(place, value)
        self.stamps.insert(place, stamp)
        self._lost.insert(place, lost)

    def settle(self, until: int, signal: str) -> list[Gap]:
        """Learn from the samples up to then how often they come; return the gaps."""
        gaps = []
        while self._settled < len(self.times) and self.times[self._settled] <= until:
            if k := self._settled:
                span = self.times[k] - self.times[k - 1]
                if self.spacing.is_gap(span):
                    gaps.append(Gap(signal, self.times[k - 1], span, self._lost[k]))
                self.spacing.add(span)
            self._settled += 1
        return gaps

    def silence(self, end: int, signal: str) -> list[Gap]:
        """Return the gap up to ``end`` where the samples ended before."""
        place = bisect_right(self.times, end) - 1
        span = end - self.times[place] if place >= 0 else 0
        if not self.spacing.is_gap(span):
            return []
        time = self.times[place]
        around = slice(place, place + 2)
        lost = missing(self.times[around], self._lost[around], time, end)
        return [Gap(signal, time, span, lost)]

    def lost(self, begin: float, end: float) -> int:
        """Return how many samples were lost from ``begin`` to ``end``."""
        return self._missed + missing(self.times, self._lost, begin, end)

    def forget(self, before: int, begin: float, end: float, keep: int = 2) -> None:
        """Drop what is older, but for the last few, and what was lost from begin to end."""
        count = max(0, bisect_left(self.times, before) - keep)
        count = min(count, max(0, self._settled - 1))
        self._missed += missing(self.times[: count + 1], self._lost[: count + 1], begin, end)
        del self.times[:count], self.values[:count], self.stamps[:count], self._lost[:count]
        self._settled -= count

    def last(self, end: float) -> int:
        """Return the place of the last sample before ``end``, -1 if there is none."""
        return bisect_left(self.times, end) - 1


def missing(times: Sequence[int], lost: Sequence[int], begin: float, end: float) -> int:
    """Return how many of the ``lost`` before each time but the first are from begin to end."""
    found = 0
    for one, two, count in zip(times, times[1:], lost[1:]):
        inside = min(two, end) - max(one, begin)
        if count and inside >= 0:  # those across an end are taken to be evenly spaced
            found += round(count * inside / (two - one)) if two > one else count
    return found


class Rows:
    """
    Makes rows of samples that come in any order, but for what is late by more than is waited for.

    * The **measurement** begins the row; every one is in a row.
    * The **reference** is that at the instant: between two samples of a signal that moves, and
      comes about as often as rows do, it lies on the line between them; else the last one holds.
    * The **output** is the first one after the measurement, or the last one just before it.
    * The **command** and all estimates are the last ones before the row ends.

    Rows begin with the last instant before the first command: it is time 0.

    Parameters
    ----------
    names
        Signals, ``measurement`` and ``command`` among them.
    duration
        For how long [ns] they go on; what came later is in no row, gap or loss.

    Attributes
    ----------
    begin
        When the first row begins [ns], None before it.
    period
        Of a reference that is an angle, else 0.
    newest
        The latest time of any sample [ns].
    late
        How many measurements came after the rows of their time were made: they have none.
    gaps
        Where a stream that came regularly did not, found as rows are closed; of a reference where
        it moved on meanwhile.

    """

    def __init__(self, names: Sequence[str], duration: float = inf) -> None:
        self.begin: int | None = None
        self.period = 0.0
        self.late = 0
        self.gaps: list[Gap] = []
        self._tracks = {name: Track() for name in names}
        self._spacing = Spacing()
        self._instants: list[tuple[int, float, float]] = []
        self._known = self._last = -1  # instants: all up to here are known, the last one
        self.newest = -1
        self._duration = duration
        self._over = False  # all up to the end is known

    @property
    def lost(self) -> dict[str, int]:
        """Return how many samples of each signal were lost so far."""
        begin = self.begin
        if begin is None:
            begin = next(iter(self._tracks[_COMMAND].times), None)
        span = inf if begin is None else begin, self._limit
        return {name: track.lost(*span) for name, track in self._tracks.items()}

    @property
    def stop(self) -> float:
        """Return when the last row ends [ns]: that of the newest sample, or of the duration."""
        return self._limit if self._over else min(self.newest, self._limit)

    @property
    def _limit(self) -> float:
        return inf if self.begin is None else self.begin + self._duration

    def take(self, name: str, time: int, value: float, stamp: float = nan, lost: int = 0) -> None:
        """
        Take a sample that left at ``time`` [ns] of any one clock.

        ``stamp`` goes with it into the row; ``lost`` is how many are missing before it.
        """
        self.newest = max(self.newest, time)
        if name == _MEASUREMENT and time <= self._known:
            self.late += 1
        else:
            self._tracks[name].take(time, value, stamp, lost)

    def unheard(self) -> list[str]:
        """Return the signals of which there was no sample so far."""
        return [name for name, track in self._tracks.items() if not track.times]

    def complete(self) -> int:
        """
        Return up to when [ns] all samples are there of streams that come about as often as rows.

        Those of one stream come in order, and a stream that fell silent is not waited for.
        """
        most = _SLOWEST_MOVING * self._due()
        newest = [
            track.times[-1]
            for track in self._tracks.values()
            if track.times and 0.0 < track.spacing.usual <= most
        ]
        return min((time for time in newest if self.newest - time < SECOND), default=-1)

    def close(self, until: int) -> list[Row]:
        """Return the rows that are over at ``until`` [ns], all samples up to then being there."""
        return self._close(until, _OVERDUE_SPACINGS)

    def end(self) -> list[Row]:
        """Return all rows that are left; a stream that ended before the others leaves a gap."""
        rows = self._close(self.newest, 0.0)
        if self.begin is None:
            return rows
        if self._instants:
            rows.append(self._row(self._instants.pop(), inf))
        for name, track in self._tracks.items():
            if name != _REFERENCE:
                self.gaps += track.silence(int(self.stop), name)
        return rows

    def _close(self, until: int, wait: float) -> list[Row]:
        """Close rows; a measurement may come so many spacings after an output before ``until``."""
        # What comes after the end of the run is in no row, gap or loss, however late we look.
        self._over = self._over or until >= self._limit
        until = int(min(until, self._limit))
        for name, track in self._tracks.items():
            found = track.settle(until, name)
            self.gaps += [gap for gap in found if name != _REFERENCE or self._went_on(track, gap)]
        self._find_instants(until - int(wait * self._due()) if _OUTPUT in self._tracks else until)
        if self.begin is None and not self._start():
            self._forget()
            return []
        # An instant is over with the next one, since only then is its last command known: the one
        # that acted until then. The newest waits, unless it is silence that follows.
        rows = [self._row(one, two[0]) for one, two in zip(self._instants, self._instants[1:])]
        del self._instants[: len(rows)]
        if self._instants and self._spacing.is_gap(until - self._instants[0][0]):
            rows.append(self._row(self._instants.pop(), inf))
        self._forget()
        return rows

    # ---- instants ----

    def _due(self) -> float:
        """Return the usual spacing of measurements [ns], that of outputs where there are none."""
        measured = self._tracks[_MEASUREMENT]
        usual = measured.spacing.usual
        if not usual and len(measured.times) > 1:
            usual = measured.times[1] - measured.times[0]
        output = self._tracks.get(_OUTPUT)
        return usual or (output.spacing.usual if output is not None else 0.0)

    def _find_instants(self, known: int) -> None:
        """Find the instants up to ``known`` [ns]."""
        output, apart = self._tracks.get(_OUTPUT), _OVERDUE_SPACINGS * self._due()
        if known <= self._known:
            return
        measured = self._tracks[_MEASUREMENT]
        first, last = (bisect_right(measured.times, t) for t in (self._known, known))
        found = list(zip(measured.times, measured.values, measured.stamps))[first:last]
        if output is not None and apart:
            begin, end = (bisect_right(output.times, t) for t in (self._known, known))
            found += [(t, nan, nan) for t in output.times[begin:end] if self._alone(t, apart)]
            found.sort(key=lambda instant: instant[0])
        for time, value, stamp in found:
            self._last = max(time, self._last + 1)  # simulated time may stand still
            self._instants.append((self._last, value, stamp))
        self._known = known

    def _alone(self, time: int, apart: float) -> bool:
        """Tell whether no measurement is as near as that."""
        times = self._tracks[_MEASUREMENT].times
        place = bisect_left(times, time)
        near = times[max(0, place - 1) : place + 1]
        return all(abs(each - time) > apart for each in near)

    def _start(self) -> bool:
        """Begin with the last instant before the first command, or the first one after it."""
        command = self._tracks[_COMMAND].times
        if not self._instants:
            return False
        # A command later than what is known may have a predecessor that is still on its way.
        first = command[0] if command and command[0] <= self._known else inf
        before = bisect_right(self._instants, first, key=lambda instant: instant[0])
        del self._instants[: max(0, before - 1)]
        if first == inf:
            return False
        self.begin = self._instants[0][0]
        return True

    # ---- rows ----

    def _row(self, instant: tuple[int, float, float], end: float) -> Row:
        """Make the row of an instant, the next one being at ``end`` [ns]."""
        assert self.begin is not None
        time, measurement, stamp = instant
        span, usual = end - time, self._spacing.usual
        if isfinite(end) and not self._spacing.is_gap(span):
            self._spacing.add(span)
        else:  # a command from the end of a silence is not what answered its beginning
            end = time + (usual or inf)
        values, stamps = {}, {}
        for name, track in self._tracks.items():
            if name == _MEASUREMENT:
                values[name], stamps[name] = measurement, stamp
                continue
            place = self._place(name, track, time, end)
            values[name] = track.values[place] if place >= 0 else nan
            stamps[name] = track.stamps[place] if place >= 0 else nan
            if name == _REFERENCE and place >= 0:
                values[name] = self._between(track, place, time)
        return Row((time - self.begin) / SECOND, values, stamps)

    def _place(self, name: str, track: Track, time: int, end: float) -> int:
        """Return the place of the sample that belongs to the row, -1 if there is none."""
        if name == _REFERENCE:
            return bisect_right(track.times, time) - 1
        if name != _OUTPUT:
            return track.last(end)
        place, usual = track.last(time), self._spacing.usual or inf
        after = track.times[place + 1] - time if place + 1 < len(track.times) else inf
        if after < min(_OVERDUE_SPACINGS * usual, end - time):
            return place + 1
        return place if place >= 0 and time - track.times[place] < 0.5 * usual else -1

    def _between(self, track: Track, place: int, time: int) -> float:
        """Return a reference at ``time``, on the line to the next sample where it moves."""
        value = track.values[place]
        if not self._moves(track, place, self._spacing.usual):
            return value
        span = track.times[place + 1] - track.times[place]
        if span > GAP_SPACINGS * self._spacing.usual:
            return value
        following = track.values[place + 1]
        return value + short(following - value, self.period) * (time - track.times[place]) / span

    def _moves(self, track: Track, place: int, usual: float) -> bool:
        """Tell whether a reference moves at a sample, and comes about as often as rows do."""
        if not 1 <= place < len(track.times) - 1:
            return False
        before, value, following = track.values[place - 1 : place + 2]
        # After a value that is held the next one is a step: on a line it would come too early.
        moves = value != before and isfinite(following)
        return moves and track.spacing.usual <= _SLOWEST_MOVING * usual

    def _went_on(self, track: Track, gap: Gap) -> bool:
        """Tell whether a reference moved on while nothing was heard of it; else it was held."""
        place = bisect_right(track.times, gap.time) - 1
        return (
            self._moves(track, place, self._due())
            and track.values[place + 1] != track.values[place]
        )

    def _forget(self) -> None:
        """Drop what no row will need."""
        needed = self._instants[0][0] if self._instants else self._known
        begin = inf if self.begin is None else self.begin
        for track in self._tracks.values():
            track.forget(needed, begin, self._limit)
