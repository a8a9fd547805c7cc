"""The settings of one commissioning experiment: what is sent, and the bounds that end it."""

from __future__ import annotations

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import choice, flag, integer, number, numbers
from nadrc_ros.adrc.settings import HIGHEST, LEAST, LONGEST, LOWEST, SLOWEST_RATE

KINDS = ('staircase', 'doublet', 'silence', 'closed', 'step')
# With a controller in the loop.
WITH_CONTROLLER = ('closed', 'step')


@attrs.frozen(kw_only=True)
class ExperimentSettings:
    """
    Everything that defines one experiment, validated at construction.

    ``max_command``, ``travel`` and ``speed`` have no default that is allowed: who owns the machine
    knows them, and nobody else does.

    Raises
    ------
    SettingError
        For a wrong type, a value out of range, a minimum that is not below its maximum, a resting
        command outside the limits, a prediction and a band of different lengths.

    """

    kind: str = choice(
        'staircase',
        KINDS,
        'staircase = pulses that grow until the output moves; doublet = pulses to and fro, of '
        'zero mean; silence = a pulse, after which nothing is sent; closed = doublets, added to '
        'the command of a controller; step = a controller takes over, steps and is compared with '
        'a prediction',
    )
    period: float = number(0.01, 1e-6, 1.0 / SLOWEST_RATE, 's', 'nominal time between samples')
    center: float = number(
        0.0, LOWEST, HIGHEST, 'command unit', 'command with which the machine rests'
    )
    max_command: float = number(
        0.0, LEAST, HIGHEST, 'command unit', 'farthest that the command goes from center'
    )
    command_min: float = number(-100.0, LOWEST, HIGHEST, 'command unit', 'lowest command')
    command_max: float = number(100.0, LOWEST, HIGHEST, 'command unit', 'highest command')
    command_rate_limit: float = number(
        0.0, 0.0, HIGHEST, 'command unit/s', 'largest rate of change of the command; 0 = off'
    )
    travel: float = number(
        0.0, LEAST, HIGHEST, 'output unit', 'farthest that the output goes from where it started'
    )
    homed: bool = flag(False, 'whether travel counts from home, instead of where it begins')
    home: float = number(
        0.0, LOWEST, HIGHEST, 'output unit', 'output from which travel counts, if homed'
    )
    speed: float = number(
        0.0, LEAST, HIGHEST, 'output unit/s', 'largest rate of change of the output'
    )
    longest: float = number(20.0, LEAST, LONGEST, 's', 'time after which it ends at the latest')
    measurement_timeout: float = number(
        0.25, LEAST, LONGEST, 's', 'silence of valid measurements that ends it'
    )
    measurement_period: float = number(
        0.0, 0.0, HIGHEST, 'output unit', 'period of an angle, as 6.283185307179586; 0 = no angle'
    )
    noise: float = number(
        0.0, 0.0, HIGHEST, 'output unit', 'standard deviation of the measurement, at rest'
    )
    sign: int = integer(0, -1, 1, 'sign of b0; 0 = not known yet')
    delay: float = number(
        0.0, 0.0, LONGEST, 's', 'dead time of the machine, as far as it is known'
    )
    amplitude: float = number(
        0.0, 0.0, HIGHEST, 'command unit', 'size of the pulses, of a staircase that of the first'
    )
    segment: float = number(
        0.25, 1e-6, LONGEST, 's', 'length of a pulse, of doublets that of the shortest'
    )
    silence: float = number(0.0, 0.0, LONGEST, 's', 'how long nothing is sent, of kind silence')
    seed: int = integer(1, 0, 2**31 - 1, 'what the order of the doublets is drawn from')
    reference_step: float = number(
        0.0, LOWEST, HIGHEST, 'output unit', 'step of the reference, of kind step'
    )
    predicted: tuple[float, ...] = numbers(
        (0.0,),
        LOWEST,
        HIGHEST,
        'output unit',
        'response to be expected to that step, for half of the time, and back: a value each '
        'period from the step on',
    )
    band: tuple[float, ...] = numbers(
        (0.0,), 0.0, HIGHEST, 'output unit', 'how far from the prediction is as expected, each'
    )

    def __attrs_post_init__(self) -> None:
        low, high = self.command_min, self.command_max
        if not low < high:
            raise SettingError('command_min', low, f'below command_max = {high!r}')
        if not low <= self.center <= high:
            raise SettingError(
                'center', self.center, f'from command_min = {low!r} to command_max = {high!r}'
            )
        if len(self.predicted) != len(self.band):
            allowed = f'a list of {len(self.predicted)} entries, as predicted has'
            raise SettingError('band', self.band, allowed)

    @property
    def lowest(self) -> float:
        """Return the lowest command that is ever sent."""
        return max(self.command_min, self.center - self.max_command)

    @property
    def highest(self) -> float:
        """Return the highest command that is ever sent."""
        return min(self.command_max, self.center + self.max_command)
