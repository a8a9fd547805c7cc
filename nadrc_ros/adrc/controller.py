"""The controller: the law under its fault policy, one tick at a time."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, nan

from nadrc_ros.adrc.angle import counted
from nadrc_ros.adrc.command_intake import CommandIntake
from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.intake import ReferenceIntake
from nadrc_ros.adrc.limiter import clamp
from nadrc_ros.adrc.realised import realised_reference
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST, LOWEST
from nadrc_ros.adrc.specialise.python import specialised
from nadrc_ros.adrc.state import blank_state, disturbance_estimate, output_estimate
from nadrc_ros.adrc.status import Cause, Mode, MODE_OK, NO_MEASUREMENT, RESTARTED, SAFE, Status
from nadrc_ros.adrc.supervisor import PolicyState
from nadrc_ros.adrc.tick import tick
from nadrc_ros.adrc.transfer import adopt_reference, retune

# To ask the Enum for its member costs more than a tick's arithmetic.
_STATUSES = tuple(Status)


class Controller:
    """
    One running controller: settings, state and the counters an operator wants to see.

    Parameters
    ----------
    settings
        What to begin with.
    enabled
        Whether the law may act.
    checked
        That the sensor was seen to work already, as in a simulation, where the plant waits at its
        initial state: the first valid sample then stands for ``good_samples``.

    Attributes
    ----------
    inner, outer
        The controller that takes the command as its reference, if one does in this process, which
        says what it made of it, and whether it follows; and the one whose command is followed. See
        :meth:`join`.
    settings, design, state, policy
        What runs, and where law and policy are; a retune takes over with the next tick.
    sample, reference, command, status
        Of the last tick: what it was told, r and its derivatives as they are followed, what came.
    gain_variable
        The last one received, nan before the first.
    counts
        How often each status came; a refused reference counts as ``BAD_REFERENCE``.
    intake
        What takes the reference in.
    refused_measurement
        The last one, if it was out of range; None once a good one came.

    Examples
    --------
    >>> controller = Controller(ControllerSettings(plant_order=1, b0=2.0), checked=True)
    >>> controller.tick(measurement=0.0, dt=0.01, reference=[1.0])
    0.0
    >>> 0.0 < controller.tick(measurement=0.0, dt=0.01) < 2.0
    True

    """

    def __init__(
        self, settings: ControllerSettings, *, enabled: bool = True, checked: bool = False
    ) -> None:
        self.inner: Controller | None = None
        self.outer: Controller | None = None
        self.settings = settings
        self.design = make_design(settings)
        self.state = blank_state(self.design)
        self.policy = PolicyState(good=settings.good_samples - 1 if checked else 0)
        self._enabled = enabled
        self.command = settings.safe_command
        self.gain_variable = nan
        self.sample = Sample(nan, 0.0, 0.0, 0.0, self.command)
        self.status = Status.NO_MEASUREMENT
        self.counts = dict.fromkeys(Status, 0)
        self.intake = ReferenceIntake(settings, self.counts)
        self.reference = self.intake.values
        self.refused_measurement: float | None = None
        self.commands = CommandIntake(settings)
        self._next = blank_state(self.design)
        self._pending: tuple[ControllerSettings, Design] | None = None
        self._restarted = False
        self._law = tick

    def tick(
        self,
        measurement: float = nan,
        dt: float = 0.0,
        *,
        elapsed: float | None = None,
        age: float = 0.0,
        reference: Sequence[float | None] | None = None,
        reference_span: float = 0.0,
        applied: float | None = None,
        applied_age: float = 0.0,
        followed: bool = True,
        gain_variable: float = nan,
        feed_forward: float | None = None,
    ) -> float:
        """
        Advance by one tick and return the command to send.

        Parameters
        ----------
        measurement
            y, or nan when none came since the last tick.
        dt
            Time since the previous sample [s]; 0 when none came.
        elapsed
            Time since the last tick [s], by default ``dt``; needed where no sample came.
        age
            How long ago the measurement came [s]: ``measurement_timeout`` counts from then.
        reference
            r and its derivatives, or None when no new one came. None or no number stands for the
            last one, for at most ``max_dt``, then for 0, without a bump. One that is left out is
            0; with ``reference_derivatives = auto`` it is estimated from the samples of r, as is
            one that does not come any more.
        reference_span
            Time from when the reference before was sent to when this one was [s], for its rate; 0
            for the time between the ticks that took them.
        applied
            The command that really acted since the last tick [command unit], None when nobody said
            so. It counts for ``applied_timeout`` from when it did, not at all if it comes later
            than that, in this tick alone where that is 0; else the one returned last is taken.
        applied_age
            How long ago that was [s]: what acts by now is as much newer. With ``applied_timeout``
            it is known which commands of ours it may be.
        followed
            Whether it acts at all; False holds the command where ``applied`` is. With an ``inner``
            controller both are known.
        gain_variable
            What ``b0_table`` is over if ``b0_source`` is ``topic``; nan for the last one.
        feed_forward
            What is added to the command [command unit], None when no new one came. It counts for
            ``feed_forward_timeout``, in this tick at least; then it is ramped out at
            ``command_rate_limit``, at once without one.

        """
        if elapsed is None:
            elapsed = dt
        if not elapsed > 0.0:
            elapsed = 0.0
        sent = self.command
        if self.inner is not None:
            applied, followed = self.inner.realised(sent)
        applied, applied_age = self.commands.applied(applied, applied_age, elapsed, sent)
        downstream, foreign = nan, False
        if applied_age >= 0.0:  # by a report
            downstream, foreign = self.commands.compare(applied, applied_age, sent)
        if gain_variable == gain_variable:
            self.take_gain_variable(gain_variable)
        fed = self.state.offset[2]
        if feed_forward is not None or fed != 0.0:
            rate_limit = self.design.command_rate_limit
            fed = self.commands.feed_forward(feed_forward, fed, rate_limit, elapsed)
        referenced = self.intake.advance(self.design, reference, elapsed, reference_span)
        gap = self.policy.gap
        sample = Sample(
            measurement,
            dt,
            elapsed,
            age if age > 0.0 else 0.0,
            applied,
            followed,
            self.gain_variable,
            applied_age,
            sent,
            fed,
            downstream,
            foreign,
        )
        self.sample = sample
        command, status, self.policy = self._law(
            self.design,
            self.state,
            self.policy,
            sample,
            self.reference,
            referenced,
            self._enabled,
            self._next,
        )
        self.state, self._next = self._next, self.state
        self.status = _STATUSES[status]
        self.counts[self.status] += 1
        limited_over = elapsed
        if dt > 0.0:  # a sample came
            self.refused_measurement = measurement if status == NO_MEASUREMENT else None
        if status < NO_MEASUREMENT:
            self._restarted = status == RESTARTED
            limited_over = min(gap + dt, elapsed)  # the narrower of both limits was the one
        # New settings never share a tick with the old: they take over the state that the old ones
        # just reached, so that both can be asked for the command of the same sample.
        if self._pending is not None:
            command = self._swap(*self._pending, command, limited_over)
        self.command = command
        if self.intake.drop_old(self.design.max_dt):
            adopt_reference(self.design, self.reference, self.state, sent, elapsed, downstream)
        return command

    def realised(self, unknown: float) -> tuple[float, bool]:
        """
        Return what became of the last reference, and whether the law follows one.

        That is for the outer loop of a cascade; ``unknown`` where nothing is known yet. See
        :func:`~nadrc_ros.adrc.realised.realised_reference`.
        """
        now = realised_reference(self.design, self.state, self.policy, self.command, unknown)
        return now, self.policy.mode == MODE_OK

    def specialise(self) -> None:
        """
        Let the law run as code that is made for its shape, in a tenth of a second: the same bits.

        A live change to a shape of which there is none goes on with the law as it is written.
        """
        self._law = specialised(tick, self.design)

    def retune(self, settings: ControllerSettings) -> None:
        """
        Let ``settings`` take over at the end of the next tick, without a bump.

        Raises
        ------
        SettingError
            As :meth:`check_retune`.

        """
        self.check_retune(settings)
        self._pending = settings, make_design(settings)

    def check_retune(self, settings: ControllerSettings) -> None:
        """
        Refuse what a running controller cannot become.

        Raises
        ------
        SettingError
            When a setting that is fixed at start differs, the plant order for one, and for another
            sign of b0 while the controller is enabled.

        """
        for name, field in declared(ControllerSettings).items():
            now, wanted = getattr(self.settings, name), getattr(settings, name)
            if not field.live and wanted != now:
                raise SettingError(name, wanted, f'{now}: it is fixed at start')
        if self.enabled and settings.b0 * self.settings.b0 < 0.0:
            raise SettingError('b0', settings.b0, 'of the sign it has, until it is disabled')
        if self.inner is not None:
            settings.check_inner(self.inner.staged)
        if self.outer is not None:
            self.outer.staged.check_inner(settings, 'this one')

    @property
    def staged(self) -> ControllerSettings:
        """Return the settings of the next tick: those that were staged, else those that run."""
        return self._pending[0] if self._pending is not None else self.settings

    def join(self, inner: Controller) -> None:
        """
        Let another controller take the command as its reference, ticked after this one.

        Raises
        ------
        SettingError
            As :meth:`~nadrc_ros.adrc.settings.ControllerSettings.check_inner`.

        """
        self.staged.check_inner(inner.staged)
        self.inner, inner.outer = inner, self

    def take_gain_variable(self, value: float) -> None:
        """Keep what ``b0_table`` is over if ``b0_source`` is ``topic``, unless it is no number."""
        if LOWEST <= value <= HIGHEST:
            self.gain_variable = value

    def reset(self) -> None:
        """Forget the estimates; the next valid measurement restarts them without a bump."""
        self.policy = self.policy._replace(gap=inf)

    @property
    def enabled(self) -> bool:
        """Whether the law may act; to disable it ends a stall, however soon it is enabled anew."""
        return self._enabled

    @enabled.setter
    def enabled(self, on: bool) -> None:
        if not on:  # the next tick may find it enabled again
            stall = self.policy.stall._replace(at_limit=0.0, stalled=0.0)
            self.policy = self.policy._replace(stall=stall)
        self._enabled = on

    @property
    def mode(self) -> Mode:
        """Tell what the command is."""
        return Mode(self.policy.mode)

    @property
    def cause(self) -> Cause:
        """Why the law does not act."""
        return Cause(self.policy.cause)

    @property
    def commanding(self) -> bool:
        """Tell whether it is in control of what no inner loop of this process passes on."""
        return self.policy.mode == MODE_OK and self.inner is None

    @property
    def restarted(self) -> bool:
        """Tell whether the last sample in control only restarted the observers."""
        return self.policy.mode == MODE_OK and self._restarted

    @property
    def limited_for(self) -> float:
        """How long the command has been at a limit other than safe, in control [s]."""
        return self.policy.stall.at_limit

    @property
    def stalled(self) -> bool:
        """Tell whether it was at a limit for ``stall_time`` and the error did not shrink."""
        return 0.0 < self.design.stall_time < self.policy.stall.stalled

    @property
    def error_growth(self) -> float:
        """By how much the error grew since the command reached its limit [output unit]."""
        stall = self.policy.stall
        if stall.at_limit == 0.0:
            return 0.0
        return abs(stall.aim - self.policy.last) - abs(stall.distance)

    @property
    def quiet(self) -> bool:
        """Tell whether it is disabled and at rest, with nothing to send."""
        return not self.enabled and self.policy.mode == SAFE

    @property
    def b0(self) -> float:
        """Return b0 by now, the setting or that of its table."""
        return self.state.gain[0]

    @property
    def refused_reference(self) -> float:
        """Return the last reference, if it was out of range; nan once a good one came."""
        return self.intake.refused

    @property
    def resting(self) -> bool:
        """Tell whether the command is held inside the deadband of the error."""
        return self.state.resting[0] > 0.0

    @property
    def tracking(self) -> float:
        """Return the reference the law follows, r1; of an angle with all turns."""
        return counted(self.design, self.state, self.state.profile[0])

    @property
    def output_estimate(self) -> float:
        """Return the output as the level that feeds the law estimates it, with all turns."""
        return counted(self.design, self.state, output_estimate(self.design, self.state))

    @property
    def disturbances(self) -> list[float]:
        """Return the disturbance estimate d_k of each level, in units of y^(n)."""
        return [level[self.design.order] for level in self.state.levels]

    @property
    def total_disturbance(self) -> float:
        """Return the estimate of L = y^(n) + sum_i a_i y^(i) - b0 u: the sum of the levels."""
        return disturbance_estimate(self.design, self.state)

    def _swap(
        self, settings: ControllerSettings, design: Design, command: float, dt: float
    ) -> float:
        """Take over new settings on the state just reached, and return the command under them."""
        sample = self.sample
        self.state = retune(
            *(self.design, design, self.state, self.reference, sample.applied, dt),
            *(sample.sent, sample.downstream, self._next),
        )
        self._next = blank_state(design)
        self.settings, self.design, self._pending = settings, design, None
        self._law = specialised(tick, design, make=False)
        return clamp(design, command)
