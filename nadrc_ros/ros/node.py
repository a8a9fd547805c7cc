"""What the nodes of a loop have in common: how they are made, paced, connected and end."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
import os
from typing import Any, ClassVar, TypeVar

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import build, declared
from nadrc_ros.ros.arguments import overrides, own_rules, refuse_unheard, tell_unused
from nadrc_ros.ros.diagnostics import Diagnostics, Events, OK, Remarks, Report
from nadrc_ros.ros.graph import InputWatch, Namesakes
from nadrc_ros.ros.lockstep import Lockstep
from nadrc_ros.ros.neighbors import Neighbors
from nadrc_ros.ros.pacing import PacingSettings, Ticker
from nadrc_ros.ros.parameters import (
    ParameterGroup,
    refuse_unknown,
    refuse_unknown_types,
    set_atomically,
)
from nadrc_ros.ros.topics import Input, Receive, receive, Sender
from nadrc_ros.ros.wall_clock import WallClock
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

T = TypeVar('T')


class LiveNode(Node):
    """
    A node that can finish by itself, fail with a message, and stop in an orderly way.

    Any number of them may share a process and an executor; a constructor touches nothing that
    belongs to the process, and one that raises leaves nothing behind.

    Parameters
    ----------
    parameters : mapping
        Values at the start, by name; a wrong one is refused as one in a parameter file is.
    namespace, node_name
        Where it is on the graph, if not in ``/`` and under its usual name.
    context
        Of the ROS context, the default one where it is None.
    remappings
        Names of topics and services to use instead of its own ones.
    arguments
        The command line of the process, where a parameter file in it has to be for this node.
        What else it says is known to the context; what is given here wins over it.

    Raises
    ------
    SettingError
        For a parameter or a name that is refused.

    """

    default_name: ClassVar[str]
    # Namespaces of the nodes that share the command line with this one and are made in turn.
    axes: Sequence[str] = ()
    # Of all nodes of the process, those that are still being made included.
    told_to_stop: ClassVar[bool] = False
    # Where there is a timer; in lockstep there is none.
    ticker: Ticker | None = None

    def __init__(
        self,
        *,
        parameters: Mapping[str, Any] | None = None,
        namespace: str = '',
        node_name: str = '',
        context: Context | None = None,
        remappings: Mapping[str, str] | None = None,
        arguments: Sequence[str] = (),
    ) -> None:
        super().__init__(
            self.default_name,
            context=context,
            cli_args=own_rules(namespace, node_name, remappings or {}),
            parameter_overrides=overrides(parameters or {}),
        )
        self.finished = False
        self.failure = ''
        self.scheduling = 'not asked for'
        self.inputs: list[Input] = []
        # Topics of another node of the process that are ours too, each with a dot behind.
        self.shared: set[str] = set()
        try:
            if arguments:
                refuse_unheard(self, self.default_name, arguments, self.axes)
            self.events = Events(self)
            self.remarks = Remarks(self.get_logger(), event=self.events.tell)
            # Called once per second.
            neighbors = Neighbors(self, self.remarks)
            self.checks: list[Callable[[], None]] = [
                Namesakes(self, self.remarks).look,
                neighbors.look,
                WallClock(self.remarks).look,
            ]
            self.pacing = self.declare(PacingSettings)
            self.lockstep: Lockstep | None = None
            if self.pacing.lockstep:
                fire, start = self.guarded(self.on_samples), self.guarded(self.send_sample)
                self.lockstep = Lockstep(self, self.pacing, fire, start)
            refuse_unknown_types(self)
            self.set_up()
            spaces = set(self.axes) - {self.get_namespace()}
            refuse_unknown(self, {f'{space}/' for space in spaces} | self.shared)
            if not self.axes:
                self.pacing.check_length()
            self.begin()
            if not self.pacing.lockstep:
                watch = InputWatch(
                    self, self.inputs, self.remarks, self.pacing.period, unseen=neighbors.unseen
                )
                self.checks.append(watch.look)
            self.diagnostics = Diagnostics(self, self._full_report)
            tell_unused([self], [f'{old}:={new}' for old, new in (remappings or {}).items()])
        except BaseException:
            self.destroy_node()
            raise

    # ---- what a kind of node is ----

    def set_up(self) -> None:
        """Declare the other parameters and make all that the node consists of, but for files."""

    def begin(self) -> None:
        """Make files: last, as a node that fails to start should leave none behind."""

    def on_timer(self, elapsed: float, periods: int) -> None:
        """Do one period in real time, ``elapsed`` [s] and so many after the last one."""

    def send_sample(self) -> None:
        """Send the sample of this period; lockstep begins with that."""

    def on_samples(self, values: list[float]) -> None:
        """Do one period in lockstep, with a sample of each input."""

    def report(self) -> Report:
        """Return level, message and values for /diagnostics."""
        return OK, 'running', {}

    def begin_stop(self) -> None:
        """Start to stop; the executor goes on until ``stopped``, but not for long."""

    @property
    def stopped(self) -> bool:
        """Tell whether nothing is left to be done by callbacks."""
        return True

    def close(self) -> None:
        """Do what is left, without callbacks: the last command, the last file."""
        if self.lockstep is not None:
            self.lockstep.flush()

    def await_delivery(self, seconds: float) -> None:
        """Wait, but not for longer, until what ``close`` sent has arrived."""

    # ---- what it is made of ----

    def declare(self, cls: type[T]) -> T:
        """Declare the fields of a class of settings as parameters, and return their values."""
        return ParameterGroup(self, declared(cls), partial(build, cls)).value

    def add_input(self, topic: str, take: Receive, **more: Any) -> None:
        """Have ``take`` called with each sample; in lockstep they come to ``on_samples``."""
        if self.lockstep is None:
            self.inputs.append(receive(self, topic, take, **more))
        else:
            self.lockstep.add_input(topic)

    def add_output(self, topic: str) -> Sender:
        """Return what sends on a topic, as the pacing asks for."""
        return Sender(self, topic) if self.lockstep is None else self.lockstep.add_output(topic)

    def add_trigger(self, service: str, work: Callable[[], str]) -> None:
        """Offer a service whose ``work`` returns what to answer, or raises why it cannot be."""

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message, response.success = work(), True
            except UserError as error:
                response.message = str(error)
            return response

        self.create_service(Trigger, service, answer)

    def add_switch(self, service: str, work: Callable[[bool], tuple[bool, str]]) -> None:
        """Offer a service that switches; ``work`` returns whether it could, and what to answer."""

        def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            response.success, response.message = work(request.data)
            return response

        self.create_service(SetBool, service, answer)

    def guarded(self, work: Callable[..., None]) -> Callable[..., None]:
        """
        Return ``work``, ending the node in one sentence where code of the user's in it fails.

        That code is in files that parameters name. An exception must not leave a callback for
        that, as the EventsExecutor prints all of its traceback.
        """

        def guard(*arguments: Any) -> None:
            if self.failure:  # and what failed may not go on until the process ends
                return
            try:
                work(*arguments)
            except Exception:
                values = [p.value for p in self._parameters.values()]
                files = [v for v in values if isinstance(v, str) and v.endswith('.py')]
                if not files:
                    raise
                from nadrc_ros.scenario.user_code import blame

                try:
                    with blame(*map(os.path.abspath, files)):
                        raise
                except UserError as error:
                    self.fail(str(error))

        return guard

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Set all or none; what is refused is always named."""
        result = set_atomically(self, parameter_list, super().set_parameters_atomically)
        if not result.successful:
            self.events.tell('refused', result.reason)
        return result

    def fail(self, message: str) -> None:
        """End the process with exit code 1 and this message."""
        if not self.failure:
            self.failure = message
            self.get_logger().error(message)
        self.finished = True

    def _full_report(self) -> Report:
        level, message, values = self.report()
        more: dict[str, object] = {'scheduling': self.scheduling}
        if self.ticker is not None:
            more |= {'periods': self.ticker.periods, 'missed_periods': self.ticker.missed}
        return level, message, {**values, **more}
