"""
What to do with an identified plant: bandwidths that it allows, settings, a scenario to go on from.

The observer bandwidth is the largest that three rules allow:

* rate: w h <= 0.3. The sampled observer then still does what its continuous design says, with a
  lag of the hold well below that of the observer.
* lateness: w T <= 0.3 for a delay or lag T, for the same reason.
* noise: the command scatters by at most 5 % of the span that it had in the log. Its variance,
  :func:`nadrc_ros.adrc.theory.delayed.command_variance`, grows about as w^(2 n + 1) (Gao, Scaling
  and bandwidth-parameterization, 2003, gives the trade-off, not the number).
"""

from __future__ import annotations

import attrs
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.theory.delayed import command_variance, delayed_loop
from nadrc_ros.adrc.theory.loop import chain
from nadrc_ros.adrc.theory.margins import Margins, margins
from nadrc_ros.scenario.scenario import Scenario
from nadrc_ros.scenario.specs import PlantSpec, SignalSpec
from nadrc_ros.simulation.faults import Faults, MeasurementFault
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plants.chain import Chain
from nadrc_ros.tuning.identification.identify import Plant
from nadrc_ros.tuning.identification.log import dominant_sine
from nadrc_ros.tuning.identification.predictor import (
    Array,
    filtered,
    Form,
    Log,
    noise_polynomial,
    plant_polynomials,
)
from nadrc_ros.tuning.rules import LARGEST_W_H, PATIENCE
import numpy as np
from scipy.optimize import brentq

LARGEST_W_LATE = LARGEST_W_H
NOISE_SHARE = 0.05
OUTER, CONTROLLER = 0.5, 0.2  # of the inner bandwidth
NAME = 'identified'


@attrs.frozen(kw_only=True)
class Advice:
    """
    Observer bandwidths [rad/s] that each rule allows, settings with the smallest, their margins.

    The margins are those of a chain with the b0 and the lateness found; a lag counts as a delay.
    """

    bandwidths: dict[str, float]
    settings: ControllerSettings
    margins: Margins

    @property
    def limit(self) -> str:
        """Return which rule counts: rate, lateness or noise."""
        return min(self.bandwidths, key=lambda rule: self.bandwidths[rule])


def advise(plant: Plant, log: Log) -> Advice:
    """Return what the noise, the rate and the lateness of an identified plant allow."""
    low, high = float(log.command.min()), float(log.command.max())
    if rounded(low) < rounded(high):
        low, high = rounded(low), rounded(high)
    bandwidths = {'rate': LARGEST_W_H / plant.period}
    if plant.lateness and plant.lateness.value > 0.0:
        bandwidths['lateness'] = LARGEST_W_LATE / plant.lateness.value
    patience = PATIENCE * plant.period
    usual = ControllerSettings()
    settings = ControllerSettings(
        plant_order=plant.order,
        b0=rounded(plant.b0.value),
        command_min=low,
        command_max=high,
        safe_command=min(max(0.0, low), high),
        measurement_timeout=max(usual.measurement_timeout, patience),
        max_dt=max(usual.max_dt, patience),
    )
    highest = min(bandwidths.values())
    quiet = _quiet(plant, settings, highest, high - low)
    if quiet < highest:
        bandwidths['noise'] = quiet
    found = {rule: rounded(value, 3) for rule, value in bandwidths.items()}
    settings = _with_bandwidth(settings, min(found.values()))
    late = plant.lateness.value if plant.lateness else 0.0
    return Advice(
        bandwidths=found,
        settings=settings,
        margins=margins(
            make_design(settings), chain(plant.order, settings.b0), plant.period, late
        ),
    )


def scenario_of(plant: Plant, log: Log, settings: ControllerSettings) -> Scenario:
    """
    Return a scenario with the identified chain, from which `nadrc tune` and `simulate` go on.

    The reference is the dominant sine of the recorded one, the disturbance that of what b0 and the
    damping leave unexplained. A delay or lag becomes a delay of the measurement, in whole periods.
    The command may be twice as large as it was in the log, of a sign that it had.
    """
    low, high = settings.command_min, settings.command_max
    room = 2.0 * max(abs(low), abs(high))
    reference = log.reference if plant.instruments else log.measurement
    mean, size, frequency = (rounded(v) for v in dominant_sine(reference, log.h))
    unknown, pull, pace = (rounded(v) for v in dominant_sine(disturbance(plant, log), log.h))
    limit = float(declared(Chain)['damping'].high or 0.0)
    damping = min(max(rounded(plant.damping.value), -limit), limit)
    return Scenario(
        plant=PlantSpec(
            name='chain',
            values={
                'order': plant.order,
                'gain': rounded(plant.b0.value),
                'damping': damping,
            },
        ),
        initial_state=(mean, *[0.0] * (plant.order - 1)),
        reference=SignalSpec(
            name='sine', values={'offset': mean, 'amplitude': size, 'frequency': frequency}
        ),
        disturbance=SignalSpec(
            name='sine', values={'offset': unknown, 'amplitude': pull, 'frequency': pace}
        ),
        noise=Noise(variance=rounded(plant.noise**2), seed=1),
        rate=_rate(plant),
        duration=rounded(min(max(len(log.command) * log.h, 1.0), 60.0)),
        faults=_late(plant),
        controllers={
            NAME: attrs.evolve(
                settings,
                command_min=0.0 if low >= 0.0 else -room,
                command_max=0.0 if high <= 0.0 else room,
            )
        },
    )


def _rate(plant: Plant) -> float:
    return rounded(1.0 / plant.period)


def _late(plant: Plant) -> Faults:
    """Return what delays the loop as the plant was found to, in the nearest whole periods."""
    periods = round(plant.lateness.value / plant.period) if plant.lateness else 0
    if periods == 0:
        return Faults()
    late = MeasurementFault(kind='delayed', time=periods / _rate(plant))
    return Faults(measurement=(late,))


def disturbance(plant: Plant, log: Log) -> Array:
    """Return d = y^(n) + damping y^(n-1) - b0 u, low-pass filtered, without the filter's start."""
    form = Form(order=plant.order, smoothness=0)
    parameters = np.append(np.zeros(plant.order - 1), -plant.damping.value)
    w = plant.disturbance_bandwidth
    output, command, _ = filtered(log, form, parameters, w)
    gain = noise_polynomial(form, w, log.h).sum()
    gain /= plant_polynomials(form, parameters, log.h)[1].sum()
    started = min(int(5.0 / (w * log.h)), len(output) // 2)
    found: Array = gain * (output - plant.b0.value * command)[started:]
    return found


def rounded(value: float, digits: int = 4) -> float:
    """Return the value with that many significant digits, as one writes it down."""
    return float(f'{value:.{digits}g}')


def _with_bandwidth(settings: ControllerSettings, w: float) -> ControllerSettings:
    return attrs.evolve(
        settings,
        inner_bandwidth=rounded(w, 3),
        outer_bandwidth=rounded(OUTER * w, 3),
        controller_bandwidth=rounded(CONTROLLER * w, 3),
    )


def _quiet(plant: Plant, settings: ControllerSettings, highest: float, span: float) -> float:
    """Return the bandwidth at which noise moves the command by its share of the span."""

    def excess(logarithm: float) -> float:
        design = make_design(_with_bandwidth(settings, float(np.exp(logarithm))))
        nominal = chain(plant.order, settings.b0)
        late = plant.lateness.value if plant.lateness else 0.0
        loop = delayed_loop(design, nominal, plant.period, late)
        variance = command_variance(loop, plant.noise**2)
        return 0.5 * float(np.log(variance)) - float(np.log(NOISE_SHARE * span))

    lowest = highest * 1e-3
    if plant.noise == 0.0 or excess(np.log(highest)) <= 0.0:
        return highest
    if excess(np.log(lowest)) > 0.0:
        raise UserError('the noise drowns the command at any bandwidth')
    return float(np.exp(brentq(excess, np.log(lowest), np.log(highest), xtol=1e-3)))
