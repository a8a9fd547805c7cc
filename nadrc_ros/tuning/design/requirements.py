"""What a control engineer knows before there is a controller."""

from __future__ import annotations

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import choice, flag, integer, number, numbers
from nadrc_ros.adrc.settings import (
    ControllerSettings,
    FASTEST,
    FASTEST_RATE,
    HIGHEST,
    LEAST,
    LONGEST,
    LOWEST,
    MAX_LEVELS,
    SLOWEST_RATE,
)
from nadrc_ros.adrc.structures import STRUCTURES

# The theory is linear: it takes the nonlinear structure for the nested one.
LINEAR = tuple(name for name, structure in STRUCTURES.items() if not structure.nonlinear)

# Of the range of the command: what cancels a disturbance of which nothing is said, and what a step
# of the reference asks for at first.
LOAD_SHARE, STEP_SHARE = 0.1, 0.5
# In settling times: how long a response is followed at first.
FOLLOWED = 3.0
# The experiment that compares designs takes several times as long.
LONGEST_SETTLING = 0.1 * LONGEST


class Conflict(UserError):
    """Requirements that exclude each other; the message says what would be possible."""


@attrs.frozen(kw_only=True)
class Requirements:
    """
    Requirements of one loop, validated at construction.

    Raises
    ------
    SettingError
        For a wrong type or a value out of range.

    """

    order: int = integer(2, 1, 5, 'order n of the plant: y^(n) = b0 u + total disturbance')
    b0: float = number(
        1.0, LOWEST, HIGHEST, 'y^(n) per unit command', 'input gain of the plant', nonzero=True
    )
    settling_time: float = number(
        1.0,
        1.0 / FASTEST,
        LONGEST_SETTLING,
        's',
        'time after which a step of the reference is followed within 2 %',
    )
    rate: float = number(200.0, SLOWEST_RATE, FASTEST_RATE, 'Hz', 'control periods per second')
    noise_std: float = number(
        0.0, 0.0, HIGHEST, 'output unit', 'standard deviation of the measurement noise, one sample'
    )
    command_noise: float = number(
        0.0,
        0.0,
        HIGHEST,
        'command unit',
        'largest standard deviation of the command that the noise may cause; 0 = no such limit',
    )
    delay: float = number(
        0.0,
        0.0,
        LONGEST,
        's',
        'dead time of the loop beyond the sampling (sensor, bus, actuator); becomes input_delay',
    )
    disturbance: float = number(
        0.0,
        0.0,
        HIGHEST,
        'unit of y^(n)',
        'size of the disturbance to expect; 0 = one that a tenth of command_limit cancels',
    )
    disturbance_frequency: float = number(
        0.0,
        0.0,
        FASTEST,
        'rad/s',
        'designs are compared by the largest error under sines up to this frequency; 0 = by that '
        'under a step. The controller does not get it (see disturbance_frequencies)',
    )
    reference_step: float = number(
        0.0,
        LOWEST,
        HIGHEST,
        'output unit',
        'step of the reference; 0 = one that asks for half of command_limit',
    )
    command_limit: float = number(
        100.0, LEAST, HIGHEST, 'command unit', 'largest command, of either sign'
    )
    one_sided: bool = flag(False, 'the command is never negative, as that of a heater')
    structure: str = choice(
        'advised',
        ('advised', *LINEAR),
        'observer; advised = one or nested, the better one',
    )
    levels: int = integer(
        0, 0, MAX_LEVELS, 'levels of a nested or cascade observer; 0 = advised, 2 for a cascade'
    )
    plant_poles: tuple[float, ...] = numbers(
        (0.0,),
        -FASTEST,
        FASTEST,
        'rad/s',
        'known real poles of the plant; 0, and one that is left out = an integrator',
    )
    disturbance_frequencies: tuple[float, ...] = numbers(
        (0.0,),
        0.0,
        FASTEST,
        'rad/s',
        'frequencies of known vibrations, up to 3, of which the observers get a model; 0 = none '
        '(disturbance_frequency only compares designs)',
    )
    half_gain: bool = flag(False, 'let half of the observer gains act (half-gain tuning)')

    def __attrs_post_init__(self) -> None:
        # What a controller refuses of them is refused here.
        ControllerSettings(
            plant_order=self.order,
            plant_poles=self.plant_poles,
            disturbance_frequencies=self.disturbance_frequencies,
            measurement_timeout=0.0,
            max_dt=LONGEST,
        ).check_rate(self.rate)

    @property
    def poles(self) -> tuple[float, ...]:
        """Return the known poles, one for each order."""
        return self.plant_poles + (0.0,) * (self.order - len(self.plant_poles))

    @property
    def load(self) -> float:
        """Disturbance [unit of y^(n)]: the one named, or one that the command can hold."""
        return self.disturbance or LOAD_SHARE * abs(self.b0) * self.command_limit

    @property
    def lowest_command(self) -> float:
        """Return the other end of the range of the command [command unit]."""
        return 0.0 if self.one_sided else -self.command_limit

    @property
    def period(self) -> float:
        """Sample period h [s]."""
        return 1.0 / self.rate
