"""What is done to a controller: plant, signals, noise, faults, changes on the way."""

from __future__ import annotations

from math import isfinite
from typing import Any

import attrs
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import choice, flag, number
from nadrc_ros.adrc.settings import FASTEST_RATE, LONGEST, SLOWEST_RATE
from nadrc_ros.simulation.dead_time import DeadTime
from nadrc_ros.simulation.faults import Faults
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plant_run import PlantRun
from nadrc_ros.simulation.protocols import Plant, Signal
from nadrc_ros.simulation.sensor import Sensor
from nadrc_ros.simulation.signals import Nothing


@attrs.frozen(kw_only=True)
class Retune:
    """A change of controller settings at a time [s], by field name."""

    time: float = number(0.0, 0.0, LONGEST, 's', 'time of the change')
    settings: dict[str, Any] = attrs.field(factory=dict)


@attrs.frozen(kw_only=True)
class Conditions:
    """
    What an experiment and a scenario that describes one have in common.

    Attributes
    ----------
    noise
        Measurement noise, with the seed of all that is random.
    sensor
        Whether it wraps.
    faults
        What goes wrong with the sensor and the actuator.
    initial_state
        x(0) of the plant, zeros if left out.
    retunes
        Changes of settings on the way.

    Raises
    ------
    SettingError
        For a value out of range, or fewer than one period.

    """

    noise: Noise = attrs.field(factory=Noise)
    sensor: Sensor = attrs.field(factory=Sensor)
    faults: Faults = attrs.field(factory=Faults)
    initial_state: tuple[float, ...] = ()
    retunes: tuple[Retune, ...] = ()
    rate: float = number(200.0, SLOWEST_RATE, FASTEST_RATE, 'Hz', 'periods per second')
    duration: float = number(15.0, 1.0 / FASTEST_RATE, LONGEST, 's', 'length of the run')
    input_delay: float = number(
        0.0, 0.0, LONGEST, 's', 'dead time of the plant: from a command until it acts'
    )
    error: str = choice(
        'reference', ('reference', 'tracking'), 'error of the metrics: r - y, or r1 - y'
    )
    reference_alone: bool = flag(
        False, 'whether the reference comes without its derivatives, as most robots publish it'
    )
    reference_rate: float = number(
        0.0, 0.0, FASTEST_RATE, 'Hz', 'how often the reference is a new one; 0 = each period'
    )
    settle_time: float = number(
        0.0, 0.0, LONGEST, 's', 'from when on peak_error counts; 0 = a tenth of the duration'
    )

    def __attrs_post_init__(self) -> None:
        if self.steps < 1:
            raise SettingError(
                'duration', self.duration, f'at least {self.period!r} s, one period'
            )
        if self.settle_time > self.last:
            raise SettingError(
                'settle_time', self.settle_time, f'at most {self.last:g} s, the last sample'
            )

    @property
    def period(self) -> float:
        """Sample period h [s]."""
        return 1.0 / self.rate

    @property
    def steps(self) -> int:
        """Return the number of periods N."""
        return round(self.duration * self.rate)

    @property
    def last(self) -> float:
        """Return the time of the last sample [s]."""
        return (self.steps - 1) / self.rate

    @property
    def settled(self) -> float:
        """Return the time from which ``peak_error`` counts [s]."""
        return self.settle_time or min(0.1 * self.duration, self.last)


@attrs.frozen(kw_only=True)
class Experiment(Conditions):
    """
    What is done to a controller: plant, signals, noise, faults, rate, duration.

    Raises
    ------
    SettingError
        As :class:`Conditions`; also for an initial state that is not ``states`` finite numbers.

    """

    plant: Plant
    reference: Signal
    disturbance: Signal
    noise_signal: Signal = attrs.field(factory=Nothing)
    feed_forward: Signal = attrs.field(factory=Nothing)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        DeadTime(self.input_delay, self.rate, 0.0)  # refuses one that is too long for the rate
        given, states = self.initial_state, self.plant.states
        listed = isinstance(given, (list, tuple)) and len(given) in (0, states)
        if not listed or not all(map(_finite, given)):
            raise SettingError('initial_state', given, f'a list of {states} finite numbers')
        object.__setattr__(self, 'initial_state', tuple(map(float, given or [0.0] * states)))

    def plant_run(self, before: float = 0.0) -> PlantRun:
        """Return the plant at its initial state, with the command that acts ``before`` any."""
        return PlantRun(
            self.plant,
            self.disturbance,
            self.noise,
            self.rate,
            self.initial_state,
            self.faults,
            self.noise_signal,
            self.sensor,
            self.input_delay,
            before,
        )


def _finite(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)
