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
# What goes on with that part of the speed with which it was driven is braked.
_COASTS = 0.5
# A majority of so many motions or fewer may be that of a drift.
_CONTRADICTED = 2
# A machine that went so far of its travel, and nobody knows why, is left alone.
_GONE = 0.35
# After a pulse without motion it rests for that part of one.
_SHORT_REST = 0.3
# Of the deviations, how many more a pulse asks for that is longer than the rest before it.
_DOUBT = 0.5
# Directions of the pulses: neither speed nor place is left of four.
_TURNS = (1.0, -1.0, -1.0, 1.0)
# Lengths of doublets, in segments.
_LENGTHS = (1, 2, 1, 4)


class Pattern(ABC):
    """
    A sequence of pulses.

    Attributes
    ----------
    stage
        What it does, in a word.
    complaint
        Why it has to end at once, '' if it has not.
    pushed, sign, sure, late
        How long the command has driven the present motion [s]; which sign of b0 that shows, 0
        before, and whether that is sure; and in what time it was seen at the fastest
        [s], which no dead time is longer than.
    finished, still
        Whether it came to its end, and whether the motion it waits for has not come so far.

    """

    stage = 'rest'
    complaint = ''
    pushed = 0.0
    sign = 0
    sure = False
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
        self._rested = self._drift = self._pulsed = 0.0
        self._rest: float | None = None
        self._hits = self._votes = self._count = 0
        self._seen = inf
        self.still = True

    def advance(self, guard: Guard, elapsed: float) -> float:
        """Return what is added to the resting command."""
        self._spent += elapsed
        if self._rest is None:
            self._rest = guard.away
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
                self.complaint = f'travel: it is {guard.moved:+.4g} away, by itself as it seems'
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
            over = self._spent >= self._length * (2.0 if own.moves else 1.0)
            if self._hits >= 2 or (over and abs(moved) > self._noisy):
                own.moves += 1
                self._travelled, self.still = moved, False
                self._votes += 1 if moved * self._way > 0.0 else -1
                # one motion may be that of an elastic joint, or of a drift
                self.sign = 0 if abs(self._votes) < 2 else 1 if self._votes > 0 else -1
                self.sure = abs(self._votes) > _CONTRADICTED
                self._rested = -1.0
                self._seen = min(self._seen, self._spent)
                self.late = self._seen
                self._begin('coast')
            elif over:
                self._begin('rest')
            else:
                self.pushed += elapsed
                return self._way * own.size
        if self.stage == 'coast' and self._spent >= self.late:
            # how fast it goes on, as a part of how fast it was driven
            onward = (moved / self._travelled - 1.0) * self.pushed / self._spent
            self._begin('brake' if onward > _COASTS else 'rest')
        if self.stage == 'brake':
            turned = guard.velocity * self._travelled < 0.0 and not slow
            if self._spent + 0.5 * elapsed < self.pushed and not turned:
                return -self._way * min(own.size, self._ways[-self._way].room)
            self._begin('rest')
        return 0.0

    @property
    def _threshold(self) -> float:
        share = _SHARE if self._ways[self._way].moves else _LEAST_SHARE
        return max(self._noisy, share * self._settings.travel)

    @property
    def _noisy(self) -> float:
        """Return what noise may look like, and a drift that is not known well."""
        long = self._pulsed / max(self._rested, self._settings.period)
        return _DEVIATIONS * self._settings.noise * max(1.0, _DOUBT * long)

    def _begin(self, stage: str) -> None:
        self.stage, self._spent = stage, 0.0

    def _choose(self, guard: Guard) -> None:
        """Choose the next pulse: its direction, and how large it is."""
        last, other = self._ways[self._way], self._ways[-self._way]
        far = abs(guard.moved) > _FAR * self._settings.travel
        if (
            self.sign
            and far
            and guard.moved * self._way * self.sign < 0.0
            and self._outward(guard)
        ):
            # on its way back it is driven away by more
            last.size = min(_VERIFY * last.size, last.room)
        elif last.moves and self._farthest > 0.0:
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
        self._count += 1
        way = _TURNS[self._count % len(_TURNS)]
        ahead = guard.moved + guard.velocity * 2.0 * self._length
        if self.sign and abs(ahead) > _FAR * self._settings.travel:
            way = -self.sign if ahead > 0.0 else self.sign
        self._way = -way if way in finished else way

    def _outward(self, guard: Guard) -> bool:
        """Tell whether the last pulse left it farther away than it was."""
        return abs(guard.moved) >= abs(self._base)

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


class Silence(Pattern):
    """A pulse towards where travel counts from, after which nothing is sent for a while."""

    def __init__(self, settings: ExperimentSettings) -> None:
        self._settings = settings
        self._spent = self._value = 0.0
        self.stage = 'pulse'

    def advance(self, guard: Guard, elapsed: float) -> float:
        """Return what is added to the resting command, and stays as the last that was sent."""
        settings = self._settings
        if not self._value:
            up, down = settings.highest - settings.center, settings.center - settings.lowest
            size = settings.amplitude
            back = down >= size and (up < size or settings.sign * guard.moved > 0.0)
            self._value = -size if back else min(size, up)
        self._spent += elapsed
        self.pushed += elapsed
        if self._spent > settings.segment:
            self.stage = 'silent'
        self.finished = self._spent > settings.segment + settings.silence
        return self._value


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
        self._pulses = [(length, way * to * size) for to in _TURNS] + [(settings.segment, 0.0)]
        return True
