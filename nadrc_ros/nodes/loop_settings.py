"""How a controller node takes part in its loop: what starts a step, what is kept of it."""

from __future__ import annotations

import attrs
from nadrc_ros.adrc.fields import choice, flag, integer, text


@attrs.frozen(kw_only=True)
class LoopSettings:
    """What is asked of a controller node beside its law; fixed at start."""

    trigger: str = choice(
        'timer',
        ('timer', 'measurement'),
        'trigger of a step: a fixed-rate timer, or each received measurement',
        live=False,
    )
    reference_from: str = text(
        '',
        'axis of the same process whose command is the reference, in the same tick and without a '
        'topic: for the inner loop of a cascade; empty = the topic',
        live=False,
    )
    enabled_at_start: bool = flag(True, 'whether the loop is closed from the start', live=False)
    share_command: bool = flag(
        False,
        'whether to command beside another node; if not, a controller that hears another one '
        'before its first command, or up to 5 s later with more commands, is disabled',
        live=False,
    )
    estimate_divisor: int = integer(
        1,
        1,
        10000,
        'estimates are published with every N-th command; lockstep publishes all',
        live=False,
    )
    trace: str = text(
        '', 'new file for one record per step, from which the run can be replayed', live=False
    )
