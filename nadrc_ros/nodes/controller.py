"""The controller node: the law under its fault policy, on samples of the graph."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import isnan, nan
import sys
from typing import Any

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Mode
from nadrc_ros.nodes.axes import axes_parser, axis_of, axis_spaces, refuse_unequal
from nadrc_ros.nodes.cascades import make_joined
from nadrc_ros.nodes.commission import Commission
from nadrc_ros.nodes.doubts import Doubts
from nadrc_ros.nodes.estimates import Estimates, loop_values
from nadrc_ros.nodes.lease import Lease, STOPPED
from nadrc_ros.nodes.loop_settings import LoopSettings
from nadrc_ros.nodes.mode_log import cut_short, jump, ModeLog, state
from nadrc_ros.nodes.optional_inputs import OptionalInputs, refuse_unused_wires
from nadrc_ros.nodes.reference_input import ReferenceInput
from nadrc_ros.nodes.rivals import Rivals
from nadrc_ros.records.step_trace import TraceWriter
from nadrc_ros.ros.diagnostics import Latencies, Report, WARN
from nadrc_ros.ros.graph import OutputWatch
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.pacing import SampleTicker, SharedTimer, Ticker
from nadrc_ros.ros.parameters import ParameterGroup, written_to
from nadrc_ros.ros.runtime import run
from nadrc_ros.ros.topics import Info, reference_topics
from nadrc_ros.ros.wiring_parameters import Wiring

Reference = Sequence[float | None]
# Readers of the estimates, and rivals, are looked for so often [s].
_LOOK = 0.1


class ControllerNode(LiveNode):
    """
    N-ADRC on the graph: ``reference`` and ``measurement`` in, ``command`` out.

    A tick without a new measurement holds the command, or lets it go on at the rate limit, and
    leaves the observers as they are; the next sample's time step spans the gap. The command is
    sent before anything else is done with it.
    """

    default_name = 'controller'

    # Of several axes the first one, whose timers tick this one too.
    first: ControllerNode | None = None

    def set_up(self) -> None:
        """Declare the parameters and join the graph."""
        first, in_lockstep = self.first, self.pacing.lockstep
        self._loop = self.declare(LoopSettings)
        if first is not None:
            refuse_unequal(first, self)
        self._wiring: Wiring = Wiring(self, first and first._wiring)
        settings = ParameterGroup(
            self, declared(ControllerSettings), self._make_settings, self._retune
        ).value
        # In lockstep the plant waits at its initial state, as in the simulation.
        self.controller = Controller(
            settings, enabled=self._loop.enabled_at_start, checked=in_lockstep
        )
        self.controller.specialise()
        self.reference_from = self._loop.reference_from
        references = () if self.reference_from else reference_topics(settings)
        self._reference = ReferenceInput(len(references))
        self._sample: tuple[float, Info, int] | None = None
        self._overwritten = self._idle = 0
        self._silent_at_stop = False
        self._silent = self.controller.quiet
        self.latencies = Latencies()
        self._mode_log = ModeLog(self.controller.mode, self.controller.cause)
        self.trace: TraceWriter | None = None
        self._command = self._wiring.add_output('command', settings.safe_command)
        self._wiring.add_input('measurement', self._on_measurement, silence=WARN, regular=True)
        for i, topic in enumerate(references):
            self._wiring.add_input(topic, partial(self._reference.receive, i), silence=None)
        self._optional = OptionalInputs(self._wiring, self.controller, self.pacing)
        refuse_unused_wires(self._wiring, settings, self.reference_from)
        self._sample_ticker: SampleTicker | None = None
        if not in_lockstep:
            rate, by_timer = self.pacing.rate, self._loop.trigger == 'timer'
            self.timer: SharedTimer = (
                first.timer if first and by_timer else SharedTimer(self, rate, phase=0.5)
            )
            if by_timer:
                self.ticker = Ticker(self.timer, self.on_timer)
            else:
                self.ticker = self._sample_ticker = SampleTicker(self, self.timer, self.on_timer)
                self._sample_ticker.notice_within(settings.measurement_timeout)
                self.inputs[0].skipped = self._sample_ticker.skip
            self._wiring.flush_after(self.timer)
            self._times = self._wiring.sample_times(self.pacing.period)
            self._now = self._optional.now = self.ticker.now
            self._reference.time_by(self._wiring.reference_times(self.pacing.period), self._now)
            self._ticked = self._now()
            doubts = Doubts(self.controller, rate, self._parameter_overrides, self.remarks)
            expected = self.inputs[1 : 1 + len(references)]
            self.checks.append(lambda: doubts.look(self._times.spacing, expected))
            taken = OutputWatch(self, self._command, self.remarks)
            self.checks.append(lambda: taken.look(self.controller.commanding))
        self.add_switch('~/enable', self.enable)
        self.add_trigger('~/reset', self._reset)
        shared = self._loop.share_command or in_lockstep
        self._rivals = Rivals(self, self._command, shared=shared)
        self._lease = Lease(self, self._on_lease_over)
        self._commission = Commission(self, self.controller, self._rivals, self._lease)
        levels = self.controller.design.levels
        self._estimates = Estimates(self.add_output, levels, always=in_lockstep)
        self._divisor = 1 if in_lockstep else self._loop.estimate_divisor
        self._steps = 0
        self._look: SharedTimer = (
            first._look if first else SharedTimer(self, 1.0 / _LOOK, steady=True)
        )
        self._look.listeners += [self._estimates.look, self._mind_rivals]

    def begin(self) -> None:
        """Begin the trace, and close the loop."""
        loop, settings = self._loop, self.controller.settings
        with written_to('trace', loop.trace, 'a new file in a folder to write to') as path:
            if loop.trace:
                fail = self.get_logger().error
                self.trace = TraceWriter(path, settings, self.pacing.lockstep, fail)
        self._set_enabled(loop.enabled_at_start)

    def lead(self) -> None:
        """Note that an inner loop takes the command: on its topic there is nobody to mind."""
        self._rivals.ignore()

    # ---- parameters and services ----

    def _make_settings(self, values: dict[str, Any]) -> ControllerSettings:
        """Make settings that also fit the rate."""
        settings = build(ControllerSettings, values)
        settings.check_rate(self.pacing.rate)
        if running := getattr(self, 'controller', None):
            running.check_retune(settings)
            self._commission.refuse_change()
        return settings

    def _retune(self, settings: ControllerSettings) -> None:
        self.controller.retune(settings)
        if self._sample_ticker is not None:
            self._sample_ticker.notice_within(settings.measurement_timeout)
        if self._silent:
            self._command.rest(settings.safe_command)
        if self.trace is not None:
            self.trace.settings(settings)

    def enable(self, on: bool = True, why: str = '') -> tuple[bool, str]:
        """Close the loop, or open it; return whether that was possible, and what came of it."""
        refusal = self._commission.busy or self._rivals.refusal()
        if on and not self.controller.enabled and refusal:
            return False, refusal
        self._commission.note_switch(on)
        self._rivals.settle(on)
        said = 'enabled' if on else 'disabled'
        if on == self.controller.enabled:
            said = 'already ' + said
        else:
            self.events.tell('enable', f'{said}: {why}' if why else said)
        if on:
            said += self._lease.said()
            self.remarks.put('lease', '')
        self._set_enabled(on)
        self._estimates.look()
        self.diagnostics.publish()
        missed = '' if on else self._rivals.missed()
        return not missed, f'{said}, but {missed}' if missed else said

    def _set_enabled(self, on: bool) -> None:
        self.controller.enabled = on
        if self.trace is not None and not on:
            self.trace.disabled()

    def _on_lease_over(self) -> None:
        if self.controller.enabled:
            self.remarks.log(STOPPED, WARN)
            self.remarks.hold('lease', STOPPED, WARN)
            self.enable(False, STOPPED)
        elif not self._commission.active:
            return
        if self._sample_ticker is not None:  # which may not tick for a while
            self.on_timer()
            self._wiring.exchange.flush()

    def _reset(self) -> str:
        self._commission.refuse_change()
        self.controller.reset()
        self.events.tell('reset', 'reset')
        if self.trace is not None:
            self.trace.reset()
        return 'the observers restart at the next measurement, without a bump'

    # ---- samples ----

    def _on_measurement(self, value: float, info: Info) -> None:
        if self._sample is not None:
            self._overwritten += not self._rivals.listening
            if not self._times.saw(self._sample[1], info):
                return
        self._sample = value, info, self._now()
        if self._sample_ticker is not None:
            self.on_timer()
            self._sample_ticker.count(info['publication_sequence_number'])
            self._wiring.exchange.flush()

    def on_timer(self, elapsed: float = 0.0, periods: int = 1) -> None:
        """Do one tick with the newest sample, or without one; the time is that since the last."""
        now = self._now()
        elapsed, self._ticked = max(0.0, (now - self._ticked) * 1e-9), now
        if self._rivals.listening:
            return
        if self._sample is None:
            self._idle += 1
            self._wiring.answer(None, held=self.controller.mode == Mode.OK)
            self._take_sample(nan, 0.0, elapsed, self._take_reference())
            return
        (measurement, info, received), self._sample = self._sample, None
        dt = self._times.span(info, received)
        self._wiring.answer(info)
        age = self._times.late + max(0.0, (now - received) * 1e-9)
        self._take_sample(measurement, dt, elapsed, self._take_reference(), age)
        self.latencies.add((self._times.wall() - info['source_timestamp']) * 1e-9)

    def _take_reference(self) -> Reference | None:
        """Return a reference that came since the last step, None for derivatives that did not."""
        if self.controller.outer is not None:
            return self.controller.outer.command, 0.0, 0.0  # what feeds back has no feed-forward
        return self._reference.take()

    def on_samples(self, values: list[float]) -> None:
        """Do one tick of lockstep."""
        self._optional.take_from(values)
        measurement, reference, *derivatives = values
        known = [None if isnan(value) else value for value in derivatives]
        period = self.pacing.period
        self._take_sample(measurement, period, period, [reference, *known])

    def _take_sample(
        self,
        measurement: float,
        dt: float,
        elapsed: float,
        reference: Reference | None,
        age: float = 0.0,
    ) -> None:
        """Let the controller tick with a sample, or with nan, and send what comes of it."""
        controller = self.controller
        applied, settings = controller.command, controller.settings
        more = self._optional.take() | {'reference_span': self._reference.span}
        commission = self._commission
        commission.report_to(more)
        command = controller.tick(
            measurement, dt, elapsed=elapsed, age=age, reference=reference, **more
        )
        if commission.active:
            command = commission.tick(measurement, dt, elapsed, self._wiring.stamp)
            self._silent = False
        silent = self._rivals.mute or commission.silent or (self._silent and controller.quiet)
        if not silent or self.lockstep is not None:
            self._command.send(command, self._wiring.stamp)
        sent_safe = command == controller.settings.safe_command
        quiet = controller.quiet and not commission.active
        self._silent = quiet and (self._silent or sent_safe)
        self._steps += 1
        if self._steps % self._divisor == 0:
            self._estimates.send(controller)
        if self.trace is not None:
            self.trace.tick(controller, reference)
        if self._mode_log.now != controller.policy[:2] and self._log_mode():
            self.diagnostics.publish()
        if controller.settings is not settings:
            allowed = settings.command_rate_limit * elapsed
            if message := jump(controller.settings, applied, controller.command, allowed):
                self.get_logger().warning(message)

    def _mind_rivals(self) -> None:
        """Give way to another who is in command; begin when nobody is."""
        listened = self._rivals.listening
        idle = self._silent and self.controller.quiet
        if self._rivals.look(idle or self._commission.active):
            self._set_enabled(False)
            self.diagnostics.publish()
        elif listened and self._sample_ticker and self._sample and not self._rivals.listening:
            self.on_timer()

    # ---- what it says of itself ----

    @property
    def _unheard(self) -> bool:
        """Tell whether it never sent a command, or left off in the middle for another node."""
        return self._rivals.gave_way or not self._command.count

    def _log_mode(self) -> bool:
        """Log a change of mode or cause that was not logged yet; return whether it was now."""
        return self._mode_log.look(self.controller, self.events, self.remarks, self._unheard)

    def report(self) -> Report:
        """Tell the mode and its cause, and what the samples were like."""
        controller = self.controller
        values = loop_values(controller)
        if self.lockstep is None:
            values |= {
                'ticks_without_measurement': self._idle,
                'measurements_overwritten': self._overwritten,
                **self._times.counts(),
                'lease_left': self._lease.left,
                'measurement_topic': self.inputs[0].topic,
                'command_topic': self._command.topic,
                'measurement_publishers': self.count_publishers(self.inputs[0].topic),
                'command_readers': self._command.publisher.get_subscription_count(),
                **self.latencies.summary(),
                **self._wiring.report(),
                **self._commission.report(),
            }
        if self.trace is not None:
            self.trace.flush()
        self._log_mode()  # the last of many changes
        return *state(controller, self._unheard), values

    # ---- the end ----

    def begin_stop(self) -> None:
        """Ramp to the safe command; a silent one stays so, as another may be in control."""
        self._silent_at_stop = self._silent or self._rivals.mute
        self._set_enabled(False)
        self._commission.close()

    @property
    def stopped(self) -> bool:
        """Tell whether the safe command was reached."""
        return self.lockstep is not None or self._silent or self._rivals.mute

    def close(self) -> None:
        """Send the safe command, whatever the rate limit, and make sure that it arrives."""
        super().close()
        if not self._silent_at_stop and (self.lockstep is None or not self.lockstep.complete):
            settings = self.controller.settings
            allowed = settings.command_rate_limit * self.pacing.period
            last = self._commission if self._commission.active else self.controller
            if message := cut_short(settings, last.command, allowed):
                self.get_logger().warning(message)
            self._command.send_last(settings.safe_command, self._wiring.now())
        if self.trace is not None:
            self.trace.close()

    def discard(self) -> None:
        """Leave nothing behind of a node that never ran."""
        if self.trace is not None:
            self.trace.discard()

    def await_delivery(self, seconds: float) -> None:
        """Wait until the last command has arrived."""
        self._command.await_delivery(seconds)


def make_axes(arguments: Sequence[str]) -> list[ControllerNode]:
    """
    Make one controller, or one for each axis that the command line names.

    Raises
    ------
    UserError
        Names the axis that cannot be; what the others began to write is gone.

    """
    spaces = axis_spaces(arguments)
    axes = list(spaces.values())
    kind = ControllerNode
    if axes_parser().parse(arguments).managed:
        from nadrc_ros.nodes.managed import managed

        kind = managed(ControllerNode)

    def make(name: str, first: ControllerNode | None) -> ControllerNode:
        axis = axis_of(kind, first, axes)
        return axis(namespace=spaces.get(name, ''), arguments=arguments)

    return make_joined(list(spaces) or [''], make)


def main() -> int:
    """Run the controllers of one axis or more."""
    axes_parser().parse(sys.argv)
    return run(lambda: make_axes(sys.argv))


if __name__ == '__main__':
    raise SystemExit(main())
