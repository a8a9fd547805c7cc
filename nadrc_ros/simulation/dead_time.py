"""Commands on their way to a simulated plant, a period each: exact, also for parts of a period."""

from __future__ import annotations

from typing import Any

from nadrc_ros.adrc.errors import SettingError

# Of a period: less than that is a whole one, but for rounding.
_ROUNDING = 1e-9
_MOST_PERIODS = 1_000_000


class DeadTime:
    """
    The dead time at the input of a plant that is simulated at t_k = k / ``rate``.

    A command that is sent at t_k acts from t_k + ``delay`` [s] on, for one period; before the
    first one ``before`` acts.

    Attributes
    ----------
    delay, before
        As given.
    whole, rest
        The delay as whole periods and what is left of it [s].
    sent
        Two rings, of commands and of what the actuator makes of them: of period k at k modulo
        their length, which is 0 without a delay.

    Raises
    ------
    SettingError
        For a delay of more than a million periods.

    """

    def __init__(self, delay: float, rate: float, before: float) -> None:
        self.delay, self.before = delay, before
        periods = delay * rate
        if periods > _MOST_PERIODS:
            allowed = f'at most {_MOST_PERIODS / rate:g} s, a million periods'
            raise SettingError('input_delay', delay, allowed)
        self.whole = int(periods + _ROUNDING)
        part = periods - self.whole
        self.rest = part / rate if part > _ROUNDING else 0.0
        size = self.whole + 2 if delay > 0.0 else 0
        self.sent = [[before] * size for _ in range(2)]


def reach(
    sent: Any, whole: int, rest: float, k: int, command: float, acting: float
) -> tuple[float, float, float]:
    """
    Send a command in period ``k``; return the one that reaches the plant at its begin.

    The same of what the actuator makes of commands, ``acting``; and that from ``rest`` [s] on.
    """
    size = len(sent[0])
    sent[0][k % size] = command
    sent[1][k % size] = acting
    later = k - whole
    first = later - 1 if rest > 0.0 else later
    return sent[0][first % size], sent[1][first % size], sent[1][later % size]
