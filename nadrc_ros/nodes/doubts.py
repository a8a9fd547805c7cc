"""What a controller can see of being wrong: looked at once per second."""

from __future__ import annotations

from collections.abc import Container, Sequence
from math import ceil, inf, isfinite

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Mode
from nadrc_ros.ros.diagnostics import OK, Remarks
from nadrc_ros.ros.topics import Input

# Above this share of the rate an observer is not what its bandwidth says.
_LARGEST_SHARE = 0.3
# So many looks in a row until something is said that may be so for a moment.
_LOOKS = 4
# A look is over a second, or so many periods: each has a tick.
_PERIODS = 1.25
# At a limit for so long [s], or so many time constants, an error has grown by this share, and by
# so many times the largest step between two samples, of which a look leaves this share.
_STUCK, _TIME_CONSTANTS, _GROWTH, _CLEARLY, _KEPT = 3.0, 12.0, 0.2, 4.0, 0.9
_DEFAULTS = ControllerSettings()
_OF_THE_PLANT = ('b0', 'command_min', 'command_max')


class Doubts:
    """
    Says what the controller can know of a loop that is set up wrongly, as standing remarks.

    ``given`` has the names of the parameters that were given at the start.
    """

    def __init__(
        self, controller: Controller, rate: float, given: Container[str], remarks: Remarks
    ) -> None:
        self._controller = controller
        self._rate = rate
        self._remarks = remarks
        self._forgotten = [name for name in _OF_THE_PLANT if name not in given]
        self._seconds, self._every = 0, max(1, ceil(_PERIODS / rate))
        self._scatter = self._reference = 0.0

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
        settings, policy = controller.settings, controller.policy
        in_control = controller.mode == Mode.OK
        refused_y, refused_r = controller.refused_measurement, controller.refused_reference
        held, before = controller.reference[0], self._reference
        self._reference = held
        topics = [each.topic for each in references]
        topic, derivatives = topics[0] if topics else 'the axis around it', topics[1:]
        self._scatter = max(policy.spread, _KEPT * self._scatter)
        say('bandwidth', self._bandwidths(settings))
        say('default', self._defaults(settings))
        without = in_control and policy.reference_age == inf and not isfinite(refused_r)
        text = f'no reference yet: holding {held:.6g}, as none comes on {topic}'
        say('no reference', text if without else '', looks=_LOOKS)
        text = (
            f'at a limit of the command for {controller.limited_for:.3g} s, and the output comes '
            'no nearer to the reference'
        )
        say('stall', text if in_control and controller.stalled else '')
        text = (
            f'the measurement {refused_y or 0.0:g} is not taken: it is outside '
            f'{settings.measurement_min:g} .. {settings.measurement_max:g}'
        )
        say('refused measurement', text if refused_y is not None else '')
        text = (
            f'the reference {refused_r:g} is not taken: it is outside '
            f'{settings.reference_min:g} .. {settings.reference_max:g}'
        )
        say('refused reference', text if isfinite(refused_r) else '')
        say('rare samples', self._rare_samples(settings, spacing), looks=_LOOKS)
        say('wrong sign', self._wrong_sign(settings) if in_control else '')
        came = any(each.count for each in references[1:])
        tracked = settings.tracking_acceleration
        why = f'tracking_acceleration = {tracked:g} makes a profile with its own'
        if settings.error_based:
            why = 'error_based = true takes the error alone'
        unused = settings.error_based or tracked > 0.0
        text = f'what comes on {", ".join(derivatives)} is not used: {why}'
        say('unused derivatives', text if came and unused else '', OK)
        replaced = unused or settings.reference_derivatives == 'auto'
        late = in_control and held != before and bool(derivatives) and not came and not replaced
        text = (
            f'the reference moves and nothing comes on {", ".join(derivatives)}: it is followed '
            'late, unless you publish that or start with reference_derivatives: auto'
        )
        say('no derivatives', text if late else '', OK, looks=_LOOKS)

    def _bandwidths(self, settings: ControllerSettings) -> str:
        names = ['inner_bandwidth', 'outer_bandwidth'][: self._controller.design.levels]
        shares = {name: getattr(settings, name) / self._rate for name in names}
        return ', '.join(
            f'{name} / rate = {share:.3g}, above {_LARGEST_SHARE:g}'
            for name, share in shares.items()
            if share > _LARGEST_SHARE
        )

    def _defaults(self, settings: ControllerSettings) -> str:
        if self._controller.inner is not None:  # b0 = 1: the inner loop does what it is asked
            return ''
        left = [n for n in self._forgotten if getattr(settings, n) == getattr(_DEFAULTS, n)]
        values = ', '.join(f'{name} = {getattr(_DEFAULTS, name):g}' for name in left)
        return f'{values}: by default, and not of your plant' if 'b0' in left else ''

    def _rare_samples(self, settings: ControllerSettings, spacing: float) -> str:
        times = {name: getattr(settings, name) for name in ('measurement_timeout', 'max_dt')}
        short = [f'{name} = {t:g}' for name, t in times.items() if 0.0 < t < spacing]
        if not short or self._controller.policy.measurement_age > _LOOKS * max(spacing, 1.0):
            return ''
        return (
            f'measurements come every {spacing:.3g} s, too rarely for {" and ".join(short)}: '
            f'{3.0 * spacing:.2g} s would do'
        )

    def _wrong_sign(self, settings: ControllerSettings) -> str:
        """
        Return what a growing error at a limit may mean.

        With the wrong sign of b0 the command drives the output away and stays at its limit. A loop
        that is well and at its limit comes nearer, or rests off its reference by what the sensor
        scatters, which is no growth.
        """
        controller, policy = self._controller, self._controller.policy
        growth = controller.error_growth
        needed = max(_STUCK, _TIME_CONSTANTS / settings.controller_bandwidth)
        if policy.stall.stalled < needed or growth <= max(
            _GROWTH * abs(policy.stall.distance), _CLEARLY * self._scatter
        ):
            return ''
        return (
            f'at the limit {controller.command:g} for {controller.limited_for:.3g} s while the '
            f'error grew by {growth:.3g}: wrong sign of b0, or too narrow limits?'
        )
