"""What an experiment adds to the resting command, pulse by pulse."""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import inf

from nadrc_ros.adrc.commission.guard import Guard
from nadrc_ros.adrc.commission.settings import ExperimentSettings

# Growth of the pulses of a staircase, and of those once the output moved.
_GROWTH, _VERIFY, _VERIFICATIONS = 1.25, 1.5, 2
# Six deviations of the noise are a motion; of the larger pulses that share of the travel.
_DEVIATIONS, _LEAST_SHARE, _SHARE = 6.0, 1e-3, 0.05
# Of speed and travel, what a larger pulse may lead to; of the travel, from where it goes back.
_LARGEST, _FAR = 0.35, 0.2
# A machine that went so far of its travel, and nobody knows why, is left alone.
_GONE = 0.35
# After a pulse without motion it rests for that part of one.
_SHORT_REST = 0.3
# Lengths of doublets, in segments, and where the pulses of each go: neither speed nor place of a
# chain of one or two integrators is left.
_LENGTHS = (1, 2, 1, 4)
_WAYS = (1.0, -1.0, -1.0, 1.0)


class Pattern(ABC):
    """
    A sequence of pulses.

    Attributes
    ----------
    stage
        What it does, in a word.
    complaint
        Why it has to end at once, '' if it has not.
    pushed, sign, late
        How long the command has driven the present motion [s]; which sign of b0 that shows, 0
        before; and in what time it was seen at the fastest [s], which no dead time is longer than.
    finished, still
        Whether it came to its end, and whether the motion it waits for has not come so far.

    """

    stage = 'rest'
    complaint = ''
    pushed = 0.0
    sign = 0
    late = 0.0
    finished = False
    still = False

    @abstractmethod
    def advance(self, guard: Guard, elapsed: float) -> float:
        """Return what is added to the resting command until the next tick [command unit]."""


class Staircase(Pattern):
    """
    Pulses of one direction and the other, each larger than the one before, until both move.

    A pulse ends when the output has moved. Then the machine is let go, for as long as it took to
    see the motion. What coasts is braked by the opposite of the pulse until it turns, for no
    longer than it was driven: whatever the sign of b0 is, that takes the energy out. Some more
    pulses of each direction follow, as much larger as the bounds allow.
    """

    def __init__(self, settings: ExperimentSettings) -> None:
        self._settings = settings
        up, down = settings.highest - settings.center, settings.center - settings.lowest
        self._ways = {
            way: _Way(min(settings.amplitude, room), room)
            for way, room in ((1.0, up), (-1.0, down))
        }
        self._length = settings.segment
        self._way = 1.0 if up > 0.0 else -1.0
        self._base = self._spent = self._farthest = self._fastest = self._travelled = 0.0
        # drift: since the last motion ended, how long and from where
        self._rested = self._rest = self._drift = self._pulsed = 0.0
        self._hits = self._votes = 0
        self._seen = inf
        self.still = True

    def advance(self, guard: Guard, elapsed: float) -> float:
        """Return what is added to the resting command."""
        self._spent += elapsed
        moved = guard.moved - self._base
        if self.stage in ('pulse', 'coast'):
            moved -= self._drift * self._pulsed
            self._pulsed += elapsed
        self._farthest = max(self._farthest, abs(moved))
        self._fastest = max(self._fastest, abs(guard.velocity))
        slow = abs(guard.velocity) <= guard.still
        own = self._ways[self._way]
        if self._rested >= 0.0:
            self._rested += elapsed
        elif self.stage == 'rest' and self._spent > 0.3 * self._length:
            self._rested, self._rest = 0.0, guard.moved
        if self.stage == 'rest':
            if self.sign == 0 and abs(guard.moved) > _GONE * self._settings.travel:
                self.complaint = f'travel: it moves by itself, and is {guard.moved:+.4g} away'
            least = self._length * (1.0 if own.moves else _SHORT_REST)
            if self._spent < least or not (slow or self._spent >= 4.0 * self._length):
                return 0.0
            self._choose(guard)
            own = self._ways[self._way]
            self._begin('pulse')
            if self._rested > 0.0:
                self._drift = (guard.moved - self._rest) / self._rested
            self._base, self._hits, self._pulsed = guard.moved, 0, 0.0
            self.pushed = self._farthest = self._fastest = moved = 0.0
        if self.stage == 'pulse':
            self._hits = self._hits + 1 if abs(moved) > self._threshold else 0
            if self._hits >= 2:
                own.moves += 1
                self._travelled, self.still = moved, False
                self._votes += 1 if moved * self._way > 0.0 else -1
                # one motion may be that of an elastic joint
                self.sign = 0 if abs(self._votes) < 2 else 1 if self._votes > 0 else -1
                self._rested = -1.0
                self._seen = min(self._seen, self._spent)
                self.late = self._seen
                self._begin('coast')
            elif self._spent >= self._length * (2.0 if own.moves else 1.0):
                self._begin('rest')
            else:
                self.pushed += elapsed
                return self._way * own.size
        onward = guard.velocity * self._travelled > 0.0
        if self.stage == 'coast' and self._spent >= self.late:
            self._begin('brake' if onward and not slow else 'rest')
        if self.stage == 'brake':
            if self._spent + 0.5 * elapsed < self.pushed and (onward or slow):
                return -self._way * min(own.size, self._ways[-self._way].room)
            self._begin('rest')
        return 0.0

    @property
    def _threshold(self) -> float:
        least = _DEVIATIONS * self._settings.noise
        share = _LEAST_SHARE if self.still else _SHARE
        return max(least, share * self._settings.travel)

    def _begin(self, stage: str) -> None:
        self.stage, self._spent = stage, 0.0

    def _choose(self, guard: Guard) -> None:
        """Choose the next pulse: its direction, and how large it is."""
        last, other = self._ways[self._way], self._ways[-self._way]
        if last.moves and self._farthest > 0.0:
            fast = self._fastest / self._settings.speed
            # at worst all that the last pulse had more than one without motion drove it
            room = _LARGEST / max(fast, self._farthest / self._settings.travel, 1e-3)
            more = last.size + (last.size - last.without) * (room - 1.0)
            last.size = min(max(min(more, _VERIFY * last.size), last.without), last.room)
        elif self.pushed > 0.0:
            if last.size >= last.room and other.size >= other.room and self.still:
                self._length *= 2.0
            last.without = last.size
            last.size = min(_GROWTH * last.size, last.room)
        finished = [way for way, each in self._ways.items() if self._done(each, self._ways[-way])]
        if len(finished) == 2:
            self.finished = True
        way = -self._way
        ahead = guard.moved + guard.velocity * 2.0 * self._length
        if self.sign and abs(ahead) > _FAR * self._settings.travel:
            way = -self.sign if ahead > 0.0 else self.sign
        self._way = -way if way in finished else way

    def _done(self, own: _Way, other: _Way) -> bool:
        """Tell whether enough is known of a direction: it moved, or is blocked, or has no room."""
        blocked = other.moves > _VERIFICATIONS and own.size >= own.room and not own.moves
        return own.room <= 0.0 or own.moves > _VERIFICATIONS or blocked


class _Way:
    """
    One direction of a staircase.

    Size of its next pulse and the largest possible [command unit], of the last one ``without``
    motion, and how many brought ``moves``.
    """

    def __init__(self, size: float, room: float) -> None:
        self.size, self.room = size, room
        self.without = 0.0
        self.moves = 0


class Doublets(Pattern):
    """Doublets to and fro, back to back, in lengths and directions that a seed draws."""

    def __init__(self, settings: ExperimentSettings) -> None:
        self._settings = settings
        self._random = settings.seed
        self._pulses: list[tuple[float, float]] = []
        self._spent = self._length = self._value = 0.0
        self._time = 0.0
        self.stage = 'doublet'

    def advance(self, guard: Guard, elapsed: float) -> float:
        """Return what is added to the resting command."""
        self._spent += elapsed
        self._time += elapsed
        self.pushed += elapsed
        # half a tick early rather than half a tick late, on average
        if self._spent + 0.5 * elapsed >= self._length:
            if not self._pulses and not self._draw():
                self.finished = True
                return 0.0
            self._length, self._value = self._pulses.pop(0)
            self._spent = self.pushed = 0.0
        return self._value

    def _draw(self) -> bool:
        """Draw the next doublet if there is time for it."""
        settings = self._settings
        # A linear congruential generator (Numerical Recipes' constants): the same on any machine.
        self._random = (1664525 * self._random + 1013904223) % 2**32
        length = _LENGTHS[self._random // 2**16 % len(_LENGTHS)] * settings.segment
        way = 1.0 if self._random // 2**24 % 2 else -1.0
        if self._time + 5.0 * length > settings.longest:
            return False
        size = settings.amplitude
        self._pulses = [(length, way * to * size) for to in _WAYS] + [(settings.segment, 0.0)]
        return True
