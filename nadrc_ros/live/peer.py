"""The controller as its operator reaches it: parameters, enabling, the lease of hold to run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any

from nadrc_ros.ros.topics import Sender
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

Done = Future[Any]
_LISTS = {
    Parameter.Type.DOUBLE_ARRAY.value: float,
    Parameter.Type.INTEGER_ARRAY.value: int,
    Parameter.Type.BOOL_ARRAY.value: bool,
    Parameter.Type.STRING_ARRAY.value: str,
}


class Peer:
    """
    The services of a node that a page uses, each with a client of its own.

    Any thread may ask; answers come by the executor of ``node``.
    """

    def __init__(self, node: Node, name: str) -> None:
        self.name = name
        self._node = node
        self._set = node.create_client(
            SetParametersAtomically, f'{name}/set_parameters_atomically'
        )
        self._describe = node.create_client(DescribeParameters, f'{name}/describe_parameters')

    def set_all(self, values: Mapping[str, Any], types: Mapping[str, int]) -> Done:
        """Set all of the parameters or none, as values of these ROS types."""
        parameters = [
            ParameterMessage(name=name, value=parameter_value(value, types.get(name, 0)))
            for name, value in values.items()
        ]
        return ask(self._set, SetParametersAtomically.Request(parameters=parameters))

    def describe(self, names: list[str]) -> Done:
        """Ask for the descriptors of parameters."""
        return ask(self._describe, DescribeParameters.Request(names=names))

    @property
    def ready(self) -> bool:
        """Tell whether its parameter services are there."""
        return bool(self._set.service_is_ready() and self._describe.service_is_ready())


class ControllerPeer(Peer):
    """A controller, which can be enabled, stopped and kept running."""

    def __init__(self, node: Node, name: str) -> None:
        super().__init__(node, name)
        self._enable = node.create_client(SetBool, f'{name}/enable')
        # What stops waits behind nothing else, not even behind what enables.
        self._stop = node.create_client(SetBool, f'{name}/enable')
        self._keep = Sender(node, f'{name}/keep')

    @property
    def takes_leases(self) -> bool:
        """Tell whether anybody hears the heartbeat."""
        return self._keep.has_readers

    def keep(self, seconds: float) -> None:
        """Let it stay enabled for so long [s]; 0 gives the lease back."""
        self._keep.send(seconds)

    def enable(self) -> Done:
        """Close the loop."""
        return ask(self._enable, SetBool.Request(data=True))

    def stop(self) -> Done:
        """Open the loop: the controller goes to its safe command."""
        return ask(self._stop, SetBool.Request(data=False))


class RecorderPeer(Peer):
    """A recorder, which writes down what it has when it is asked to."""

    def __init__(self, node: Node, name: str) -> None:
        super().__init__(node, name)
        self._save = node.create_client(Trigger, f'{name}/save')

    def save(self) -> Done:
        """Write the summary of the run so far."""
        return ask(self._save, Trigger.Request())


def ask(client: Any, request: Any) -> Done:
    """Send a request; what is returned gets the answer, on the thread of the executor."""
    done: Done = Future()
    done.set_running_or_notify_cancel()
    asked = client.call_async(request)

    def pass_on(future: Any) -> None:
        if not done.done():
            done.set_result(future.result())

    asked.add_done_callback(pass_on)
    return done


def parameter_value(value: Any, kind: int) -> ParameterValue:
    """
    Return a value of JSON, whose 2 may mean 2.0, as one of a ROS type if it can be one.

    Raises
    ------
    ValueError
        For what no parameter can be.

    """
    whole = isinstance(value, float) and value.is_integer()
    if kind == Parameter.Type.DOUBLE.value and _is_number(value):
        value = float(value)
    elif kind == Parameter.Type.INTEGER.value and whole:
        value = int(value)
    elif kind in _LISTS and isinstance(value, list):
        convert: Callable[[Any], Any] = _LISTS[kind]
        numbers = kind in (Parameter.Type.DOUBLE_ARRAY.value, Parameter.Type.INTEGER_ARRAY.value)
        if not numbers or all(map(_is_number, value)):
            value = [convert(each) for each in value]
    try:
        found: ParameterValue = Parameter('it', value=value).get_parameter_value()
    except (TypeError, AssertionError, OverflowError) as error:
        raise ValueError(str(error)) from None
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
