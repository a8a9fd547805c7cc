"""Which plant a plant node simulates, with what noise and faults: its parameters."""

from __future__ import annotations

import attrs
from nadrc_ros.adrc.fields import choice, Declared, declared, flag, integer, number, numbers, text
from nadrc_ros.adrc.settings import HIGHEST, LONGEST, LOWEST
from nadrc_ros.ros.signal_parameters import behind
from nadrc_ros.simulation.faults import CommandFault, MEASUREMENT_KINDS, MeasurementFault
from nadrc_ros.simulation.noise import Noise

NOISE = 'noise_'
MEASUREMENT_FAULT = 'fault.measurement.'
COMMAND_FAULT = 'fault.command.'
# The stamps of samples are the middleware's.
INJECTABLE = ('none', *(kind for kind in MEASUREMENT_KINDS if kind != 'clock_jump'))
# Where the sensors of derivatives send.
DERIVATIVES = ('measurement/rate', 'measurement/acceleration')


@attrs.frozen(kw_only=True)
class PlantSettings:
    """Which plant runs, from where, and what it does without commands."""

    plant: str = text(
        'paper', 'registered plant (paper, chain, motor, ...) or path of a Python file', live=False
    )
    plant_class: str = text('', 'class in that file, where it has several', live=False)
    initial_state: tuple[float, ...] = numbers(
        (0.0,),
        LOWEST,
        HIGHEST,
        '',
        'x(0): one entry for all states, or one for each',
        live=False,
    )
    start: str = choice(
        'on_command',
        ('on_command', 'at_once'),
        'whether x(0) is held until the first command',
        live=False,
    )
    input_delay: float = number(
        0.0, 0.0, LONGEST, 's', 'dead time: from a command until it acts', live=False
    )
    measured_derivatives: int = integer(
        0,
        0,
        len(DERIVATIVES),
        'derivatives of the output that have a sensor too: 1 = measurement/rate, 2 = also '
        'measurement/acceleration; below the order of the plant',
        live=False,
    )
    command_timeout: float = number(
        0.25,
        0.0,
        LONGEST,
        's',
        'silence of commands that makes the plant use safe_command; 0 = off',
    )
    safe_command: float = number(
        0.0, LOWEST, HIGHEST, 'command unit', 'command the plant uses while none comes'
    )
    report_applied: bool = flag(
        False,
        'whether the command after the faults of the actuator is sent on applied',
        live=False,
    )


def noise_fields() -> dict[str, Declared]:
    """Return the parameters of the noise: its fields with a prefix, but for the seed."""
    fields = behind(NOISE, declared(Noise))
    return {'seed' if name == NOISE + 'seed' else name: f for name, f in fields.items()}


def fault_fields() -> dict[str, Declared]:
    """Return the parameters of the faults."""
    fields = behind(MEASUREMENT_FAULT, declared(MeasurementFault))
    kind = MEASUREMENT_FAULT + 'kind'
    fields[kind] = attrs.evolve(fields[kind], choices=INJECTABLE)
    return fields | behind(COMMAND_FAULT, declared(CommandFault))
