"""Random requests, well formed for ROS and nonsense for a node: all kinds a seed can think of."""

from __future__ import annotations

from math import inf, nan
from random import Random
import struct
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

NUMBERS = (nan, inf, -inf, 1e308, -1e308, 5e-324, -0.0, 0.0, 1.0, -1.0, 1e15, 2.0**63)
NAMES = ('', ' ', '.', 'b0.', 'B0', 'ü\n\x01', '~/b0', '/b0', 'x' * 20_000, 'rate ', 'use_sim_tim')
STRINGS = ('', 'nan', 'nested', '/', '\n' * 50, 'ü' * 300, 'y' * 100_000, '1.0', '{}', '%s')
KINDS = {
    'set_parameters': SetParameters,
    'set_parameters_atomically': SetParametersAtomically,
    'get_parameters': GetParameters,
    'get_parameter_types': GetParameterTypes,
    'describe_parameters': DescribeParameters,
    'list_parameters': ListParameters,
}
TYPES = [code for name, code in vars(ParameterType).items() if name.startswith('PARAMETER_')]


def number(random: Random) -> float:
    """Return a number: special, plausible, or any 64 bits."""
    (bits,) = struct.unpack('d', random.randbytes(8))
    return random.choice((random.choice(NUMBERS), random.uniform(-50.0, 50.0), float(bits)))


def parameter(random: Random, name: str, shown: Any) -> Any:
    """Return a change to a value of any type, unknown ones included, or of the type it has."""
    count = random.choice((0, 1, 2, 3, 500))
    fitting = Parameter.Type.from_parameter_value(shown).value
    kind = fitting if random.random() < 0.6 else random.choice((*TYPES, 10, 99, 255))
    value = ParameterValue(type=kind)
    value.bool_value = random.random() < 0.5
    value.integer_value = random.choice((0, 1, 3, -1, 2**63 - 1, -(2**63)))
    value.double_value = number(random)
    value.string_value = random.choice(STRINGS)
    value.byte_array_value = [random.randbytes(1) for _ in range(count)]
    value.bool_array_value = [True] * count
    value.integer_array_value = [random.randint(-9, 9) for _ in range(count)]
    value.double_array_value = [number(random) for _ in range(count)]
    value.string_array_value = [random.choice(STRINGS[:4]) for _ in range(count)]
    return ParameterMessage(name=name, value=value)


def request(random: Random, shown: dict[str, Any]) -> tuple[str, Any, Any]:
    """Return service, type and request to the parameters of a node that shows these."""

    def some() -> list[str]:
        known = random.random() < 0.8
        return random.choices(list(shown) if known else NAMES, k=random.randint(0, 3))

    service = random.choice(('set_parameters', 'set_parameters', *KINDS))
    kind = KINDS[service]
    if service.startswith('set'):
        changes = [parameter(random, name, shown.get(name)) for name in some()]
        return service, kind, kind.Request(parameters=changes)
    if service == 'list_parameters':
        depth = random.choice((0, 1, 2**64 - 1))
        return service, kind, kind.Request(prefixes=some(), depth=depth)
    return service, kind, kind.Request(names=some())


def operation(random: Random, node: str) -> tuple[str, Any, Any]:
    """Return a call of a service of the controller or the recorder that is its own."""
    if node == 'recorder':
        return random.choice(('save', 'save', 'save', 'reset')), Trigger, Trigger.Request()
    if random.random() < 0.2:
        return 'reset', Trigger, Trigger.Request()
    return 'enable', SetBool, SetBool.Request(data=random.random() < 0.8)
