"""What theory expects of settings before they are applied."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import Any

import attrs
from nadrc_ros.adrc.design import make_design, polynomial
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.live.outbox import Message
from nadrc_ros.theory.delayed import command_variance, delayed_loop
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.margins import loop_margins

_POINTS = 300


def predicted(
    settings: ControllerSettings, values: Mapping[str, Any], rate: float
) -> tuple[Message, Message, str]:
    """
    Return the figures of the settings of now, of those with other values, and what they hold for.

    The plant is the one that the present settings describe: integrators or ``plant_poles``, with
    the present b0 and ``input_delay``. So another b0 moves the margins. ``command_noise`` is the
    standard deviation of the command over that of white noise of the measurement,
    ``period_product`` the largest bandwidth of a level times the period.

    Raises
    ------
    UserError
        For values that the controller would refuse.

    """
    own = declared(ControllerSettings)
    pending = attrs.evolve(settings, **{k: v for k, v in values.items() if k in own})
    pending.check_rate(rate)
    text = 'for the plant that the present settings describe, with their b0'
    return _figures(settings, settings, rate), _figures(pending, settings, rate), text


def _figures(of: ControllerSettings, on: ControllerSettings, rate: float) -> Message:
    design, h = make_design(of), 1.0 / rate
    plant = chain(on.plant_order, on.b0, polynomial(on.known_poles))
    loop = delayed_loop(design, plant, h, on.input_delay)
    margins = loop_margins(loop, _POINTS)
    stable = margins.modulus > 0.0
    return {
        'stable': stable,
        'gain_margin': [margins.gain_low, margins.gain_high],
        'phase_margin': degrees(margins.phase),
        'delay_margin': margins.delay,
        'modulus_margin': margins.modulus,
        'command_noise': command_variance(loop) ** 0.5 if stable else None,
        'period_product': max(design.bandwidths) * h,
    }


def prediction(
    settings: ControllerSettings | None, values: Mapping[str, Any], rate: Any
) -> Message:
    """Return the answer to who asks what would come of values."""
    found: Message = {'type': 'prediction', 'ok': False, 'now': None, 'pending': None}
    if settings is None or not isinstance(rate, float):
        return found | {'text': 'the settings of the controller are not known'}
    try:
        now, pending, text = predicted(settings, values, rate)
    except (UserError, TypeError, ValueError, ArithmeticError) as error:
        return found | {'text': str(error)}
    return found | {'ok': True, 'now': now, 'pending': pending, 'text': text}
