"""Loops in a cascade: each takes the command of the one around it as its reference, at once."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

import attrs
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings


@attrs.frozen(kw_only=True)
class CascadeSettings(ControllerSettings):
    """
    Settings of the outer loop of a cascade, with those of the loop inside it.

    The ``inner`` settings may be of a cascade again.

    Raises
    ------
    SettingError
        As :class:`ControllerSettings`; also for commands that the inner loop would not take, and a
        feed-forward.

    """

    inner: ControllerSettings = attrs.field(
        validator=attrs.validators.instance_of(ControllerSettings)
    )

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        self.check_inner(self.inner)
        if self.feed_forward_timeout > 0.0:
            allowed = '0 (off) in a scenario, whose feed_forward is for the innermost loop'
            raise SettingError('feed_forward_timeout', self.feed_forward_timeout, allowed)

    def check_rate(self, rate: float) -> None:
        """Refuse times that are too short for a loop at ``rate`` [Hz], in every loop."""
        super().check_rate(rate)
        try:
            self.inner.check_rate(rate)
        except SettingError as error:
            raise error.inside('inner') from None


def loops_of(settings: ControllerSettings) -> list[ControllerSettings]:
    """Return the settings of each loop, the outermost first; of one loop, just these."""
    if isinstance(settings, CascadeSettings):
        return [settings, *loops_of(settings.inner)]
    return [settings]


class Cascade:
    """
    Controllers of which each takes the command of the one before as its reference.

    They are ticked from the outermost to the innermost within one tick, so that nothing is late.
    What the limits of a loop leave of its reference is the applied command of the one around it,
    and while a loop is not in control, those around it wait where the plant is.

    Parameters
    ----------
    settings
        Of the outermost loop; one that is no :class:`CascadeSettings` makes a cascade of one.
    enabled, checked
        As of a :class:`~nadrc_ros.adrc.controller.Controller`, for all of them.

    Attributes
    ----------
    loops
        The controllers, the outermost first.

    """

    def __init__(
        self, settings: ControllerSettings, *, enabled: bool = True, checked: bool = False
    ) -> None:
        self.loops = [
            Controller(each, enabled=enabled, checked=checked) for each in loops_of(settings)
        ]
        for outer, inner in zip(self.loops, self.loops[1:]):
            outer.join(inner)

    def tick(
        self,
        measurements: Sequence[float] = (),
        dt: float | Sequence[float] = 0.0,
        *,
        elapsed: float | None = None,
        age: float = 0.0,
        reference: Sequence[float | None] | None = None,
        applied: float | None = None,
        feed_forward: float | None = None,
    ) -> float:
        """
        Advance all loops by one tick and return the command of the innermost one.

        As :meth:`~nadrc_ros.adrc.controller.Controller.tick`, with one measurement for each loop,
        the outermost first, and one ``dt`` for all of them or for each. ``applied`` and
        ``feed_forward`` are of the innermost one.
        """
        last = len(self.loops) - 1
        for i, loop in enumerate(self.loops):
            loop.tick(
                measurements[i] if measurements else nan,
                dt if isinstance(dt, (int, float)) else dt[i],
                elapsed=elapsed,
                age=age,
                reference=reference,
                applied=applied if i == last else None,
                feed_forward=feed_forward if i == last else None,
            )
            reference = [loop.command, 0.0, 0.0]  # what feeds back has no feed-forward
        return self.loops[-1].command
