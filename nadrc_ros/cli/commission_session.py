"""The five steps of `nadrc commission`, with somebody who answers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TYPE_CHECKING

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.atomic import write_whole
from nadrc_ros.cli.commission_dialog import Dialog
from nadrc_ros.cli.messages import say, warning
from nadrc_ros.cli.progress import progress
from nadrc_ros.scenario.parameter_files import ANY_CONTROLLER, parameter_text
from nadrc_ros.tuning.commission import steps
from nadrc_ros.tuning.commission.silence import judge_silence, planned
import numpy as np
import typer

if TYPE_CHECKING:
    from nadrc_ros.adrc.commission.settings import ExperimentSettings
    from nadrc_ros.commission.graph_machine import GraphMachine
    from nadrc_ros.commission.rehearsal import Rehearsal
    from nadrc_ros.tuning.commission.say import Finding

# The proposed largest command, as a share of its range.
_SHARE = 0.05
# What a parameter file of a node need not say.
_NOT_OURS = ('qos_overrides.', 'use_sim_time', 'start_type_description_service')
# A step up in speed, in times of the fastest settling time that is sound.
_FASTER = 1.4
_NO_TIMEOUT = (
    'If the controller dies, the last command stays: give the actuator a timeout of its own '
    'before it runs without you beside it.'
)
# A closed loop is watched for so long [s].
_HELD = 3.0


class Session(Dialog):
    """The five steps with somebody who answers, and what the report has of them."""

    def __init__(
        self,
        machine: GraphMachine,
        out: Path,
        file: Path,
        yes: bool,
        rehearsal: Rehearsal | None,
    ) -> None:
        super().__init__(out, yes)
        self.machine = machine
        self.actuator_timeout: float | None = None
        self.started = False  # the controller, by this program: it ends with it
        self._file = file
        self._rehearsal = rehearsal

    def go(self, asked: dict[str, float | None]) -> None:
        """Do the steps, as far as they go."""
        machine = self.machine
        self._begin()
        base = self._bounds(asked)
        self._say('1 of 5: look', 'For 2 s the output is watched, and nothing is sent.')
        seen = steps.look(machine)
        if not self._note('Look', seen, (seen.samples,)):
            return
        self._actuator()
        nudging = (
            'Short pulses, growing from almost nothing, go up and down until the output moves: '
            'that shows which way it goes, and how much it needs to start.'
        )
        if not self._ask('2 of 5: nudge', nudging, 'Send these pulses?'):
            return
        nudged = self._until_back(
            self._shown('nudging', base.longest)(
                lambda before: steps.nudge(machine, base, seen, before)
            )
        )
        if not self._note('Nudge', nudged, nudged.samples):
            return
        exciting = (
            'Pulses to and fro, sized so that the output stays inside its bounds, until b0 is '
            f'known to 10 %; at most {base.longest:g} s.'
        )
        if not self._ask('3 of 5: excite', exciting, 'Send them?'):
            return
        excited = self._until_back(
            self._shown('exciting', base.longest)(
                lambda before: steps.excite(machine, base, seen, nudged, before)
            )
        )
        if not self._note('Excite', excited, excited.samples):
            return
        self._fall_silent(base, seen, excited.fitted.model)
        self._say('4 of 5: say', 'What this machine is, and what a controller of it would be.')
        finding = steps.say(machine, base, seen, excited)
        if not self._note('Say', finding, ()):
            return
        self._show(finding)
        if self._try(base, seen, excited, finding):
            self._truth(finding)

    def _try(self, base: ExperimentSettings, seen: Any, excited: Any, finding: Any) -> bool:
        """Try what was found, faster if wanted, and accept it; return whether it was."""
        trying = (
            f'A controller with these values takes over, moves the output by {finding.step:.3g} '
            'and back, and is compared with the prediction. If it does worse, it is over at once. '
            'The parameters of the node stay as they are.'
        )
        if not self._ask('5 of 5: try', trying, 'Try them?'):
            return False
        trial = self._until_back(
            self._shown('trying', base.longest)(
                lambda _: steps.attempt(self.machine, base, seen, finding)
            )
        )
        if not self._note('Try', trial, (trial.samples,)):
            return False
        faster = steps.say(self.machine, base, seen, excited, slower=_FASTER)
        if not faster.refusal and faster.settling_time < 0.95 * finding.settling_time:
            text = (
                f'Margins and noise allow a settling time of {faster.settling_time:.3g} s instead '
                f'of {finding.settling_time:.3g} s.'
            )
            if self._ask('5 of 5: try, faster', text, 'Try that as well?'):
                with self._shown('trying', base.longest):
                    quick = steps.attempt(self.machine, base, seen, faster)
                if self._note('Try, faster', quick, (quick.samples,), refuse=False):
                    finding = faster
                    self._show(finding)
        return self._accept(finding)

    @contextmanager
    def _shown(self, what: str, longest: float) -> Iterator[None]:
        """Show how far the experiments of a step are."""
        with progress(what, longest, unit='s') as tell:
            self.machine.progress = lambda seconds: tell(seconds, '')
            yield
            self.machine.progress = lambda seconds: None

    def _begin(self) -> None:

        machine = self.machine
        topics = machine.topics
        say(
            f'{machine.name}: {machine.rate:g} Hz, measurement {topics["measurement"]}, '
            f'command {topics["command"]} within {machine.present.command_min:g} to '
            f'{machine.present.command_max:g}.'
        )
        say(
            'Keep an emergency stop within reach: this program is none. Ctrl-C ends any step; '
            'the machine then goes to its safe command.'
        )
        if machine.enabled:
            raise UserError(f'{machine.name} is enabled: call {machine.name}/enable with false')
        sensors = machine.sensors
        if len(sensors) > 1:  # two machines in one record, which is that of none
            raise UserError(
                f'{topics["measurement"]} has {len(sensors)} publishers, {", ".join(sensors)}: '
                'stop all but one'
            )
        for writer in machine.writers:
            warning(f'{writer} can command too: experiments end as soon as it does')

    def _bounds(self, asked: dict[str, float | None]) -> ExperimentSettings:

        present = self.machine.present
        usual = _SHARE * (present.command_max - present.command_min)
        center = asked.get('center')
        center = present.safe_command if center is None else center
        questions = {
            'max_command': f'How far may the command go from {center:g}? (command unit)',
            'travel': 'How far may the output go from where it is now? (output unit)',
            'speed': 'How fast may it move? (output unit per second)',
        }
        given: dict[str, Any] = {name: x for name, x in asked.items() if x is not None}
        for name, question in questions.items():
            if name not in given:
                given[name] = self._number(
                    name, question, usual if name == 'max_command' else None
                )
        return steps.bounds(self.machine, **given)

    def _actuator(self) -> None:
        """Ask what the actuator does when nobody commands."""
        if self.actuator_timeout:
            text = (
                f'The actuator is said to stop {self.actuator_timeout:g} s after the last '
                'command: that is tested after step 3.'
            )
        elif not self._somebody:
            text = 'Nobody said whether the actuator has a timeout of its own.'
        elif typer.confirm('Does the actuator stop by itself without commands?', default=False):
            text = 'The actuator is said to have a timeout of its own.'
            asked = 'Within how many seconds? That is tested after step 3, if it is not 0'
            self.actuator_timeout = typer.prompt(asked, default=0.0, type=float)
        else:
            text = _NO_TIMEOUT
            warning(text)
        self._record('Actuator', [text])

    def _fall_silent(self, base: ExperimentSettings, seen: Any, model: Any) -> None:
        """Test whether the actuator stops by itself, if its owner said after which time."""
        if not (timeout := self.actuator_timeout):
            return
        settings = planned(base, seen, model, timeout)
        if settings is None:
            text = 'Inside these bounds nobody could see whether the actuator stops by itself.'
            warning(text)
            self._record('Actuator', [text])
            return
        text = (
            f'A pulse of {settings.amplitude:.3g} for {settings.segment:.2g} s, after which '
            f'nothing is sent for {settings.silence:.2g} s, as if the controller had died: does '
            'the actuator stop? The bounds hold: at one of them commands come again.'
        )
        if not self._ask('3 of 5: fall silent', text, 'Fall silent?', needed=False):
            return
        with self._shown('silent', settings.longest):
            silence = judge_silence(self.machine.run(settings), settings, model, timeout)
        self._note('Fall silent', silence, silence.samples)
        if not silence.stops:
            warning(_NO_TIMEOUT)

    def _show(self, finding: Finding) -> None:
        """Show what would change."""
        changed = [
            f'{name}: {_text(now)} -> {_text(new)}'
            for name, (now, new) in finding.difference.items()
        ]
        say('Parameters that would change:')
        for line in changed:
            typer.echo(f'  {line}')
        self._record('Parameters', changed)

    def _accept(self, finding: Finding) -> bool:
        """Write what was found, if it is accepted, then let the node have it."""
        text = f'They are written to {self._file} first, then set on the node.'
        if not self._ask('5 of 5: accept', text, 'Accept these parameters?'):
            return False
        new = {name: after for name, (_, after) in finding.difference.items()}
        whole = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in {**self.machine.values, **new}.items()
            if not name.startswith(_NOT_OURS) and value is not None
        }
        self._file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self._file, parameter_text({ANY_CONTROLLER: _typed(whole)}).encode())
        say(f'Written: {self._file}')
        self.changed = True
        known = declared(ControllerSettings)
        fixed = [name for name in new if not known[name].live]
        if fixed and self._rehearsal is not None:
            self._rehearsal.restart(_typed(whole))
            say(f'The controller was started with that file, as {fixed[0]} is fixed at start.')
        elif fixed:
            if not self.started:
                say(
                    f'{" and ".join(fixed)} cannot change while the node runs: start it with '
                    f'--ros-args --params-file {self._file}'
                )
        elif refusal := self.machine.set_all(new):
            raise _refused(refusal)
        self._record('Accepted', [f'Written to {self._file.name}.'])
        if self.started:
            say('The controller that this program started ends with it. Start one with the file:')
            typer.echo('  python -m nadrc_ros.nodes.controller --ros-args \\')
            typer.echo(f'    --params-file {self._file}')
        elif not fixed or self._rehearsal is not None:
            self._close()
        return True

    def _close(self) -> None:
        """Close the loop if that is wanted, and say how it holds the output."""
        name = self.machine.name
        wanted = self._rehearsal is not None
        if not self._yes:
            wanted = typer.confirm('Close the loop now, to hold the output where it is?')
        if not wanted:
            say(f'{name} has them now, and its loop is open. To close it:')
            typer.echo(f'  ros2 service call {name}/enable std_srvs/srv/SetBool')
            typer.echo("    '{data: true}'")
            return
        done, said = self.machine.enable()
        if not done:
            raise UserError(f'{name} cannot be enabled: {said}')
        seen = self.machine.listen(_HELD)
        held = seen.measurement[len(seen.measurement) // 2 :]
        middle = float(np.median(held)) if held.size else float('nan')
        off = float(np.max(np.abs(held - middle), initial=0.0))
        line = f'The loop is closed: the output stays at {middle:.4g}, within {off:.2g}.'
        say(line)
        self._record('Closed', [line], (seen,))

    def _truth(self, finding: Finding) -> None:
        """Show in a rehearsal what the plant is."""
        if self._rehearsal is None:
            return
        truth, order = self._rehearsal.truth, finding.model.order
        slow = sorted(1.0 / abs(pole) for pole in truth.poles if pole != 0.0)
        as_found = truth.b0_of(order)
        held = 'inside' if finding.b0.low <= as_found <= finding.b0.high else 'outside'
        lines = [
            f'b0 {as_found:.4g} as a machine of order {order}: {held} {finding.b0.low:.4g} to '
            f'{finding.b0.high:.4g}',
            f'by its name order {truth.order}, b0 {truth.b0:.4g}; time constants '
            f'{", ".join(f"{each:.3g} s" for each in slow) or "none"}',
            f'dead time {1e3 * truth.delay:.3g} ms beside that of the nodes, found '
            f'{1e3 * finding.model.delay:.3g} ms',
            f'noise {truth.noise:.3g}, found {finding.noise:.3g}',
        ]
        typer.echo('')
        say('The truth of this rehearsal:')
        for line in lines:
            typer.echo(f'  {line}')
        self._record('Truth', lines)


def _refused(reason: str) -> Exception:

    return UserError(f'the node refuses them, and keeps what it has: {reason}')


def _text(value: Any) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)


def _typed(values: dict[str, Any]) -> dict[str, Any]:
    """Return values as YAML can have them: arrays of ROS as lists."""
    plain = (bool, int, float, str)
    return {k: v if isinstance(v, plain) else list(v) for k, v in values.items()}
