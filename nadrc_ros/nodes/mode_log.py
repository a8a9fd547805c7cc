"""What the log says of the fault policy: every change, unless there are too many, and the last."""

from __future__ import annotations

from collections import deque
from math import inf
import time

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.nodes.cascades import waits_at_start
from nadrc_ros.records.states import describe
from nadrc_ros.ros.diagnostics import ERROR, Events, OK, Remarks, WARN

# As many changes are logged in so many seconds: a sensor that flaps must not fill a disk.
COUNT, SECONDS = 30, 60.0
# How bad it is that the law does not act, by the cause.
LEVELS = {
    Cause.NONE: OK,
    Cause.START: WARN,
    Cause.DISABLED: WARN,
    Cause.NOT_FOLLOWED: WARN,
    Cause.REFERENCE_TIMEOUT: ERROR,
    Cause.STALLED: ERROR,
    Cause.MEASUREMENT_TIMEOUT: ERROR,
}


class ModeLog:
    """
    Decides which changes of mode and cause are logged.

    At most ``COUNT`` in any ``SECONDS`` are. The last one always is, if late: a log must not end
    with "in control" when the controller is not. ``now`` is what was seen last, at first what
    needs no mention.
    """

    def __init__(self, mode: Mode, cause: Cause) -> None:
        self.now = mode, cause
        self._told = describe(mode, cause)
        self._unlogged = 0
        self._times: deque[float] = deque([-inf] * COUNT, maxlen=COUNT)

    def look(self, controller: Controller, events: Events, remarks: Remarks, silent: bool) -> bool:
        """Tell what changed, and log it if it is to be logged; return whether it was."""
        mode, cause = controller.mode, controller.cause
        if waits_at_start(controller):
            return False
        if (mode, cause) != self.now:
            events.tell('mode', describe(mode, cause, silent), LEVELS[cause])
        message = self.of(mode, cause, time.monotonic(), silent)
        if message:
            remarks.log(message, OK if mode == Mode.OK else WARN)
        return bool(message)

    def of(self, mode: Mode, cause: Cause, time: float, silent: bool = False) -> str:
        """Return what to log at ``time`` [s], nothing unless it is news and may be logged yet."""
        if (mode, cause) != self.now:
            self.now = mode, cause
            self._unlogged += 1
        text = describe(mode, cause, silent)
        if text == self._told or time - self._times[0] < SECONDS:
            return ''
        self._times.append(time)
        self._told, passed_over, self._unlogged = text, self._unlogged - 1, 0
        more = f' (after {passed_over} changes that were not logged)' if passed_over > 0 else ''
        return text + more


def state(controller: Controller, silent: bool) -> tuple[bytes, str]:
    """Return for /diagnostics how bad the state of a controller is, and what it is."""
    level, message = LEVELS[controller.cause], describe(controller.mode, controller.cause, silent)
    if controller.restarted:
        return WARN, f'{message}; the last sample only restarted the observers'
    return level, message


def jump(settings: ControllerSettings, applied: float, command: float, allowed: float) -> str:
    """Return that a narrowed range was entered at once, which ranks above the rate limit."""
    outside = not settings.command_min <= applied <= settings.command_max
    if not (outside and 0.0 < allowed < abs(command - applied)):
        return ''
    return (
        f'the command jumps from {applied:g} to {command:g}: the range from '
        f'{settings.command_min:g} to {settings.command_max:g} is entered at once'
    )


def cut_short(settings: ControllerSettings, last: float, allowed: float) -> str:
    """Return that the safe command is sent before the rate limit allows it."""
    safe = settings.safe_command
    if not 0.0 < allowed < abs(safe - last):
        return ''
    return f'the ramp to the safe command is cut short at {last:g}: {safe:g} is sent at once'
