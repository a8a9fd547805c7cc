"""
Faults on purpose: what goes wrong between plant and controller, from a time on and for a while.

Each period the sample of the plant passes through the measurement faults in their order, and comes
out changed, late, twice or not at all. The command passes through the command faults and comes out
as what the actuator does. While it does not act, a fault remembers nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import ceil, copysign, expm1, inf, isfinite, nan
from typing import Any, Generic, NamedTuple, TypeVar

import attrs
from nadrc_ros.adrc.fields import choice, number
from nadrc_ros.adrc.settings import FASTEST, HIGHEST, LONGEST, LOWEST
import numpy as np

_NEVER = 2**62
# A reordered sample comes when so many newer ones are there.
_OVERTAKEN = 2
F = TypeVar('F', 'MeasurementFault', 'CommandFault')


def first_period(time: float, rate: float) -> int:
    """Return the first k with k / rate at or after ``time`` [s]."""
    # Not the product alone: 0.07 * 100 is above 7 by rounding, and yet 7 / 100 is at 0.07.
    k = max(ceil(time * rate) - 2, 0)
    while k / rate < time:
        k += 1
    return k


class SentSample(NamedTuple):
    """
    A measurement on its way.

    ``number`` is the period it was taken in, ``stamp`` that it was sent in, by the sender's clock.
    """

    value: float
    stamp: float
    number: int


class Acting(Generic[F]):
    """A fault in one run: its settings, its random numbers, and what it remembers."""

    def __init__(self, fault: F, rate: float, origin: int, seed: tuple[int, int]) -> None:
        self.fault: F = fault
        self.rate = rate
        self.begin = origin + first_period(fault.start, rate)
        self.end = _NEVER
        if fault.duration > 0.0:
            self.end = self.begin + first_period(fault.duration, rate)
        self.k = 0
        self.held: float | None = None
        self.late: deque[tuple[int, SentSample]] = deque()
        self._generator = np.random.Generator(np.random.PCG64(seed))

    def acts(self, k: int) -> bool:
        """Tell whether it acts in period ``k``, and forget everything if it does not."""
        self.k = k
        acts = self.acts_in(k)
        if not acts:
            self.held = None
            self.late.clear()
        return acts

    def acts_in(self, k: int) -> bool:
        """Tell whether it acts in period ``k``."""
        return self.begin <= k < self.end

    def hold(self, value: float) -> float:
        """Return the first value since it began."""
        if self.held is None:
            self.held = value
        return self.held

    def uniform(self) -> float:
        """Return a random number from 0 to 1."""
        return float(self._generator.random())

    def arrived(self) -> list[SentSample]:
        """Return the samples that were kept back until now."""
        arrived = []
        while self.late and self.late[0][0] <= self.k:
            arrived.append(self.late.popleft()[1])
        return arrived


# What becomes of one sample, of its value alone, of one command.
Deliver = Callable[[Acting['MeasurementFault'], SentSample], list[SentSample]]
Spoil = Callable[[Acting['MeasurementFault'], float], float]
Act = Callable[[Acting['CommandFault'], float], float]


def _sent_late(
    acting: Acting[MeasurementFault], sample: SentSample, periods: int
) -> list[SentSample]:
    """Keep a sample back before it is sent and stamped, as a slow sensor does."""
    acting.late.append((acting.k + periods, sample._replace(stamp=sample.stamp + periods)))
    return []


def _slow(acting: Acting[MeasurementFault], value: float) -> float:
    if not isfinite(value):
        return value
    before = acting.hold(value)
    acting.held = before - (value - before) * expm1(-1.0 / (acting.rate * acting.fault.time))
    return acting.held


def _quantised(acting: Acting[MeasurementFault], value: float) -> float:
    steps = value / acting.fault.size
    return acting.fault.size * round(steps) if isfinite(steps) else value


def _rate_limited(acting: Acting[CommandFault], command: float) -> float:
    before, change = acting.hold(command), abs(acting.fault.size) / acting.rate
    if abs(command - before) > change:
        command = before + copysign(change, command - before)
    acting.held = command
    return command


_DELIVERIES: dict[str, Deliver] = {
    'silent': lambda acting, sample: [],
    'intermittent': lambda acting, sample: [],
    'delayed': lambda acting, sample: _sent_late(
        acting, sample, first_period(acting.fault.time, acting.rate)
    ),
    'duplicated': lambda acting, sample: [sample, sample],
    'reordered': lambda acting, sample: _sent_late(acting, sample, _OVERTAKEN),
    'clock_jump': lambda acting, sample: [
        sample._replace(stamp=sample.stamp + acting.fault.time * acting.rate)
    ],
}
# With these each period has its one sample.
_SPOILT: dict[str, Spoil] = {
    'stuck': Acting.hold,
    'garbage': lambda acting, y: acting.fault.size * (2.0 * acting.uniform() - 1.0),
    'bias': lambda acting, y: y + acting.fault.size,
    'slow': _slow,
    'not_a_number': lambda acting, y: nan,
    'infinite': lambda acting, y: copysign(inf, acting.fault.size),
    'spike': lambda acting, y: y + copysign(acting.fault.size, acting.uniform() - 0.5),
    'quantised': _quantised,
}
MEASUREMENT_KINDS = (*_DELIVERIES, *_SPOILT)
ONE_EACH = ('none', *_SPOILT)
# With these no valid measurement arrives.
_BLINDING = ('silent', 'not_a_number', 'infinite')
_LATE = ('delayed', 'reordered')
COMMAND_KINDS: dict[str, Act] = {
    'stuck': Acting.hold,
    'reversed': lambda acting, u: -u,
    'limited': lambda acting, u: max(-abs(acting.fault.size), min(abs(acting.fault.size), u)),
    'rate_limited': _rate_limited,
    'gain': lambda acting, u: acting.fault.size * u,
}


@attrs.frozen(kw_only=True)
class Fault:
    """When a fault acts, and how much."""

    size: float = number(
        1.0, LOWEST, HIGHEST, '', 'how much, in the unit that its kind asks for', nonzero=True
    )
    start: float = number(
        0.0, 0.0, LONGEST, 's', 'when it begins, from the start of the run or its last change on'
    )
    duration: float = number(0.0, 0.0, LONGEST, 's', 'how long it acts; 0 = to the end')


@attrs.frozen(kw_only=True)
class MeasurementFault(Fault):
    """
    What happens to measurements.

    ``silent``: none arrives; ``intermittent``: those that are hit are lost; ``stuck``: the first
    is repeated; ``garbage``: a random number within +-size; ``bias``: size is added; ``slow``: a
    first-order lag of ``time``; ``not_a_number``; ``infinite``; ``spike``: +-size is added;
    ``quantised`` in steps of size; ``delayed``: sent ``time`` late; ``duplicated``: comes twice;
    ``reordered``: those that are hit are sent two periods late, after newer ones; ``clock_jump``:
    the clock that stamps them is ``time`` ahead.
    """

    kind: str = choice('none', ('none', *MEASUREMENT_KINDS), 'fault of the measurement')
    time: float = number(0.1, 1.0 / FASTEST, LONGEST, 's', 'delay, lag, or jump of the clock')
    probability: float = number(
        1.0,
        0.0,
        1.0,
        '',
        'share of the samples that are hit; below 1 for intermittent and reordered, or all are',
    )


@attrs.frozen(kw_only=True)
class CommandFault(Fault):
    """
    What the actuator makes of commands.

    ``stuck`` at the first one; ``reversed``; ``limited`` to +-size; ``rate_limited`` to size per
    second; ``gain``: size times the command, as if b0 were wrong by that factor.
    """

    kind: str = choice('none', ('none', *COMMAND_KINDS), 'fault of the actuator')


@attrs.frozen(kw_only=True)
class Faults:
    """All faults of a run, in the order in which they act on a sample or a command."""

    measurement: tuple[MeasurementFault, ...] = ()
    command: tuple[CommandFault, ...] = ()

    @property
    def blind(self) -> bool:
        """Tell whether no valid measurement arrives at the start."""
        return any(
            fault.kind in _BLINDING and fault.start == 0.0 and fault.probability == 1.0
            for fault in self.measurement
        )

    def delay(self, rate: float) -> float:
        """Return the dead time [s] of every measurement from start to end: whole periods."""
        return sum(
            first_period(fault.time, rate) / rate
            for fault in self.measurement
            if fault.kind == 'delayed'
            and (fault.start, fault.duration, fault.probability) == (0.0, 0.0, 1.0)
        )


class Injector:
    """The faults of one run of ``rate`` periods per second; the same seed gives the same bits."""

    def __init__(self, faults: Faults, rate: float, seed: int) -> None:
        self._rate = rate
        self._seed = seed
        self._measurement: dict[int, Acting[MeasurementFault]] = {}
        self._command: dict[int, Acting[CommandFault]] = {}
        self.change(faults, 0)

    def change(self, faults: Faults, k: int) -> None:
        """Go on with these from period ``k`` on; those that stay as they were go on as they do."""
        self._measurement = self._changed(self._measurement, faults.measurement, k)
        self._command = self._changed(self._command, faults.command, k)

    def _changed(
        self, before: dict[int, Acting[F]], faults: tuple[F, ...], k: int
    ) -> dict[int, Acting[F]]:
        after = {}
        for i, fault in enumerate(faults):
            if i in before and before[i].fault == fault:
                after[i] = before[i]
            elif fault.kind != 'none':
                after[i] = Acting(fault, self._rate, k, (self._seed, i))
        return after

    def deliver(self, k: int, value: float, *, still: bool = False) -> list[SentSample]:
        """
        Return the samples that arrive in period ``k``, in which ``value`` is measured.

        While time stands ``still``, as before the first command of a loop on the graph, none is
        late: it would never come, the controller would wait for it, and the loop would not begin.
        """
        samples = [SentSample(value, float(k), k)]
        for acting in self._measurement.values():
            if acting.acts(k) and not (still and acting.fault.kind in _LATE):
                samples = _pass_on(acting, samples)
        return samples

    def act(self, k: int, command: float) -> float:
        """Return what the actuator does in period ``k``; to be called once in each."""
        for acting in self._command.values():
            if acting.acts(k):
                command = COMMAND_KINDS[acting.fault.kind](acting, command)
        return command

    @property
    def _all(self) -> list[tuple[str, Acting[Any]]]:
        found: list[tuple[str, Acting[Any]]] = []
        found += (('measurement', acting) for acting in self._measurement.values())
        found += (('command', acting) for acting in self._command.values())
        return found

    def acting(self, k: int) -> list[str]:
        """Return where the faults are that act in period ``k``, and of what kind."""
        return [f'{where} {each.fault.kind}' for where, each in self._all if each.acts_in(k)]

    def acts(self, k: int) -> bool:
        """Tell whether any fault acts in period ``k``."""
        return any(each.acts_in(k) for _, each in self._all)

    def next_begin(self, k: int) -> int:
        """Return the first period from ``k`` on in which a fault begins."""
        return min((each.begin for _, each in self._all if each.begin >= k), default=_NEVER)


def _pass_on(acting: Acting[MeasurementFault], samples: list[SentSample]) -> list[SentSample]:
    fault, passed = acting.fault, []
    for sample in samples:
        hit = fault.probability == 1.0 or acting.uniform() < fault.probability
        if hit and fault.kind in _SPOILT:
            passed.append(sample._replace(value=_SPOILT[fault.kind](acting, sample.value)))
        else:
            passed += _DELIVERIES[fault.kind](acting, sample) if hit else [sample]
    return passed + acting.arrived()
