"""What goes wrong with a simulated plant when a page says so: its own parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import attrs
from nadrc_ros.adrc.errors import one_of, UserError
from nadrc_ros.live.outbox import Message
from nadrc_ros.simulation.signals import SIGNALS

_KIND = 'kind'


@attrs.frozen
class PlantFault:
    """
    One button: a parameter that says what, and one that says how much.

    ``switch`` is set to ``kind`` while it acts; ``size`` names the parameter of its number, whose
    default is ``value`` in ``unit``.
    """

    text: str
    switch: str
    kind: str
    size: str = ''
    value: float = 0.0
    unit: str = ''
    low: float = 0.0
    high: float = 0.0


_SENSOR = 'fault.measurement.'
FAULTS = {
    'disturbance': PlantFault(
        'disturbance step, instead of the present disturbance',
        'disturbance', 'constant', 'disturbance_offset', 1.0, 'unit of y^(n)', -1e6, 1e6,
    ),
    'silent': PlantFault('silent sensor', _SENSOR + _KIND, 'silent'),
    'spikes': PlantFault(
        'spikes of the sensor', _SENSOR + _KIND, 'spike', _SENSOR + 'size', 1.0, 'output unit',
        -1e6, 1e6,
    ),
    'delay': PlantFault(
        'late measurements', _SENSOR + _KIND, 'delayed', _SENSOR + 'time', 0.02, 's', 0.001, 10.0
    ),
    'gain': PlantFault(
        'gain of the actuator', 'fault.command.' + _KIND, 'gain', 'fault.command.size', 0.5, '',
        0.01, 100.0,
    ),
}  # fmt: skip


class PlantFaults:
    """The faults of one plant, and what was there before them."""

    def __init__(self) -> None:
        self._before: dict[str, Any] = {}

    def values(
        self, name: str, on: bool, value: float | None, plant: Mapping[str, Any]
    ) -> dict[str, Any]:
        """
        Return the parameters that let a fault begin or end.

        Raises
        ------
        UserError
            For a fault that there is not, or a value that makes no sense.

        """
        possible = [each for each, fault in FAULTS.items() if _is_possible(fault, plant)]
        if name not in possible:
            raise UserError(f'fault: {name[:40]}: must be {one_of(name, possible)}')
        fault = FAULTS[name]
        if not on:
            before = self._before.pop(fault.switch, None)
            usual = 'none' if before in (None, fault.kind) else before
            return {fault.switch: usual} if is_on(fault, plant) else {}
        value = fault.value if value is None else value
        if not (fault.low <= value <= fault.high and (value or not fault.size)):
            raise UserError(f'{name}: {value:g}: from {fault.low:g} to {fault.high:g}, not 0')
        if not is_on(fault, plant):
            self._before[fault.switch] = plant[fault.switch]
        return {fault.switch: fault.kind} | ({fault.size: value} if fault.size else {})


def listed(plant: Mapping[str, Any]) -> list[Message]:
    """Return the faults that a plant with these parameters can have."""
    return [
        {
            'name': name,
            'text': fault.text,
            'on': is_on(fault, plant),
            'value': plant.get(fault.size) if is_on(fault, plant) else fault.value,
            'unit': fault.unit,
            'low': fault.low,
            'high': fault.high,
        }
        for name, fault in FAULTS.items()
        if _is_possible(fault, plant)
    ]


def is_on(fault: PlantFault, plant: Mapping[str, Any]) -> bool:
    """Tell whether a fault acts."""
    return bool(plant.get(fault.switch) == fault.kind)


def _is_possible(fault: PlantFault, plant: Mapping[str, Any]) -> bool:
    """Tell whether it can be switched: a disturbance of the user's own file cannot."""
    now = plant.get(fault.switch)
    return isinstance(now, str) and (fault.switch != 'disturbance' or now in SIGNALS)
