"""The plant node: a simulated plant that receives commands and sends noisy measurements."""

from __future__ import annotations

from math import isfinite, nan
import time
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.nodes.plant_settings import (
    COMMAND_FAULT,
    DERIVATIVES,
    fault_fields,
    INJECTABLE,
    MEASUREMENT_FAULT,
    NOISE,
    noise_fields,
    PlantSettings,
)
from nadrc_ros.ros.command_line import About
from nadrc_ros.ros.diagnostics import ERROR, OK, Report, WARN
from nadrc_ros.ros.node import LiveNode
from nadrc_ros.ros.pacing import PacingSettings, SharedTimer, Ticker
from nadrc_ros.ros.parameters import ParameterGroup
from nadrc_ros.ros.runtime import run_command
from nadrc_ros.ros.signal_parameters import DISTURBANCE, NOISE_SIGNAL, without
from nadrc_ros.ros.topics import APPLIED_TOPIC, Info
from nadrc_ros.scenario.specs import PLANT, PlantSpec
from nadrc_ros.scenario.user_code import class_fields
from nadrc_ros.simulation.faults import CommandFault, Faults, MeasurementFault, ONE_EACH
from nadrc_ros.simulation.integrate import substeps_for
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plant_run import PlantRun
from nadrc_ros.simulation.protocols import Plant, Signal
from nadrc_ros.simulation.sensor import refuse_one_end, Sensor

# After a longer stall of the process [s] only so much time has passed for the plant.
LONGEST_STALL = 1.0
# The same is not logged again within so long [s]: a controller may always be too slow.
_LOGGED = 5.0


class PlantNode(LiveNode):
    """
    A plant on the graph: ``command`` in; ``measurement`` and, as truth, ``~/output`` out.

    The command that is there when a period ends acts over the whole of it. ``~/total_disturbance``
    is L = y^(n) - b0 u at the start of that period, for the plant's own b0. Periods that the timer
    missed pass all the same, without a sample: no plant waits for a busy machine. A subclass may
    name a class of its own as ``plant_type``, instead of a registered one or a file.

    Attributes
    ----------
    diverged
        When [s] its state or output was not a number for the first time; None if it never was.

    """

    default_name = 'plant'
    plant_type: type[Any] | None = None

    def set_up(self) -> None:
        """Declare the parameters and join the graph."""
        fields = declared(PlantSettings)
        if self.plant_type is not None:
            name = self.plant_type.__name__
            fields['plant'] = attrs.evolve(
                fields['plant'], kind='choice', default=name, choices=(name,)
            )
        self._group = ParameterGroup(self, fields, self._make_settings)
        settings = self._group.value
        cls = self.plant_type or PLANT.type_of(settings.plant, settings.plant_class)
        self._plants = ParameterGroup(self, class_fields(cls), self._make_plant, self._change)
        self._disturbances = ParameterGroup(
            self, DISTURBANCE.asked(self), DISTURBANCE.make, self._change
        )
        added = ParameterGroup(
            self, NOISE_SIGNAL.asked(self), NOISE_SIGNAL.make, self._change_noise
        )
        noise = ParameterGroup(self, noise_fields(), _make_noise, self._change_variance)
        faults = ParameterGroup(self, fault_fields(), self._make_faults, self._inject)
        sensor = self.declare(Sensor)
        refuse_one_end({name: p.value for name, p in self._parameter_overrides.items()})
        plant, state = self._plants.value, settings.initial_state
        if len(state) not in (1, plant.states):
            raise SettingError('initial_state', state, f'a list of 1 or {plant.states} entries')
        if len(state) == 1:
            state = state * plant.states
        self.process = PlantRun(
            plant,
            self._disturbances.value,
            noise.value,
            self.pacing.rate,
            state,
            faults.value,
            added.value,
            sensor,
            settings.input_delay,
            settings.safe_command,
        )
        sensors = settings.measured_derivatives
        if sensors >= plant.order:
            allowed = f'below {plant.order}, the order of the plant'
            raise SettingError('measured_derivatives', sensors, allowed)
        self._started = settings.start == 'at_once'
        self._command = settings.safe_command
        self._age = 0.0
        self._commanded = False
        self._timed_out = False
        self.diverged: float | None = None
        self._faults: list[str] = []
        self._keeps_up = True
        self._bad_commands = 0
        self._timeouts = 0
        self._newest = 0
        self.add_input('command', self._on_command)
        self._acting = nan  # until something does
        self._applied = self.add_output(APPLIED_TOPIC) if settings.report_applied else None
        self._measurement = self.add_output('measurement')
        self._derivatives = [self.add_output(topic) for topic in DERIVATIVES[:sensors]]
        self._output = self.add_output('~/output')
        self._truth = self.add_output('~/total_disturbance')
        if self.lockstep is None:
            self.ticker = Ticker(SharedTimer(self, self.pacing.rate), self.guarded(self.on_timer))

    def begin(self) -> None:
        """Say what runs."""
        settings, held = self._group.value, not (self._started or self.lockstep)
        noise = self.get_parameter('noise_variance').value
        parts = [
            f'{settings.plant} at {self.pacing.rate:g} Hz',
            f'noise variance {noise:g}' if noise else 'no noise',
            f'disturbance {self.get_parameter("disturbance").value}',
        ]
        waiting = f'; held until {self.resolve_topic_name("command")} comes' if held else ''
        self.get_logger().info(', '.join(parts) + waiting)

    def close(self) -> None:
        """Say what ran."""
        super().close()
        if not self.failure:
            end = self.process.k / self.pacing.rate
            self.get_logger().info(f'{end:.6g} s have passed, {self._timeouts} command timeouts')

    # ---- parameters ----

    def _make_settings(self, values: dict[str, Any]) -> PlantSettings:
        """Make settings that also fit the rate."""
        settings = build(PlantSettings, values)
        timeout, shortest = settings.command_timeout, 2.0 * self.pacing.period
        if 0.0 < timeout < shortest:
            allowed = f'0 (off) or at least two periods, {shortest:g} s'
            raise SettingError('command_timeout', timeout, allowed)
        return settings

    def _make_plant(self, values: dict[str, Any]) -> Plant:
        if self.plant_type is not None:
            plant = PLANT.make(self.plant_type, values)
        else:
            settings = self._group.value
            is_file = settings.plant.endswith('.py')
            which = {'file' if is_file else 'name': settings.plant}
            plant = PlantSpec(**which, class_name=settings.plant_class, values=values).make()
        substeps_for(plant, self.pacing.period)  # refuses one that is too fast for the rate
        return plant

    def _make_faults(self, values: dict[str, Any]) -> Faults:
        measurement = build(
            MeasurementFault, without(MEASUREMENT_FAULT, values), MEASUREMENT_FAULT[:-1]
        )
        command = build(CommandFault, without(COMMAND_FAULT, values), COMMAND_FAULT[:-1])
        kinds = ONE_EACH if self.pacing.lockstep else INJECTABLE
        if measurement.kind not in kinds:
            raise SettingError(
                MEASUREMENT_FAULT + 'kind', measurement.kind, 'one of ' + ', '.join(kinds)
            )
        return Faults(measurement=(measurement,), command=(command,))

    def _change(self, _: object) -> None:
        self.process.change(self._plants.value, self._disturbances.value)

    def _change_noise(self, signal: Signal) -> None:
        self.process.noise_signal = signal

    def _change_variance(self, noise: Noise) -> None:
        self.process.change_noise(noise)

    def _inject(self, faults: Faults) -> None:
        self.process.faults.change(faults, self.process.k)

    # ---- samples ----

    def _on_command(self, value: float, _: Info) -> None:
        if not isfinite(value):
            self._bad_commands += 1
            return
        self._command = value
        self._commanded = True
        self._started = True

    def on_timer(self, elapsed: float, periods: int) -> None:
        """
        Let the periods that are due pass under the newest command, and send the sample then.

        One only, if these take the processor longer than they last: they would be ever more.
        """
        self._age = 0.0 if self._commanded else self._age + elapsed
        self._commanded = False
        if self._started:
            command = self._acting_command()
            longest = max(1, round(LONGEST_STALL * self.pacing.rate))
            periods = min(periods, longest) if self._keeps_up else 1
            begin = time.thread_time()
            self._advance(command, periods)
            self._keeps_up = time.thread_time() - begin < periods * self.pacing.period
        self.send_sample()

    def on_samples(self, values: list[float]) -> None:
        """Let a period pass under its command, and send the sample of the next."""
        self._advance(values[0])
        if self.process.k < self.pacing.steps:
            self.send_sample()

    def send_sample(self) -> None:
        """Send what the sensor shows in this period, and the true output."""
        before, self._faults = self._faults, self.process.faults.acting(self.process.k)
        if self._faults != before:  # one began or ended, by itself or as it was asked to
            self.events.tell('fault', ', '.join(self._faults) or 'none', WARN)
        run = self.process
        # Before the measurement: who ticks with that shall have it.
        if self._applied is not None and (self.lockstep is not None or isfinite(self._acting)):
            self._applied.send(self._acting)
        for sample in run.faults.deliver(run.k, run.measurement, still=not self._started):
            # One that a newer one has overtaken reaches no reader: the middleware drops it.
            if sample.number >= self._newest:
                self._newest = sample.number
                self._measurement.send(sample.value)
        for i, sender in enumerate(self._derivatives, 1):
            sender.send(run.measured_derivative(i))
        output = self.process.output
        self._note_divergence(isfinite(output))
        self._output.send(output)

    def _acting_command(self) -> float:
        settings = self._group.value
        timed_out = 0.0 < settings.command_timeout < self._age
        if timed_out != self._timed_out:
            said = 'no command: using the safe command' if timed_out else 'commands again'
            self.events.tell('timeout', said, WARN if timed_out else OK)
        if timed_out and not self._timed_out:
            self._timeouts += 1
            self.get_logger().warning(
                f'no command for {self._age:.3g} s: using the safe command',
                throttle_duration_sec=_LOGGED,
            )
        self._timed_out = timed_out
        return settings.safe_command if timed_out else self._command

    def _advance(self, command: float, periods: int = 1) -> None:
        """Let some periods pass under one command; the truth is that of the first."""
        finite = True
        for i in range(periods):
            self._acting = acting = self.process.faults.act(self.process.k, command)
            reached, acting = self.process.reach(command, acting)
            if i == 0:
                self._truth.send(self.process.total_disturbance(reached, acting))
            finite = self.process.advance(acting)
        self._note_divergence(finite)

    def _note_divergence(self, finite: bool) -> None:
        if finite or self.diverged is not None:
            return
        self.diverged = self.process.k / self.pacing.rate
        self.events.tell('diverged', 'the plant diverged', ERROR)
        self.get_logger().error(
            f'the plant diverged at t = {self.diverged:.6g} s: its output is NaN from here on'
        )

    def report(self) -> Report:
        """Tell whether it runs, and under whose command."""
        values: dict[str, object] = {
            'time': self.process.k / self.pacing.rate,
            'command_timeouts': self._timeouts,
            'commands_not_finite': self._bad_commands,
        }
        if self.diverged is not None:
            return ERROR, 'the plant diverged', values
        if self._timed_out:
            return WARN, 'no command: using the safe command', values
        if not self._keeps_up:
            return WARN, 'slower than real time: this plant is too much for its rate here', values
        running = self._started or self.lockstep is not None
        return OK, 'running' if running else 'waiting for a command', values


def _make_noise(values: dict[str, Any]) -> Noise:
    return build(Noise, {'seed': values['seed'], **without(NOISE, values)})


def _about() -> About:
    own = declared(PlantSettings)
    return About(
        purpose='A simulated plant: takes commands, sends what its sensor measures.',
        topics={
            'command': 'in: from the controller',
            'measurement': 'out: the output with noise and faults',
            '~/output': 'out: the true output',
            '~/total_disturbance': 'out: the true total disturbance, for its own b0',
        },
        parameters={
            'plant': own['plant'],
            'rate': declared(PacingSettings)['rate'],
            'disturbance': DISTURBANCE.fields()['disturbance'],
            'noise_variance': noise_fields()['noise_variance'],
            'command_timeout': own['command_timeout'],
        },
        examples=(
            'ros2 run nadrc_ros plant --ros-args -p disturbance:=sine -p noise_variance:=1.0e-6',
            'ros2 run nadrc_ros plant --ros-args -p plant:=motor -p rate:=1000.0',
        ),
    )


def main() -> int:
    """Run the plant node."""
    return run_command(PlantNode, _about())


if __name__ == '__main__':
    raise SystemExit(main())
