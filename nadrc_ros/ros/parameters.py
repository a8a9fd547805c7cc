"""Declared settings as ROS parameters: validated as a merged set, refused with a reason."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from nadrc_ros.adrc.errors import did_you_mean, SettingError, UserError
from nadrc_ros.adrc.fields import Declared
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

T = TypeVar('T')

_TYPES = {
    'number': Parameter.Type.DOUBLE,
    'integer': Parameter.Type.INTEGER,
    'numbers': Parameter.Type.DOUBLE_ARRAY,
    'choice': Parameter.Type.STRING,
    'text': Parameter.Type.STRING,
    'flag': Parameter.Type.BOOL,
}
# Parameters that rclpy itself brings to every node.
_QOS = 'qos_overrides.'
_FOREIGN = ('use_sim_time', _QOS, 'start_type_description_service')


class ParameterGroup(Generic[T]):
    """
    Some parameters of a node, by what is known of each, that together make one validated object.

    ``make`` makes the object from all values, or raises :class:`SettingError` for a set that it
    refuses, at the start too; ``on_change`` is called with the new object after a change.
    """

    def __init__(
        self,
        node: Node,
        fields: Mapping[str, Declared],
        make: Callable[[dict[str, Any]], T],
        on_change: Callable[[T], None] | None = None,
    ) -> None:
        self._make = make
        self._on_change = on_change
        self._values = {name: _declare(node, name, field) for name, field in fields.items()}
        self.value: T = make(dict(self._values))
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._commit)

    def _check(self, parameters: Iterable[Parameter]) -> SetParametersResult:
        """Judge the merged set and change nothing; what is not of this group is not looked at."""
        changes = {p.name: p.value for p in parameters if p.name in self._values}
        try:
            if changes:
                self._make({**self._values, **changes})
        except UserError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _commit(self, parameters: Iterable[Parameter]) -> None:
        changes = {p.name: p.value for p in parameters if p.name in self._values}
        if not changes:
            return
        self._values.update(changes)
        self.value = self._make(dict(self._values))
        if self._on_change is not None:
            self._on_change(self.value)


def set_atomically(
    node: Node,
    parameters: list[Parameter],
    proceed: Callable[[list[Parameter]], SetParametersResult],
) -> SetParametersResult:
    """
    Set all parameters or none, naming what is refused where rclpy, which proceeds, does not.

    That is a parameter that is not there, one of a wrong type, and another clock than the one that
    timers and stamps were made for.
    """
    for p in parameters:
        allowed = ''
        if not node.has_parameter(p.name):
            allowed = _known(node, p.name)
        elif p.name == 'use_sim_time' and p.value != node.get_parameter(p.name).value:
            allowed = f'{node.get_parameter(p.name).value}: it is fixed at start'
        if allowed:
            error = SettingError(p.name, p.value, allowed)
            return SetParametersResult(successful=False, reason=str(error))
    result = proceed(parameters)
    for p in parameters:
        if p.name in result.reason:
            break
        kind = node.describe_parameter(p.name).type
        if p.type_.value != kind:
            result.reason = f'{p.name}: {result.reason}{_written(p, kind)}'
            break
    return result


@contextmanager
def written_to(name: str, path: str, allowed: str) -> Iterator[Path]:
    """
    Give the path that a parameter names, ``~`` expanded, to make something there.

    Raises
    ------
    SettingError
        When that cannot be: names the parameter, and the reason.

    """
    try:
        yield Path(path).expanduser()
    except (OSError, RuntimeError) as error:  # the latter of a home that nobody has
        reason = error.strerror if isinstance(error, OSError) else error
        raise SettingError(name, path, f'{allowed} ({reason})') from None


def refuse_unknown_types(node: Node) -> None:
    """Refuse requests to set a value of a type that does not exist; rclpy would end the node."""
    for service in node.services:
        if service.srv_type in (SetParameters, SetParametersAtomically):
            service.callback = partial(_set_known_types, service.callback)


def _set_known_types(callback: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
    known = {kind.value for kind in Parameter.Type}
    for p in request.parameters:
        if p.value.type not in known:
            reason = f'{p.name}: {p.value.type} is not a type of parameters'
            refusal = SetParametersResult(successful=False, reason=reason)
            if isinstance(response, SetParametersAtomically.Response):
                response.result = refusal
            else:
                response.results = [refusal] * len(request.parameters)
            return response
    return callback(request, response)


def refuse_unknown(node: Node, elsewhere: Iterable[str] = ()) -> None:
    """
    Refuse a parameter that was given at start but that the node does not have.

    To be called when the topics are there, as each brings the parameters of its QoS. Those of
    topics that begin as ``elsewhere`` says are of other nodes of the process, and those of any
    topic that ask for what is so anyway do no harm: a dump has them, with the names of its topics.

    Raises
    ------
    SettingError
        Names the parameter and the closest known one: a misspelt limit must not go unnoticed.

    """
    passed = _FOREIGN[0], _FOREIGN[2], *(f'{_QOS}{begin}' for begin in elsewhere)
    for name, parameter in node._parameter_overrides.items():
        if node.has_parameter(name) or name.startswith(passed):
            continue
        if not _is_so_anyway(node, name, parameter.value):
            raise SettingError(name, parameter.value, _known(node, name))


def _is_so_anyway(node: Node, name: str, value: Any) -> bool:
    """Tell whether a policy of QoS is what our topics of that kind have."""
    kind = '.'.join(['', *name.split('.')[-2:]])
    own = [n for n in node._parameters if n.startswith(_QOS) and n.endswith(kind)]
    values = {node.get_parameter(n).value for n in own}
    return name.startswith(_QOS) and values == {value}


def _known(node: Node, name: str) -> str:
    qos = name.startswith(_QOS)
    known = sorted(n for n in node._parameters if n.startswith(_QOS if qos else _FOREIGN) == qos)
    return (
        f'a parameter of {node.get_name()}: {did_you_mean(name, known)}' if known else 'left out'
    )


def _declare(node: Node, name: str, field: Declared) -> Any:
    """Declare a parameter and return its value; rclpy's own refusal does not say what may be."""
    try:
        return node.declare_parameter(name, _default(field), _describe(field)).value
    except ParameterAlreadyDeclaredException:
        allowed = f'called otherwise: {node.get_name()} has a parameter of this name already'
        raise SettingError(name, field.default, allowed) from None
    except (InvalidParameterTypeException, InvalidParameterValueException):
        given = node._parameter_overrides[name]
        allowed = field.allowed() + _written(given, _TYPES[field.kind].value)
        raise SettingError(name, given.value, allowed) from None


def _written(given: Parameter, kind: int) -> str:
    """Return how to write numbers of the wrong type, as 2 for 2.0, for a parameter of a kind."""
    value = given.value
    if kind == Parameter.Type.DOUBLE.value and given.type_ == Parameter.Type.INTEGER:
        return f': write {float(value)!r}'
    if kind == Parameter.Type.DOUBLE_ARRAY.value:
        if given.type_ == Parameter.Type.INTEGER_ARRAY:
            return f': write {[float(item) for item in value]}'
        if given.type_ in (Parameter.Type.INTEGER, Parameter.Type.DOUBLE):
            return f': write {[float(value)]}'
    return ''


def _default(field: Declared) -> Any:
    return list(field.default) if field.kind == 'numbers' else field.default


def _describe(field: Declared) -> ParameterDescriptor:
    unit = f' [{field.unit}]' if field.unit else ''
    descriptor = ParameterDescriptor(
        type=_TYPES[field.kind].value,
        description=field.description + unit,
        additional_constraints=field.allowed(),
        read_only=not field.live,
    )
    low, high = field.low, field.high
    if low is None or high is None:
        return descriptor
    if field.kind == 'number':
        floats = FloatingPointRange(from_value=low, to_value=high, step=0.0)
        descriptor.floating_point_range = [floats]
    elif field.kind == 'integer':
        integers = IntegerRange(from_value=int(low), to_value=int(high), step=1)
        descriptor.integer_range = [integers]
    return descriptor
