"""
An experiment as the controller node runs it, tick by tick: bounded, whatever the machine does.

It begins with some samples at the resting command, which say where the output is. A bound that can
just be kept ends it: the motion is braked, then the resting command is sent. What the command is
after that is for the caller, who ramps to the safe one.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from math import isfinite, nan

import attrs
from nadrc_ros.adrc.commission.guard import Guard
from nadrc_ros.adrc.commission.patterns import Doublets, Pattern, Silence, Staircase
from nadrc_ros.adrc.commission.settings import ExperimentSettings, WITH_CONTROLLER
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings

# So many samples in a row outside the band are worse than predicted: noise alone hardly does that.
_WORSE = 3
# So long it holds the machine before it steps, of the length of a step; it may take so long.
_HELD, _PATIENCE = 0.15, 2.0
# In so many segments a controller brings the machine back to where its travel counts from.
_BACK = 10.0
# A tick that comes after so many periods is late.
_ON_TIME = 1.5
# A brake ends after so many times what drove the motion, beside the dead time.
_BRAKES = 3.0
# It is more firm where the speed has not fallen to that part meanwhile.
_SLOWER = 0.9
# How firmly it brakes: fully from that part of the largest speed on.
_FIRM = 2.0
_PATTERNS: dict[str, Callable[[ExperimentSettings], Pattern]] = {
    'staircase': Staircase,
    'silence': Silence,
}


class Outcome(Enum):
    """How an experiment ended."""

    DONE = 'done'
    STILL = 'still'
    BOUND = 'bound'
    LOST = 'lost'
    WORSE = 'worse'
    STOPPED = 'stopped'


class Experiment:
    """
    One experiment on a machine.

    Parameters
    ----------
    settings
        What is sent, and its bounds.
    controller
        The controller of kinds ``closed`` and ``step``; its limits of the command become those of
        the experiment.

    Attributes
    ----------
    over, outcome
        Why it ended, in words, and as what; None while it runs.
    command, excitation
        The last command, and what was added to it on purpose; of kind ``step`` by how much the
        reference is away from the start.

    Raises
    ------
    SettingError
        Where a controller is missing or is none of this kind.

    """

    def __init__(
        self, settings: ExperimentSettings, controller: ControllerSettings | None = None
    ) -> None:
        if (settings.kind in WITH_CONTROLLER) != (controller is not None):
            allowed = 'closed or step with a controller, one of the others without'
            raise SettingError('kind', settings.kind, allowed)
        self.settings = settings
        self.over: str | None = None
        self.outcome: Outcome | None = None
        self.command = settings.center
        self.excitation = 0.0
        self.guard = Guard(settings)
        self._pattern = _PATTERNS.get(settings.kind, Doublets)(settings)
        self._controller = self._made(controller) if controller is not None else None
        self._time = self._stepped = self._near = self._late = 0.0
        self._largest = 0.0
        self._outside = 0
        self._held = False
        self._brake: _Brake | None = None

    @property
    def stage(self) -> str:
        """Say in a word what it does."""
        if self.over is not None:
            return 'over'
        if self.guard.start is None:
            return 'start'
        if self._brake is not None:
            return 'brake'
        return 'step' if self.settings.kind == 'step' else self._pattern.stage

    @property
    def silent(self) -> bool:
        """Tell whether the command is not to be sent."""
        return self.stage == 'silent'

    def tick(self, measurement: float, dt: float, elapsed: float) -> float:
        """
        Advance by one tick and return the command to send.

        Parameters
        ----------
        measurement
            y, or nan when none came since the last tick.
        dt
            Time since the previous sample [s]; 0 when none came.
        elapsed
            Time since the last tick [s].

        """
        settings, guard = self.settings, self.guard
        if self.over is not None:
            return self._send(settings.center, elapsed)
        if not 0.0 < elapsed < settings.longest:
            elapsed = settings.period
        self._time += elapsed
        used = guard.take(measurement, dt, elapsed)
        if guard.silence > settings.measurement_timeout:
            self._finish(Outcome.LOST, f'no valid measurement for {guard.silence:.3g} s')
        elif self._time > settings.longest:
            what = Outcome.STILL if self._pattern.still else Outcome.DONE
            self._stop(what, f'it took its {settings.longest:g} s')
        if self.over is not None or guard.start is None:
            return self._send(settings.center, elapsed)
        if self._brake is None and (
            complaint := guard.complaint(self._delay) or self._pattern.complaint
        ):
            # what is too fast is let go first: friction may brake it, and would add to a brake
            late = self._delay + guard.late
            self._stop(Outcome.BOUND, complaint, late if complaint.startswith('speed') else 0.0)
        if self._brake is not None:
            self.excitation = self._brake.advance(guard, elapsed)
            if self._brake.finished:
                self.over = self._brake.reason
                self.excitation = 0.0
            return self._send(settings.center + self.excitation, elapsed)
        if settings.kind == 'step':
            return self._step(measurement if used else None, dt, elapsed)
        self.excitation = self._pattern.advance(guard, elapsed)
        self._largest = max(self._largest, abs(self.excitation))
        if self._pattern.finished:
            what = Outcome.STILL if self._pattern.still else Outcome.DONE
            self._stop(what, 'it did all it was to do')
            self.excitation = 0.0
        if self._controller is None:
            return self._send(settings.center + self.excitation, elapsed)
        # on its way it goes back to where travel counts from
        back = min(self._time / (_BACK * settings.segment), 1.0)
        reference = guard.start - back * guard.away
        return self._controlled(measurement if used else None, dt, elapsed, reference)

    def end(self, reason: str, brake: bool = False) -> None:
        """End it from outside, at once, or after its motion is braked."""
        if self.over is None:
            (self._stop if brake else self._finish)(Outcome.STOPPED, reason)

    @property
    def _delay(self) -> float:
        return max(self.settings.delay, self._pattern.late)

    @property
    def _pushed(self) -> float:
        return 0.0 if self._controller is not None else self._pattern.pushed

    def _made(self, controller: ControllerSettings) -> Controller:
        settings = self.settings
        return Controller(
            attrs.evolve(
                controller,
                command_min=settings.lowest,
                command_max=settings.highest,
                safe_command=settings.center,
                command_rate_limit=settings.command_rate_limit,
                measurement_period=settings.measurement_period,
                measurement_timeout=settings.measurement_timeout,
                reference_timeout=0.0,
                stall_time=0.0,
                applied_timeout=0.0,
                feed_forward_timeout=0.0,
                error_deadband=0.0,
            ),
            checked=True,
        )

    def _controlled(
        self, measurement: float | None, dt: float, elapsed: float, reference: float
    ) -> float:
        assert self._controller is not None
        command = self._controller.tick(
            nan if measurement is None else measurement,
            0.0 if measurement is None else dt,
            elapsed=elapsed,
            reference=[reference, 0.0, 0.0],
            feed_forward=self.excitation if self.settings.kind == 'closed' else None,
        )
        return self._send(command, elapsed)

    def _step(self, measurement: float | None, dt: float, elapsed: float) -> float:
        """Take over at rest, step, hold, step back, and compare."""
        settings, guard = self.settings, self.guard
        assert guard.start is not None
        length = len(settings.predicted) * settings.period
        # it finds out first what holds the machine, until that stays where it is
        if not self._held:
            self._stepped += elapsed
            near = abs(guard.raw) <= settings.band[0]
            self._near = self._near + elapsed if near else 0.0
            if self._near >= _HELD * length:
                self._held, self._stepped = True, 0.0
            elif self._stepped > _PATIENCE * length:
                said = f'it does not hold the machine, which is at {guard.raw:+.4g}'
                self._stop(Outcome.WORSE, said)
                return self._send(settings.center, elapsed)
            return self._controlled(measurement, dt, elapsed, guard.start)
        at = self._stepped
        self._stepped += elapsed
        self._late += max(elapsed - _ON_TIME * settings.period, 0.0)
        self.excitation = settings.reference_step if at < 0.5 * length else 0.0
        if measurement is not None:
            last = len(settings.predicted) - 1
            k = min(int(at / settings.period + 0.5), last)
            # what came late is compared with what was expected meanwhile, too
            while_late = settings.predicted[max(k - int(self._late / settings.period), 0) : k + 1]
            expected, band = settings.predicted[k], settings.band[k]
            away = not min(while_late) - band <= guard.raw <= max(while_late) + band
            self._outside = self._outside + 1 if away else 0
            if self._outside >= _WORSE:
                self.excitation = 0.0
                said = f'the output is at {guard.raw:+.4g}, and {expected:+.4g} was expected'
                self._stop(Outcome.WORSE, f'{said} within {band:.3g}')
                return self._send(settings.center, elapsed)
        if at >= length:
            self._finish(Outcome.DONE, 'the step went as it was predicted')
        return self._controlled(measurement, dt, elapsed, guard.start + self.excitation)

    def _stop(self, outcome: Outcome, reason: str, wait: float = 0.0) -> None:
        """End as soon as the motion is braked, what still moves after ``wait`` [s]."""
        settings = self.settings
        if self._brake is None:
            self.outcome = outcome
            sign = settings.sign or self._pattern.sign
            size = self._largest or settings.amplitude or settings.max_command
            driven = self.excitation, self._pushed
            sure = settings.sign != 0 or self._pattern.sure
            self._brake = _Brake(self.guard, sign, sure, size, driven, self._delay, wait, reason)

    def _finish(self, outcome: Outcome, reason: str) -> None:
        self.outcome, self.over, self.excitation = outcome, reason, 0.0

    def _send(self, command: float, elapsed: float) -> float:
        """Send the nearest command that the limits allow."""
        settings = self.settings
        if not isfinite(command):
            command = settings.center
        if settings.command_rate_limit > 0.0:
            change = settings.command_rate_limit * elapsed
            command = max(self.command - change, min(self.command + change, command))
        self.command = max(settings.lowest, min(settings.highest, command))
        return self.command


class _Brake:
    """
    The opposite of what drove the motion, in proportion to the speed; half after each turn.

    Without a known sign of b0 what drove is all that is known: its opposite. Where the sign is not
    sure, the brake ends if the motion grows all the same.
    """

    def __init__(
        self,
        guard: Guard,
        sign: int,
        sure: bool,
        size: float,
        driven: tuple[float, float],
        delay: float,
        wait: float,
        reason: str,
    ) -> None:
        excitation, pushed = driven
        self._sure = sure
        self._turns = 0
        self._size, self._delay, self._wait = size, delay, wait
        self._way = 1.0 if guard.velocity > 0.0 else -1.0
        self._sign = sign or (1 if excitation * self._way > 0.0 else -1)
        self._longest = wait + _BRAKES * (pushed + delay + 2.0 * guard.late)
        self.reason = reason
        self.finished = False
        self._spent = self._quiet = 0.0
        self._patience = self._since = delay + 2.0 * guard.late
        self._speed = abs(guard.velocity)

    def advance(self, guard: Guard, elapsed: float) -> float:
        """Return what is added to the resting command until the next tick."""
        self._spent += elapsed
        slow = abs(guard.velocity) <= guard.still
        self._quiet = self._quiet + elapsed if slow else 0.0
        turned = guard.velocity * self._way < 0.0 and not slow
        if self._spent > self._longest or (slow and self._quiet > self._delay):
            self.finished = True
            return 0.0
        if turned:
            self._way, self._size = -self._way, 0.5 * self._size
            self._turns += 1
        if slow or self._spent <= self._wait:
            return 0.0
        self._since -= elapsed
        if self._since <= 0.0:
            speed = abs(guard.velocity)
            if self._sure and speed > _SLOWER * self._speed and self._turns == 0:
                self._size *= 2.0  # what drives it now is more than what drove it
            elif not self._sure and speed > self._speed / _SLOWER:
                self.finished = True  # it is no brake, or far too weak: nobody knows
                return 0.0
            self._since, self._speed = self._patience, speed
        # a chain of two integrators slows down in the time in which it was driven
        share = _FIRM * guard.velocity / guard.fastest
        return -self._sign * self._size * max(-1.0, min(1.0, share))
