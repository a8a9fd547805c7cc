"""Test vectors: what a loop may meet in its life, with what the controller makes of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import ceil, cos, factorial, inf, nan, pi, sin
import random
from typing import NamedTuple

from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST, LOWEST
from nadrc_ros.export.twin import Twin

INIT, STEP, NO_SAMPLE, ENABLE, DISABLE = range(5)
TICKS = 10_000
# Ticks of ordinary life between two events, and of short events.
_LIFE = (20, 150)
_SHORT = (1, 25)
_NO_NUMBERS = (nan, inf, -inf, 2.0 * HIGHEST, -1e300)


class Call(NamedTuple):
    """
    One call of the C: its arguments, and what there is after it.

    ``u`` is the ``command`` acting of ``INIT``; ``reference`` is empty where none is given.
    """

    action: int
    y: float = 0.0
    reference: tuple[float, ...] = ()
    applied: float = nan
    dt: float = 0.0


class Outcome(NamedTuple):
    """What a call leaves: command, status, mode and cause."""

    command: float
    status: int
    mode: int
    cause: int


def play(twin: Twin, calls: Sequence[Call]) -> list[Outcome]:
    """Return what the controller makes of calls."""
    return [answer(twin, call) for call in calls]


def answer(twin: Twin, call: Call) -> Outcome:
    """Make one call, and tell what there is then."""
    dt = call.dt if call.dt > 0.0 else nan
    match call.action:
        case 0:
            twin.init(call.y, call.applied)
        case 1:
            twin.step(call.y, call.reference or None, call.applied, dt)
        case 2:
            twin.no_sample(dt)
        case _:
            twin.enable(call.action == ENABLE)
    controller = twin.controller
    return Outcome(
        float(controller.command),
        controller.status.value,
        controller.mode.value,
        controller.cause.value,
    )


def life(
    settings: ControllerSettings,
    period: float,
    measured: bool = False,
    ticks: int = TICKS,
    twin: Twin | None = None,
) -> tuple[list[Call], list[Outcome]]:
    """
    Return calls of a loop around a chain of integrators, and what comes of each.

    ``twin`` is the controller, by default that of the settings.
    """
    loop = _Loop(settings, period, measured, twin or Twin(settings, period))
    while len(loop.calls) < ticks:
        loop.go_on()
    return loop.calls[:ticks], loop.outcomes[:ticks]


class _Loop:
    """A plant that the controller controls, and all that may happen to the two."""

    def __init__(
        self, settings: ControllerSettings, period: float, measured: bool, twin: Twin
    ) -> None:
        self.calls: list[Call] = []
        self.outcomes: list[Outcome] = []
        self._settings, self._period, self._measured = settings, period, measured
        self._twin = twin
        self._random = random.Random(1)
        n, wc = settings.plant_order, settings.controller_bandwidth
        self._command = settings.safe_command
        self._time = 0.0
        # What a command of half the range holds against the feedback, where that can be measured.
        reach = 0.5 * (settings.command_max - settings.command_min) * abs(settings.b0) / wc**n
        low = max(settings.measurement_min, settings.reference_min, LOWEST)
        high = min(settings.measurement_max, settings.reference_max, HIGHEST)
        self._middle = 0.0 if low <= 0.0 <= high else 0.5 * low + 0.5 * high
        self._plant = [self._middle, *[0.0] * (n - 1)]
        self._size = min(reach, 0.4 * (high - low)) or 1.0
        self._pace = 0.3 * wc
        self._events = self._schedule()
        self._call(Call(INIT, nan, (), settings.safe_command))

    def go_on(self) -> None:
        """Live for a while, then let something happen."""
        if abs(self._plant[0] - self._middle) > 2.0 * self._size:  # another trial
            self._plant = [self._middle, *[0.0] * (len(self._plant) - 1)]
        for _ in range(self._random.randint(*_LIFE)):
            self._tick()
        next(self._events)

    def _schedule(self) -> Iterator[None]:
        """Let everything happen once, and then anything, for ever."""
        events = (
            *(self._bad_samples, self._few_missing, self._silence, self._no_reference),
            *(
                self._bad_reference,
                self._too_far,
                self._reported,
                self._disabled,
                self._begun_anew,
            ),
            *(self._long_gap, self._bad_derivatives),
        )
        order = list(events)
        while True:
            for event in order:
                event()
                yield
            order = self._random.choices(events, k=len(events))

    def _short(self) -> range:
        return range(self._random.randint(*_SHORT))

    def _bad_samples(self) -> None:
        outside = _outside(self._settings.measurement_min, self._settings.measurement_max)
        for _ in self._short():
            self._tick(y=self._random.choice([*_NO_NUMBERS, *outside]))

    def _few_missing(self) -> None:
        for _ in self._short():
            self._tick(missing=True)

    def _silence(self) -> None:
        for _ in range(self._periods(self._settings.measurement_timeout) + 5):
            self._tick(missing=self._random.random() < 0.7, y=nan)
        for _ in range(self._periods(self._settings.hold_time) + 50):
            self._tick(missing=True)

    def _long_gap(self) -> None:
        for _ in range(self._periods(self._settings.max_dt) + self._random.choice((-2, -1, 0, 1))):
            self._tick(missing=True)

    def _no_reference(self) -> None:
        longest = max(self._settings.reference_timeout, self._settings.max_dt)
        for _ in range(self._periods(longest) + self._random.randint(0, 60)):
            self._tick(reference=())

    def _bad_reference(self) -> None:
        outside = _outside(self._settings.reference_min, self._settings.reference_max)
        for _ in self._short():
            self._tick(reference=(self._random.choice([*_NO_NUMBERS, *outside]), 1.0, 1.0))

    def _bad_derivatives(self) -> None:
        for _ in range(self._random.choice((5, self._periods(self._settings.max_dt) + 5))):
            r = self._reference()
            bad = self._random.choice(_NO_NUMBERS)
            self._tick(reference=(r[0], bad, *r[2:]))

    def _too_far(self) -> None:
        """Ask for more than the limits give."""
        far = self._middle + self._random.choice((-1.0, 1.0)) * 20.0 * self._size
        for _ in range(self._random.randint(*_LIFE)):
            self._tick(reference=(far, 0.0, 0.0))

    def _reported(self) -> None:
        for _ in range(self._random.randint(*_LIFE)):
            half = 0.5 * self._command
            self._tick(applied=self._random.choice((half, half, half, nan, inf, 1e16)))

    def _disabled(self) -> None:
        self._call(Call(DISABLE))
        for _ in self._short():
            self._tick()
        self._call(Call(ENABLE))

    def _begun_anew(self) -> None:
        y = self._random.choice((nan, self._plant[0]))
        self._call(Call(INIT, y, (), self._random.choice((self._command, nan, 1e6))))

    def _periods(self, time: float) -> int:
        return min(ceil(time / self._period), 2000)

    def _reference(self) -> tuple[float, float, float]:
        """Return a sine that now and then jumps."""
        w, t = self._pace, self._time
        jump = self._size * (0.5 if int(t * w / (4.0 * pi)) % 2 else -0.5)
        a = 0.5 * self._size
        return (
            self._middle + jump + a * sin(w * t),
            a * w * cos(w * t),
            -a * w * w * sin(w * t),
        )

    def _tick(
        self,
        missing: bool = False,
        y: float | None = None,
        reference: tuple[float, ...] | None = None,
        applied: float = nan,
    ) -> None:
        h = self._period
        if self._measured:
            h *= self._random.choice((0.5, 1.0, 1.0, 1.0, self._random.uniform(0.2, 3.0)))
        settings = self._settings
        if missing:
            self._call(Call(NO_SAMPLE, dt=h if self._measured else 0.0))
        else:
            noisy = self._plant[0] + self._random.gauss(0.0, 1e-3 * self._size)
            given = self._reference() if reference is None else reference
            self._call(
                Call(
                    STEP,
                    noisy if y is None else y,
                    given[: 1 + settings.received_derivatives],
                    applied,
                    h if self._measured else 0.0,
                )
            )
        n, x = settings.plant_order, self._plant
        load = 0.3 * self._size * self._settings.controller_bandwidth**n * sin(self._time)
        push = settings.b0 * self._command + load
        chain = [*x, push]
        self._plant = [
            sum(chain[j] * h ** (j - i) / factorial(j - i) for j in range(i, n + 1))
            for i in range(n)
        ]
        self._time += h

    def _call(self, call: Call) -> None:
        self.calls.append(call)
        self.outcomes.append(answer(self._twin, call))
        self._command = float(self._twin.controller.command)


def _outside(low: float, high: float) -> list[float]:
    """Return numbers that are outside in single precision, too."""
    return [low - 1.0 - 1e-3 * abs(low), high + 1.0 + 1e-3 * abs(high)]
