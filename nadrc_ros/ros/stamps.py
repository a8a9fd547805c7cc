"""When samples of an unstamped topic left and which were lost, from what the middleware says."""

from __future__ import annotations

from collections.abc import Callable
import time

from nadrc_ros.ros.topics import Info

# A source stamp this far after the receipt is from the future: clocks of one machine agree better.
_FUTURE = 1_000_000
# A source stamp this far back is a jump of its clock, or a publisher on another machine.
_JUMP = 100_000_000
# In slow loops that is so many periods, where stamps are of headers: those of late samples.
_OVERTAKEN = 10
# So is a sample that took less time than it can, by this or by some periods.
_EARLY, _EARLY_PERIODS = 10_000_000, 5
# The clocks of two machines drift apart by no more than that, but when one is being corrected.
_DRIFT = 1e-4
# A first sample may be late: for so long, and so many more, how early it could be here counts too.
_LEARN = 1_000_000_000
# Two clocks are read so often until nothing comes between, or nothing has changed [ns].
_TRIES, _APART = 5, 50_000
# So many samples tell by how much they are late.
_FEW = 20
# More publishers of one topic are not told apart.
_PUBLISHERS = 8


class SampleTimes:
    """
    Gives the time that each sample spans, and counts what is wrong with stamps.

    The source stamp is free of transport jitter and is used where plausible: not where it comes
    from the future, nor where it jumps although the publication numbers go on. A sample whose
    number does not go on is a duplicate or out of order: its span is not positive, and the law
    refuses it. After a backward step of simulated time the span of one sample is 0.

    Two things hold whatever the stamps say. The positive spans add up to the time that passed,
    but for what one sample may be late: observers that were told too little lag for good. And a
    span that is not positive leaves all as it was: an old sample that was repeated must not make
    the next good one span its age.

    Parameters
    ----------
    period
        Nominal period [s].
    stamped
        False where source stamps and the node's clock run apart, as in simulated time.
    wall
        The clock of stamps on this machine [ns].
    numbered
        False where stamps, and not publication numbers, tell which sample is newer: those of
        headers, which several publishers may send.

    Attributes
    ----------
    wall
        The clock of stamps.
    late
        How much later than the one before the last sample came [s]: its age, after a stall.
    spacing
        What the last sample spanned [s], 0 before the second.

    """

    def __init__(
        self,
        period: float,
        stamped: bool = True,
        wall: Callable[[], int] = time.time_ns,
        numbered: bool = True,
    ) -> None:
        self.wall = wall
        self.from_future = 0
        self.clock_jumps = 0
        self.out_of_order = 0
        self.late = self.spacing = 0.0
        self._early = max(_EARLY, int(_EARLY_PERIODS * period * 1e9))
        # From stamp to receipt [ns], with the difference of their clocks: the least so far, and
        # until when it is at least what it is on a machine with our clock.
        self._least_delay = self._bound = self._bound_until = self._learnt = 0
        self._period = period
        self._stamped = stamped
        self._numbered = numbered
        # So far back a sample is not one that was overtaken [ns].
        self._jump = _JUMP if numbered else max(_JUMP, int(_OVERTAKEN * period * 1e9))
        self._seen: int | None = None
        self._last: tuple[int, int, int | None] | None = None

    def counts(self) -> dict[str, int]:
        """Return what /diagnostics has of the stamps."""
        return {
            'stamps_from_future': self.from_future,
            'clock_jumps': self.clock_jumps,
            'measurements_out_of_order': self.out_of_order,
        }

    def saw(self, info: Info, next_info: Info) -> bool:
        """Note a sample that was not used before the next came; tell whether that is newer."""
        self._seen = self._number(info)
        if self._numbered or next_info['source_timestamp'] > info['source_timestamp']:
            return True
        self.out_of_order += 1
        return False

    def span(self, info: Info, now: int) -> float:
        """
        Return the time since the sample before [s]; the nominal period for the first.

        ``now`` is the receipt on the node's own clock [ns].
        """
        self.late = 0.0
        received = info['received_timestamp']
        stamp = info['source_timestamp']
        number = self._number(info)
        if stamp > received + _FUTURE:
            self.from_future += 1
            stamp = received
        seen, self._seen = self._seen, number
        if self._last is None:
            self._last = stamp, now, number
            self._learn_delay(stamp, now)
            return self._period
        source, receipt = stamp - self._last[0], now - self._last[1]
        if not self._stamped:
            source = receipt
        if number is not None and number <= (self._last[2] or 0):
            self.out_of_order += 1
        # Set back: the stamp is older and the number newer. A stamp alone does not tell that from
        # a sample that was overtaken, and a number alone not from a publisher that was restarted.
        goes_on = _follows(number, seen, self._last[2], source < -self._jump)
        backward = source <= 0 if self._stamped else source < 0
        # Set forward: it came sooner after its stamp than any sample can. How much later it came
        # than the one before tells nothing, as a stall makes one late and the next less so: the
        # least delay so far counts, which drifts with the clocks and may itself be of a stall, so
        # that for a while the delay there would be on this machine counts too.
        drift = int(_DRIFT * max(0, receipt))
        least = self._least_delay
        if now < self._bound_until or self._learnt < _FEW:
            least = min(least, self._bound)
        early = least - (now - stamp) > self._early + drift
        if (early and self._stamped) or (goes_on and backward):
            self.clock_jumps += 1
            source = max(0, receipt)
            self._learn_delay(stamp, now)
        elif source <= 0:
            self.out_of_order += not self._numbered
            return float(source) * 1e-9
        self._least_delay = min(self._least_delay + min(drift, self._early // 2), now - stamp)
        self._learnt += 1
        self._last = stamp, now, number
        self.late = max(0.0, (receipt - source) * 1e-9)
        self.spacing = source * 1e-9
        return float(source) * 1e-9

    def _number(self, info: Info) -> int | None:
        number: int | None = info['publication_sequence_number'] if self._numbered else None
        return number

    def _learn_delay(self, stamp: int, now: int) -> None:
        """Begin with the delay of a sample that may be late already."""
        self._least_delay = now - stamp
        self._bound = now - max(stamp, self.wall())
        self._bound_until = now + max(_LEARN, self._early)
        self._learnt = 0


def _follows(number: int | None, seen: int | None, last: int | None, far_back: bool) -> bool:
    """Tell whether a sample is newer than the last used one, whatever its stamp says."""
    if number is None or last is None or seen is None:  # this middleware does not number
        return far_back
    return number > last or (far_back and number == seen + 1)  # or the publisher was restarted


class Offset:
    """
    How far the wall clock is ahead of the steady one, as read where nothing interrupted that.

    It is the same number until the clocks have moved apart, so that samples keep their order.
    Both clocks are in ns.
    """

    def __init__(
        self, wall: Callable[[], int] = time.time_ns, steady: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._wall = wall
        self._steady = steady
        self._ahead = wall() - steady()

    def __call__(self) -> int:
        """Return the offset [ns]."""
        for _ in range(_TRIES):
            before = self._steady()
            ahead = self._wall() - before
            if abs(ahead - self._ahead) <= _APART:
                break
            if self._steady() - before <= _APART:
                self._ahead = ahead
                break
        return self._ahead


class Departures:
    """
    Gives the time at which the samples of one topic left, on the steady clock of this machine.

    A source stamp is of the clock of its publisher. Where that is ours, the sample left as long
    ago as the stamp is old, however late it comes. A clock is not ours if a stamp is from the
    future, if the first one is older than any way here takes, or if it goes back while the
    publication numbers go on: then the least delay so far is taken for none, and is followed as
    clocks drift. A first sample may have lain there: the clock is ours after all if in the second
    after it one comes that tells so. So a step of a clock moves no sample by more than what it is
    late. Without a stamp a sample left when it came.

    ``offset`` tells how far the clock of stamps on this machine is ahead of the steady one [ns];
    ``clock_jumps`` counts how often the clock of the publisher turned out to be another one.
    """

    def __init__(self, offset: Callable[[], int]) -> None:
        self.clock_jumps = 0
        self._offset = offset
        self._behind = 0  # so much the publisher's clock is behind ours [ns]
        self._unsure = False  # of that, as a first sample may have lain there
        self._last: tuple[int, int | None] | None = None
        self._least, self._count, self._since = 0, 0, 0

    def of(self, info: Info, now: int) -> int:
        """Return when a sample left that came ``now`` on the steady clock [ns]."""
        stamp: int = info['source_timestamp']
        number: int | None = info['publication_sequence_number']
        if not stamp:
            return now
        delay = now + self._offset() - stamp - self._behind
        last, self._last = self._last, (stamp, number)
        if last is None:
            another = delay > _JUMP
        else:
            follows = number is None or last[1] is None or number > last[1]
            another = follows and stamp < last[0] - _JUMP
        if another or delay < -_FUTURE:
            behind = self._behind + delay
            ours = self._unsure and -_FUTURE <= behind <= _JUMP
            # By less than a jump it may be one of several samples that lay there.
            self.clock_jumps += not ours and last is not None and (another or delay < -_JUMP)
            self._behind, delay = (0, behind) if ours else (behind, 0)
            self._unsure = last is None or (self._unsure and not ours)
            self._count = 0
        self._follow(delay, now)
        return now - max(delay, 0)

    def _follow(self, delay: int, now: int) -> None:
        """Learn the least delay, of a second and enough samples, where the clock is not ours."""
        if not self._count:
            self._least, self._since = delay, now
        self._count += 1
        self._least = min(self._least, delay)
        if self._count >= _FEW and now - self._since >= _LEARN:
            if self._behind or self._least > _JUMP:
                self._behind += self._least
            self._count, self._unsure = 0, False


class Losses:
    """
    Finds lost samples of a topic, by their publication numbers.

    Every publisher numbers its own, and no sample says whose it is: it is taken to follow the
    highest number that came and is lower. So a publisher that was restarted does not look like a
    loss, and a second one at most once, where its numbers are ahead.
    """

    def __init__(self) -> None:
        self.newest = 0
        self.unknown = False  # this middleware does not number
        self._last: list[int] = []

    def before(self, number: int | None) -> int:
        """Return how many samples were lost right before this one; 0 where that is unknown."""
        if number is None:
            self.unknown = True
            return 0
        self.newest = number
        known = [last for last in self._last if last < number]
        previous = max(known, default=number - 1)
        if known:
            self._last.remove(previous)
        self._last = [*self._last, number][-_PUBLISHERS:]
        return number - previous - 1
