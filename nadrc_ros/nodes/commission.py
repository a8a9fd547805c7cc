"""Commissioning experiments in a controller node, while its loop is open and somebody holds it."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import attrs
from nadrc_ros.adrc.commission.experiment import Experiment
from nadrc_ros.adrc.commission.settings import ExperimentSettings, WITH_CONTROLLER
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.adrc.fields import build
from nadrc_ros.adrc.limiter import limit
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.nodes.lease import Lease, STOPPED, TOPIC
from nadrc_ros.nodes.rivals import Rivals
from nadrc_ros.ros.diagnostics import WARN
from nadrc_ros.ros.experiment_rows import Rows, STAGES
from nadrc_ros.ros.node import LiveNode
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import parameter_value_to_python

START, STOP = '~/commission/start', '~/commission/stop'
# Parameters of the controller that tries begin so.
CANDIDATE = 'controller.'
# So ends a refusal of what may be asked for again soon.
LATER = '; ask again'
# What ends it from outside lets it brake for so long [s].
BRAKE = 0.08


class Commission:
    """
    Runs an :class:`~nadrc_ros.adrc.commission.experiment.Experiment` in the ticks of a node.

    No parameter is changed by it: a controller that tries is another object. However it ends, the
    command then goes to ``safe_command`` at the rate limit, and the node is silent again.

    Attributes
    ----------
    active
        Whether it commands: from the start until the safe command was sent.
    command
        The last one.
    barred
        Why it never may, empty where it may.

    """

    def __init__(
        self, node: LiveNode, controller: Controller, rivals: Rivals, lease: Lease
    ) -> None:
        self.active = False
        self.barred = ''
        self.command = controller.settings.safe_command
        self._node = node
        self._controller = controller
        self._rivals = rivals
        self._lease = lease
        self._experiment: Experiment | None = None
        self._asked: tuple[ExperimentSettings, ControllerSettings | None] | None = None
        self._braking, self._ending = inf, ''  # so much longer may it brake [s], and why it ends
        self._told = self._closed = False
        self._stops = 0
        if node.lockstep is None:
            self._rows = Rows(node, node.pacing.period)
            node.create_service(SetParametersAtomically, START, self._on_start)
            node.add_trigger(STOP, self._on_stop)

    @property
    def silent(self) -> bool:
        """Tell whether its command is not to be sent."""
        return self.active and self._experiment is not None and self._experiment.silent

    # ---- what it is asked for ----

    @property
    def busy(self) -> str:
        """Return why nothing else may be asked for now, nothing if it may."""
        if self._closed:
            return 'the controller is being stopped'
        return f'a commissioning experiment runs: call {STOP} first' if self.active else ''

    def refuse_change(self) -> None:
        """
        Refuse what would change the controller meanwhile.

        Raises
        ------
        UserError
            While an experiment runs.

        """
        if self.active:
            raise UserError(self.busy)

    def report(self) -> dict[str, object]:
        """Return what /diagnostics has of it."""
        stops: dict[str, object] = {'disable_requests': self._stops}
        if not self.active or self._experiment is None:
            return stops
        return stops | {
            'commission': f'{self._experiment.settings.kind}: {self._experiment.stage}'
        }

    def note_switch(self, on: bool) -> None:
        """Note that the loop is enabled or disabled: also between experiments that is a stop."""
        if not on:
            self._stops += 1
            self.end('it was disabled')

    def end(self, reason: str) -> None:
        """End what runs, within the time that it may brake."""
        if self._experiment is not None and self._experiment.over is None:
            if self._braking == inf:
                self._braking, self._ending = BRAKE, reason
            self._experiment.end(reason, brake=True)

    def close(self) -> None:
        """End what runs, and begin nothing any more."""
        self._closed = True
        self.end('the controller is being stopped')

    def _on_stop(self) -> str:
        if not self.active:
            return 'no experiment runs'
        self.end('it was stopped')
        return 'the experiment ends, and the command goes to safe_command'

    def _on_start(self, request: Any, response: Any) -> Any:
        response.result = SetParametersResult(successful=True)
        try:
            self._start({p.name: _value(p) for p in request.parameters})
        except UserError as error:
            response.result = SetParametersResult(successful=False, reason=str(error))
            self._node.events.tell('refused', str(error))
        return response

    def _start(self, given: dict[str, Any]) -> None:
        asked = self._settings(given)
        if self.active and asked == self._asked:  # who got no answer asks again
            return
        self._refuse(asked[0])
        self._experiment, self._asked = Experiment(*asked), asked
        self.command = self._controller.settings.safe_command
        self.active, self._told, self._braking = True, False, inf
        self._rivals.settle(True)
        self._rows.begin()
        text = f'a commissioning experiment begins: {asked[0].kind}'
        self._node.get_logger().info(text)
        self._node.events.tell('commission', text)
        self._node.remarks.hold('commission', 'a commissioning experiment runs', WARN)
        self._node.diagnostics.publish()

    def _settings(
        self, given: dict[str, Any]
    ) -> tuple[ExperimentSettings, ControllerSettings | None]:
        """
        Return what is asked for; what is left out is as in the node, which bounds the rest.

        Raises
        ------
        SettingError
            Names what is refused.

        """
        present = self._controller.settings
        candidate = {
            name.removeprefix(CANDIDATE): value
            for name, value in given.items()
            if name.startswith(CANDIDATE)
        }
        own = {name: value for name, value in given.items() if not name.startswith(CANDIDATE)}
        shared = ('command_min', 'command_max', 'command_rate_limit', 'measurement_period')
        usual = {name: getattr(present, name) for name in shared}
        usual |= {'period': self._node.pacing.period, 'center': present.safe_command}
        settings = build(ExperimentSettings, usual | own)
        for name in ('command_min', 'command_max'):
            value = getattr(settings, name)
            if not present.command_min <= value <= present.command_max:
                limits = f'{present.command_min:g} to {present.command_max:g}'
                raise SettingError(name, value, f'from {limits}, the limits of this controller')
        fastest = present.command_rate_limit
        if fastest > 0.0 and not 0.0 < settings.command_rate_limit <= fastest:
            allowed = f'above 0 and at most {fastest:g}, as of this controller'
            raise SettingError('command_rate_limit', settings.command_rate_limit, allowed)
        if settings.kind not in WITH_CONTROLLER:
            if candidate:
                name, value = next(iter(candidate.items()))
                allowed = f'left out with kind = {settings.kind}, which has no controller'
                raise SettingError(CANDIDATE + name, value, allowed)
            return settings, None
        path = CANDIDATE.rstrip('.')
        tried = build(ControllerSettings, attrs.asdict(present) | candidate, path)
        tried.check_rate(self._node.pacing.rate)
        return settings, tried

    def _refuse(self, settings: ExperimentSettings) -> None:
        """
        Refuse to begin where something else commands, or nobody watches.

        Raises
        ------
        UserError
            Says why, and what to do.

        """
        controller, rivals = self._controller, self._rivals
        age = controller.policy.measurement_age
        silent = 'so far' if age == inf else f'for {age:.3g} s'
        shared = 'share_command is true, and other commands would not be noticed: start without it'
        held = f'nobody holds it: publish a lease on {TOPIC}, as 0.2 every 0.05 s{LATER}'
        for present, reason in (
            (self.barred, self.barred),
            (self.busy, self.busy),
            (controller.enabled, 'the loop is enabled: call ~/enable with false first'),
            (not controller.quiet, f'the command is on its way to safe_command{LATER}'),
            (controller.inner is not None, 'an inner loop takes the command: commission that one'),
            (rivals.shared, shared),
            (rivals.listening, f'other commands are still listened for{LATER}'),
            (rivals.commanding, rivals.refusal()),
            (not self._lease.left, held),
            (not age <= settings.measurement_timeout, f'no valid measurement {silent}{LATER}'),
        ):
            if present:
                raise UserError(reason)

    # ---- while it runs ----

    def report_to(self, told: dict[str, Any]) -> None:
        """Say among what a controller is told what acts now, where nobody else does."""
        if self.active and told.get('applied') is None:
            told.update(applied=self.command, applied_age=0.0)

    def tick(self, measurement: float, dt: float, elapsed: float, stamp: int) -> float:
        """
        Return the command of this tick, of which a sample or nan is given, with its time [ns].

        It is what the experiment asks for, and after that on its way to ``safe_command``.
        """
        experiment, settings = self._experiment, self._controller.settings
        assert experiment is not None
        if not settings.measurement_min <= measurement <= settings.measurement_max:
            measurement, dt = nan, 0.0
        if experiment.over is None:
            self._watch(experiment, elapsed)
        if experiment.over is None:
            self.command = experiment.tick(measurement, dt, elapsed)
        else:
            safe, design = settings.safe_command, self._controller.design
            self.command = limit(design, safe, self.command, elapsed)[0]
        stage = STAGES.index(experiment.stage)
        self._rows.add(elapsed, measurement, stamp, self.command, experiment.excitation, stage)
        if experiment.over is not None:
            self._tell(experiment)
            if self.command == settings.safe_command:
                self.active = False
                self._rows.end(f'{_outcome(experiment)}: {experiment.over}')
        return self.command

    def _watch(self, experiment: Experiment, elapsed: float) -> None:
        """End it where another commands, where nobody holds it, and where it brakes for long."""
        if self._rivals.commanding:
            experiment.end(self._rivals.refusal().partition(':')[0])
        elif self._braking < inf:
            self._braking -= elapsed
            if self._braking <= 0.0:
                experiment.end(self._ending)
        elif not self._lease.left:
            self.end(STOPPED)

    def _tell(self, experiment: Experiment) -> None:
        if self._told:
            return
        self._told = True
        text = f'the commissioning experiment is over ({_outcome(experiment)}): {experiment.over}'
        self._node.get_logger().info(text)
        self._node.events.tell('commission', text)
        self._node.remarks.put('commission', '')
        self._node.diagnostics.publish()


def _outcome(experiment: Experiment) -> str:
    return experiment.outcome.value if experiment.outcome is not None else ''


def _value(parameter: Any) -> Any:
    """
    Return the value of a parameter.

    Raises
    ------
    SettingError
        Where it has no value that there is.

    """
    try:
        value = parameter_value_to_python(parameter.value)
    except RuntimeError:  # of rclpy, for a type that does not exist
        value = None
    if value is None:
        raise SettingError(parameter.name, None, 'a value')
    return value
