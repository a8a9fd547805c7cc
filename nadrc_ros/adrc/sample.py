"""What one tick of the controller is told: a measurement, if one came, and its times."""

from __future__ import annotations

from math import nan
from typing import NamedTuple

# Of a command that went through single precision.
SAME = 1e-6


class Sample(NamedTuple):
    """
    One measurement with the times that belong to it [s], or a tick without one.

    Three times are told here; two are counted by the policy, see
    :class:`~nadrc_ros.adrc.supervisor.PolicyState`. At the tick that takes sample 3, when sample 2
    was refused::

        sample             1             2                  3
        tick                   |             |                    |
                      -----+---+---------+---+--------------+-----+---> time
        gap                |------------>|                              of what was refused
        span                             |----------------->|           since the sample before
        elapsed                              |------------------->|     since the last tick
        age                                                 |---->|     since the sample was there
        measurement_age    |------------------------------------->|     had sample 3 not come

    The observers advance by ``gap + span``, the rate limit counts over ``elapsed``, and the
    timeout of the sensor from where ``age`` begins.

    ``measurement`` is y, nan when none came; ``span`` is then 0, and may be anything where clocks
    are at fault: the law refuses what is not positive. ``elapsed`` and ``age`` are not negative.
    ``applied``, a finite number, is the command that really acted since the last tick, and
    ``applied_age`` how long ago it was by a report; nan without one, when it is our own. ``sent``
    is our own last command in any case, nan if that is ``applied``; ``downstream`` is the command
    nearest to it that may be acting by now, nan without a report, and ``foreign`` whether what
    acted was none of ours. ``followed`` is whether ours acts at all: not while the inner loop that
    takes it is not in control. ``gain_variable`` is what ``b0_table`` is over if that has a topic,
    nan for the last one. ``feed_forward``, a finite number, is what is added to the command until
    the next tick.
    """

    measurement: float
    span: float
    elapsed: float
    age: float
    applied: float
    followed: bool = True
    gain_variable: float = nan
    applied_age: float = nan
    sent: float = nan
    feed_forward: float = 0.0
    downstream: float = nan
    foreign: bool = False


def same(sent: float, applied: float) -> bool:
    """Tell whether what acted is a command that was sent, as a number of single precision."""
    return abs(sent - applied) <= SAME * abs(sent)


def regular(measurement: float, period: float, applied: float, feed_forward: float) -> Sample:
    """
    Return the sample of a period like all others, under our own command.

    Compiled, a sample needs all its numbers: numba takes no defaults of a named tuple.
    """
    return Sample(
        measurement, period, period, 0.0, applied, True, nan, nan, nan, feed_forward, nan, False
    )
