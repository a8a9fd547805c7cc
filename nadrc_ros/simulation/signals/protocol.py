"""
What a signal is, a function of time that knows its own derivatives, and the check that one is.

A signal of one's own may be any class with this method. To be compiled as well, it keeps to what
:mod:`~nadrc_ros.simulation.plants.protocol` says of ``derivative``.
"""

from __future__ import annotations

from math import isfinite, nan
from typing import Any, Protocol

from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.simulation.vector import MutableVector

MOST_ENTRIES = 6


class Signal(Protocol):
    """A scalar function of time, used as reference or as disturbance."""

    def derivatives(self, t: float, out: MutableVector) -> None:
        """
        Write s(t), s'(t), ... into ``out``: 1 to 6 entries, the k-th in unit/s^k.

        All but the first are 0 before: one that is not known is left as it is.

        At a jump or a corner the right-hand value is written, without the impulse of a jump.
        """
        ...


def check_signal(signal: Any) -> Signal:
    """
    Return ``signal`` if its method works, after probing it at a few times for every length.

    Raises
    ------
    SettingError
        Says what its method does wrong.

    """
    for t in (0.0, 0.1, 1.7, 60.0):
        for entries in range(1, MOST_ENTRIES + 1):
            out = [nan, *[0.0] * (entries - 1)]
            try:
                type(signal).derivatives(signal, t, out)
            except Exception as error:
                raise SettingError(
                    'derivatives', error, 'a method (t, out) for out of any length from 1 to 6'
                ) from error
            if len(out) != entries or not all(map(_finite, out)):
                raise SettingError(
                    'derivatives', out, f'writing finite numbers into out, at least out[0] ({t=})'
                )
    checked: Signal = signal
    return checked


def _finite(value: Any) -> bool:
    try:
        return not isinstance(value, bool) and isfinite(value)
    except TypeError:
        return False
