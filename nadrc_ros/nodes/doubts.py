"""What a controller in control can see of being wrong: looked at once per second."""

from __future__ import annotations

from collections.abc import Container, Sequence
from math import ceil, inf, isfinite

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.supervisor import Mode
from nadrc_ros.nodes.mode_news import concerns
from nadrc_ros.ros.diagnostics import OK
from nadrc_ros.ros.remarks import Remarks
from nadrc_ros.ros.topics import Input

# Above this share of the rate an observer is not what its bandwidth says.
LARGEST_SHARE = 0.3
# Looks without a reference in control, with a moving one, and with rare samples, until it is said.
LOOKS = 4
# A look is over a second, or so many periods: each has a tick.
PERIODS = 1.25
# At a limit for so long [s], or so many time constants, an error has grown by this share, and by
# so many times the largest step between two samples, of which a look leaves this share.
STUCK, TIME_CONSTANTS, GROWTH, CLEARLY, KEPT = 3.0, 12.0, 0.2, 4.0, 0.9
DEFAULTS = ControllerSettings()
CONCERNS = ('stall', 'measurement', 'reference')
PLANT = ('b0', 'command_min', 'command_max')


class Doubts:
    """
    Says what the controller can know of a loop that is set up wrongly.

    Parameters
    ----------
    controller, rate
        The loop, and its periods per second [Hz].
    given
        The names of the parameters that were given at the start.
    remarks
        Where it is said.

    """

    def __init__(
        self, controller: Controller, rate: float, given: Container[str], remarks: Remarks
    ) -> None:
        self._controller = controller
        self._rate = rate
        self._seconds, self._every = 0, max(1, ceil(PERIODS / rate))
        self._scatter = 0.0
        self._forgotten = [name for name in PLANT if name not in given]
        self._remarks = remarks
        self._unreferenced = self._moving = self._rare = 0
        self._reference = 0.0

    def look(self, spacing: float, references: Sequence[Input]) -> None:
        """
        Look at the loop; to be called once per second.

        ``spacing`` is the time between the last two samples [s], ``references`` are the inputs of
        the reference and its derivatives.
        """
        self._seconds += 1
        if (self._seconds - 1) % self._every:
            return
        controller, say = self._controller, self._remarks.put
        topic, *derivatives = (each.topic for each in references)
        settings, in_control = controller.settings, controller.mode == Mode.OK
        say('bandwidth', self._of_bandwidths(settings))
        say('defaults', self._of_defaults(settings))
        watch = controller.watch
        refused = isfinite(controller.refused_reference)
        without = in_control and watch.reference_age == inf and not refused
        self._unreferenced = self._unreferenced + 1 if without else 0
        text = f'no reference yet: holding {controller.reference[0]:.6g}, as none comes on {topic}'
        say('reference', text if self._unreferenced >= LOOKS else '')
        found = concerns(controller)
        for name in CONCERNS:
            say(f'{name} concern', found.get(name, ''))
        say('spacing', self._of_spacing(settings, spacing))
        self._scatter = max(watch.spread, KEPT * self._scatter)
        say('sign', self._of_sign(settings) if in_control else '')
        came = any(each.count for each in references[1:])
        replaced = settings.error_based or settings.tracking_acceleration > 0.0
        moved = controller.reference[0] != self._reference
        late = in_control and moved and bool(derivatives) and not came and not replaced
        self._reference = controller.reference[0]
        self._moving = self._moving + 1 if late else 0
        text = (
            f'the reference moves and nothing comes on {", ".join(derivatives)}: it is followed '
            'late, unless you publish that or set error_based, which overshoots on steps'
        )
        say('derivatives', text if self._moving >= LOOKS else '', OK)

    def _of_bandwidths(self, settings: ControllerSettings) -> str:
        names = ['inner_bandwidth', 'outer_bandwidth'][: self._controller.design.levels]
        shares = {name: getattr(settings, name) / self._rate for name in names}
        return ', '.join(
            f'{name} / rate = {share:.3g}, above {LARGEST_SHARE:g}'
            for name, share in shares.items()
            if share > LARGEST_SHARE
        )

    def _of_defaults(self, settings: ControllerSettings) -> str:
        left = [n for n in self._forgotten if getattr(settings, n) == getattr(DEFAULTS, n)]
        if 'b0' not in left:
            return ''
        values = ', '.join(f'{name} = {getattr(DEFAULTS, name):g}' for name in left)
        return f'{values}: by default, and not of your plant'

    def _of_spacing(self, settings: ControllerSettings, spacing: float) -> str:
        times = {name: getattr(settings, name) for name in ('measurement_timeout', 'max_dt')}
        short = [f'{name} = {t:g}' for name, t in times.items() if 0.0 < t < spacing]
        silent = self._controller.watch.measurement_age > LOOKS * max(spacing, 1.0)
        self._rare = self._rare + 1 if short and not silent else 0
        if self._rare < LOOKS:
            return ''
        return (
            f'measurements come every {spacing:.3g} s, too seldom for {" and ".join(short)}: '
            f'{3.0 * spacing:.2g} s would do'
        )

    def _of_sign(self, settings: ControllerSettings) -> str:
        """Return what a growing error at a limit may mean, which a wrong sign of b0 has."""
        controller, growth = self._controller, self._controller.error_growth
        needed = max(STUCK, TIME_CONSTANTS / settings.controller_bandwidth)
        watch = controller.watch
        least = max(GROWTH * abs(watch.distance), CLEARLY * self._scatter)
        if watch.stalled < needed or growth <= least:
            return ''
        return (
            f'at the limit {controller.command:g} for {controller.limited_for:.3g} s while the '
            f'error grew by {growth:.3g}: wrong sign of b0, or too narrow limits?'
        )
