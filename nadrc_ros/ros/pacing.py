"""What makes a node act: a steady timer in real time, or the arrival of samples in lockstep."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
import time
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import choice, flag, integer, number, text
from nadrc_ros.adrc.settings import SLOWEST_RATE
from nadrc_ros.ros.stamps import Losses
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

# Samples that trigger steps are looked after so often [s].
_LONGEST_LOOK = 0.02
# A timer is brought to its phase so soon after the start [s], to that share of the period, in so
# many tries at most.
_ALIGNED_AFTER, TOLERABLE, _ALIGNMENTS = 0.001, 0.02, 10


@attrs.frozen(kw_only=True)
class PacingSettings:
    """Rate and pacing, the same for every node of a loop, and priority; all fixed at start."""

    rate: float = number(
        200.0,
        SLOWEST_RATE,
        5000.0,  # as fast as an executor of rclpy calls anything
        'Hz',
        'periods per second; of a recorder in lockstep only',
        live=False,
    )
    pacing: str = choice(
        'realtime',
        ('realtime', 'lockstep'),
        'realtime: a steady timer; lockstep: one step per sample, the bits of the simulation',
        live=False,
    )
    steps: int = integer(0, 0, 2**31, 'length of a lockstep run, in periods', live=False)
    readers: str = text(
        '',
        'lockstep: readers to wait for before the start, as "topic:node node; topic:node"',
        live=False,
    )
    start_timeout: float = number(
        20.0, 0.1, 3600.0, 's', 'lockstep: longest wait for the expected readers', live=False
    )
    lockstep_timeout: float = number(
        10.0, 4.0, 3600.0, 's', 'lockstep: longest wait for a sample or a slow reader', live=False
    )
    realtime: bool = flag(
        False,
        'real-time priority (SCHED_FIFO) for all threads of the process and locked memory, '
        'where that is permitted',
        live=False,
    )

    def __attrs_post_init__(self) -> None:
        self.expected_readers()

    def check_length(self) -> None:
        """
        Refuse a run in lockstep without a length.

        Raises
        ------
        SettingError
            Names ``steps``.

        """
        if self.lockstep and self.steps == 0:
            raise SettingError('steps', 0, 'the length of the run, above 0, in lockstep')

    @property
    def period(self) -> float:
        """Nominal period [s]."""
        return 1.0 / self.rate

    @property
    def lockstep(self) -> bool:
        """Tell whether samples pace the node."""
        return self.pacing == 'lockstep'

    def expected_readers(self) -> dict[str, list[str]]:
        """
        Return the node names expected to read each topic, from ``readers``.

        Raises
        ------
        SettingError
            When ``readers`` cannot be read.

        """
        readers: dict[str, list[str]] = {}
        for entry in filter(None, (part.strip() for part in self.readers.split(';'))):
            topic, colon, names = entry.partition(':')
            if not colon or not names.split():
                raise SettingError('readers', self.readers, '"topic:node node; topic:node"')
            readers.setdefault(topic.strip(), []).extend(names.split())
        return readers


def steady_timer(node: Node, seconds: float, callback: Callable[[], None]) -> Any:
    """Return a timer on the steady clock, which goes on where simulated time stands still."""
    return node.create_timer(seconds, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


class SharedTimer:
    """
    A fixed-rate timer that calls its listeners in turn: ROS does not keep up with many timers.

    It runs on the steady clock, which no time correction stalls, unless ``use_sim_time`` is set
    and ``steady`` is not. There it fires at ``phase``, a share of the period, after multiples of
    it: plant and reference on one machine send y and r of one instant together, and a controller
    halfway between has both and answers in time, as in the simulation.
    """

    def __init__(
        self, node: Node, rate: float, *, steady: bool = False, phase: float = 0.0
    ) -> None:
        self._simulated = bool(node.get_parameter('use_sim_time').value) and not steady
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.clock = node.get_clock() if self._simulated else clock
        self.listeners: list[Callable[[], None]] = []
        self.rate = rate
        self._period = round(1e9 / rate)
        self._offset = round(phase * self._period)
        self._alignments = 0 if self._simulated else _ALIGNMENTS
        soon = min(1.0 / rate, _ALIGNED_AFTER) if self._alignments else 1.0 / rate
        self.timer = node.create_timer(soon, self._fire, clock=self.clock)

    def now(self) -> int:
        """Return the time on the clock of the timer [ns]."""
        return self.clock.now().nanoseconds if self._simulated else time.monotonic_ns()

    def _fire(self) -> None:
        if self._alignments:
            self._align()
            return
        for listen in self.listeners:
            listen()

    def _align(self) -> None:
        """Bring the timer to its phase, and let it be where that fails time and again."""
        self._alignments -= 1
        now = self.now()
        due = now + (self.timer.time_until_next_call() or 0)
        off = (due - self._offset) % self._period
        if not self._alignments or min(off, self._period - off) < TOLERABLE * self._period:
            self._alignments = 0
            self.timer.timer_period_ns = self._period
            return
        # A timer adds its period to its due time before it calls: the second half ends in phase.
        half = (self._offset - now) % self._period // 2
        self.timer.timer_period_ns = half or self._period
        self.timer.reset()


class Ticker:
    """
    Ticks a node at a fixed rate and counts the periods that were missed.

    Attributes
    ----------
    periods, missed
        How many ticks there were, and for how many periods there was none.

    """

    def __init__(self, timer: SharedTimer, tick: Callable[[float, int], None]) -> None:
        self.now = timer.now
        self.periods = 0
        self.missed = 0
        self._period = 1.0 / timer.rate
        self._tick = tick
        self._last = 0
        self._begin = 0
        timer.listeners.append(self._fire)

    def _fire(self) -> None:
        self._tick(*self._count())

    def _start_from(self, now: int) -> None:
        """Let the next period be one that is not late."""
        self._begin = now - int((self.periods + self.missed) * self._period * 1e9)

    def _count(self) -> tuple[float, int]:
        """
        Count a period; return the time [s] and the periods since the last one.

        It is counted against the clock since the beginning and not against the last tick: one
        that is early by 0.4 periods and the next one late by as much are no missed period.
        """
        now = self.now()
        elapsed = (now - self._last) * 1e-9 if self.periods else self._period
        if elapsed < 0.0 or not self.periods:  # simulated time may go back
            self._start_from(now)
        self._last = now
        self.periods += 1
        counted = round((now - self._begin) * 1e-9 / self._period) + 1
        missed = max(0, counted - self.periods - self.missed)
        self.missed += missed
        return max(elapsed, 0.0), 1 + missed


class SampleTicker(Ticker):
    """
    Counts the samples that come by themselves as periods, and ticks in their place in silence.

    A timer that fired in each period, or was put off by each sample, would wake two threads for
    nothing, which costs as much as the law. So a slow one looks whether samples still come, and
    the fast one runs in silence only.

    A period is missed when a sample was lost, or when this process stood still. Both are told
    twice, by publication numbers that do not go on and by a look that comes late, in either order,
    and must count once: ``periods + missed`` is the time that passed. After a stall of ten periods
    the look comes first and counts ten; the next sample may be one from before it, and only the
    one after that tells by its number of the nine in between. So ``_late`` holds what a look
    counted until the numbers of up to one more look have told of it, and ``_lost`` what numbers
    counted since the last look.
    """

    def __init__(self, node: Node, timer: SharedTimer, tick: Callable[[float, int], None]) -> None:
        super().__init__(timer, tick)
        self._timer = timer.timer
        self._heard = self.now()
        self._due = inf
        self._losses = Losses()
        self._lost = self._late = 0
        self._was_late = False
        self._look_timer = node.create_timer(self._period, self._look, clock=timer.clock)

    def notice_within(self, seconds: float) -> None:
        """Notice silence after so many seconds, and a period; 0 is as late as it ever is."""
        longest = min(_LONGEST_LOOK, seconds - self._period) if seconds else _LONGEST_LOOK
        self._look_timer.timer_period_ns = round(1e9 * max(self._period, longest))

    def skip(self, number: int | None) -> None:
        """Note a message that is no sample, and is not lost."""
        self._losses.before(number)

    def count(self, number: int | None) -> None:
        """Count a period for the sample with this publication number."""
        lost = self._losses.before(number)
        self._lost += lost
        known = min(lost, self._late)
        self._late -= known
        self.missed += lost - known
        self._heard = self._last = self.now()
        self._start_from(self._last)
        self.periods += 1

    @property
    def _silent(self) -> bool:
        return not 0 <= self.now() - self._heard <= 1.5e9 * self._period

    def _look(self) -> None:
        now = self.now()
        late = max(0.0, now - self._due)
        self._due = now + self._look_timer.timer_period_ns
        if not self._timer.is_canceled():  # that one counts
            return
        missed = max(0, int(late * 1e-9 / self._period) - self._lost)
        self.missed += missed
        if missed or not self._was_late:  # the number may come after one more look
            self._late = missed
        self._was_late = missed > 0
        self._lost = 0
        if self._silent:
            self._start_from(now)
            self._timer.reset()
            super()._fire()

    def _fire(self) -> None:
        if not self._silent:
            self._timer.cancel()
            return
        missed = self.missed
        super()._fire()
        self._late += self.missed - missed
