"""The inputs that a controller node has only where its settings ask for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.ros.diagnostics import WARN
from nadrc_ros.ros.pacing import PacingSettings
from nadrc_ros.ros.topics import (
    APPLIED_TOPIC,
    FEED_FORWARD_TOPIC,
    GAIN_TOPIC,
    Info,
    REFERENCE_TOPICS,
)
from nadrc_ros.ros.wiring_parameters import Wiring


class OptionalInputs:
    """
    The variable of b0, the command that acts, and the feed-forward.

    The last two are there if their timeout is not 0.

    Attributes
    ----------
    now
        The clock of the ticks [ns], None in lockstep.

    Raises
    ------
    SettingError
        For a ``b0_source`` without a table, or a topic as one in lockstep.

    """

    def __init__(self, wiring: Wiring, controller: Controller, pacing: PacingSettings) -> None:
        self.now: Callable[[], int] | None = None
        self._period = pacing.period
        self._applied: float | None = None
        self._received = 0
        self._feed_forward: float | None = None
        settings = controller.settings
        self._listens = settings.applied_timeout > 0.0
        self._fed = settings.feed_forward_timeout > 0.0
        if settings.b0_source != 'measurement' and len(settings.b0_table) == 1:
            allowed = 'left out without a b0_table, which it is the variable of'
            raise SettingError('b0_source', settings.b0_source, allowed)
        if settings.b0_source == 'topic':
            if pacing.lockstep:
                allowed = 'measurement or reference with pacing: lockstep'
                raise SettingError('b0_source', 'topic', allowed)
            take = controller.take_gain_variable
            wiring.add_input(GAIN_TOPIC, lambda value, _: take(value), silence=WARN)
        if self._listens:
            wiring.add_input(APPLIED_TOPIC, self._on_applied, silence=WARN, regular=True)
        if self._fed:
            wiring.add_input(FEED_FORWARD_TOPIC, self._on_feed_forward, silence=WARN)

    def _on_applied(self, value: float, _: Info) -> None:
        self._applied = value
        if self.now is not None:
            self._received = self.now()

    def _on_feed_forward(self, value: float, _: Info) -> None:
        self._feed_forward = value

    def take_from(self, values: list[float]) -> None:
        """Take those of lockstep, the last of all inputs, off the end of the ``values``."""
        if self._fed:
            self._feed_forward = values.pop()
        if self._listens:
            self._applied = values.pop()

    def take(self) -> dict[str, Any]:
        """
        Return what came since the last tick, as the controller is told it.

        A period is added to the age of a report: so long a command may have been on its way to who
        reports, and it is known what acted then.
        """
        if not self._listens and not self._fed:
            return {}
        applied, fed, age = self._applied, self._feed_forward, 0.0
        self._applied = self._feed_forward = None
        if applied is not None and self.now is not None:
            age = max(0.0, (self.now() - self._received) * 1e-9) + self._period
        return {'applied': applied, 'applied_age': age, 'feed_forward': fed}


def refuse_unused_wires(wiring: Wiring, settings: ControllerSettings, reference_from: str) -> None:
    """
    Refuse the address of a signal that nothing here takes: it was meant to be heard.

    Raises
    ------
    SettingError
        Names it, and what it would take.

    """
    derivatives = f'takes {settings.received_derivatives} derivatives'
    how = f'plant_order = {settings.plant_order} and reference_derivatives = '
    reason = f'a controller with {how}{settings.reference_derivatives} {derivatives}'
    why = dict.fromkeys(REFERENCE_TOPICS, reason)
    if reference_from:
        reason = f'the reference is the command of the axis {reference_from} (reference_from)'
        why = dict.fromkeys(REFERENCE_TOPICS, reason)
    why[GAIN_TOPIC] = 'b0_source is not topic'
    why[APPLIED_TOPIC] = 'applied_timeout is 0 (off)'
    why[FEED_FORWARD_TOPIC] = 'feed_forward_timeout is 0 (off)'
    wiring.refuse_unused(why)
