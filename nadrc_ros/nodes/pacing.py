"""What makes a node act: a steady timer in real time, or the arrival of samples in lockstep."""

from __future__ import annotations

from collections.abc import Callable
import time

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import choice, integer, number, text
from rclpy.clock import Clock, ClockType
from rclpy.node import Node


@attrs.frozen(kw_only=True)
class PacingSettings:
    """Rate and pacing, the same for every node of a loop; all fixed at start."""

    rate: float = number(200.0, 1.0, 5000.0, 'Hz', 'periods per second', live=False)
    pacing: str = choice(
        'realtime',
        ('realtime', 'lockstep'),
        'realtime: a steady timer; lockstep: one step per sample, the bits of the simulation',
        live=False,
    )
    steps: int = integer(0, 0, 2**31, 'length of a lockstep run, in periods', live=False)
    readers: str = text(
        '',
        'lockstep: who must read what before the start, as "topic:node node; topic:node"',
        live=False,
    )
    start_timeout: float = number(
        20.0, 0.1, 3600.0, 's', 'lockstep: longest wait for the expected readers', live=False
    )
    lockstep_timeout: float = number(
        10.0, 4.0, 3600.0, 's', 'lockstep: longest wait for a sample or a slow reader', live=False
    )

    def __attrs_post_init__(self) -> None:
        if self.lockstep and self.steps == 0:
            raise SettingError('steps', 0, 'the length of the run, above 0, in lockstep')
        self.expected_readers()

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


class Ticker:
    """
    A fixed-rate timer that counts the periods it missed.

    It runs on the steady clock, which no time correction stalls, unless ``use_sim_time`` is set.

    Attributes
    ----------
    periods, missed
        How many ticks there were, and for how many periods there was none.
    due
        Periods since the last tick: more than 1 where some were missed.

    """

    def __init__(self, node: Node, rate: float, tick: Callable[[float], None]) -> None:
        self.simulated: bool = node.get_parameter('use_sim_time').value
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._clock = node.get_clock() if self.simulated else steady
        self.periods = 0
        self.missed = 0
        self.due = 1
        self._period = 1.0 / rate
        self._tick = tick
        self._last = 0
        self._begin = 0
        self._timer = node.create_timer(self._period, self._fire, clock=self._clock)

    def now(self) -> int:
        """Return the time on the clock of the timer [ns]."""
        return self._clock.now().nanoseconds if self.simulated else time.monotonic_ns()

    def put_off(self) -> None:
        """Take what was just done for the tick of this period: the next is one period away."""
        now, period = self.now(), self._period * 1e9
        if self.periods:
            self.missed += max(0, round((now - self._last) / period) - 1)
        self.periods += 1
        self._last = now
        self._begin = now - int((self.periods + self.missed - 1) * period)
        self._timer.reset()

    def _fire(self) -> None:
        self._tick(self._count())

    def _count(self) -> float:
        """
        Count a period and return the time since the last one [s].

        It is counted against the clock, in which a late tick and an early one are no missed
        period.
        """
        now = self.now()
        elapsed = (now - self._last) * 1e-9 if self.periods else self._period
        if elapsed < 0.0 or not self.periods:  # simulated time may go back
            self._begin = now - int((self.periods + self.missed) * self._period * 1e9)
        self._last = now
        self.periods += 1
        counted = round((now - self._begin) * 1e-9 / self._period) + 1
        missed = max(0, counted - self.periods - self.missed)
        self.missed += missed
        self.due = 1 + missed
        return max(elapsed, 0.0)
