"""
What to do with an identified plant: a first design, its settings, and a scenario to go on from.

The design is that of ``nadrc design``: the shortest settling time that rate, delay, noise and the
range of the command leave, :func:`nadrc_ros.tuning.design.limits.fastest`. What a plant does not
tell (limits, timeouts, ...) is that of the controller in the log, where it was recorded. The
scenario is the experiment of the log: the plant that was found, what it followed, its noise.
"""

from __future__ import annotations

from pathlib import Path

import attrs
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.history import History
from nadrc_ros.scenario.scenario import Scenario
from nadrc_ros.scenario.specs import PlantSpec, SignalSpec
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plants import Chain
from nadrc_ros.theory.margins import Margins
from nadrc_ros.tuning.design.bandwidths import patient
from nadrc_ros.tuning.design.first_design import first_design, FirstDesign
from nadrc_ros.tuning.design.limits import fastest
from nadrc_ros.tuning.design.requirements import Requirements
from nadrc_ros.tuning.identification.identify import Plant
from nadrc_ros.tuning.identification.predictor import (
    Array,
    filtered,
    Form,
    Log,
    noise_polynomial,
    plant_polynomials,
)
import numpy as np

NAME = 'identified'
# Standard deviation of the command that noise may cause, as a share of the command's range.
NOISE_SHARE = 0.05
# Without recorded limits: an end at which the command was so often, one sample after the other or
# not, is taken for one. Else its range is as much again.
_OFTEN_AT_A_LIMIT = 5
# What makes parameters those of a controller.
_CONTROLLER_HAS = {'plant_order', 'b0', 'command_min', 'command_max'}
# What a design decides.
_DESIGNED = (
    'plant_order',
    'b0',
    'structure',
    'levels',
    'inner_bandwidth',
    'outer_bandwidth',
    'bandwidth_ratio',
    'controller_bandwidth',
    'observer_gain_factor',
    'input_delay',
)
# A search simulates thousands of runs as long as that.
_MOST_PERIODS = 50_000


@attrs.frozen(kw_only=True)
class Advice:
    """
    A design for an identified plant, what forbids a faster one, and settings to start with.

    ``limits_known`` tells whether the limits of ``settings`` are those of the controller that ran.
    """

    design: FirstDesign
    limit: str
    settings: ControllerSettings
    limits_known: bool

    @property
    def margins(self) -> Margins:
        """Return those of a chain with the b0 and the lateness found; a lag counts as a delay."""
        return self.design.chosen.prediction.margins

    @property
    def line(self) -> str:
        """Return the command that makes the same design."""
        wanted, usual = self.design.wanted, declared(Requirements)
        words = ['nadrc design']
        for name, value in attrs.asdict(wanted).items():
            if value is True:
                words.append(f'--{name.replace("_", "-")}')
            elif value != usual[name].default:
                words.append(f'--{name.replace("_", "-")} {value:g}')
        return ' '.join(words)


def advise(plant: Plant, log: Log, running: ControllerSettings | None = None) -> Advice:
    """
    Return the design that an identified plant allows; ``running`` is the controller of the log.

    Raises
    ------
    Conflict
        When noise or delay leave none.

    """
    low, high = limits_of(log, running)
    both = low < 0.0 < high
    wanted, cause = fastest(
        Requirements(
            order=plant.order,
            b0=rounded(plant.b0.value),
            rate=rounded(1.0 / plant.period),
            noise_std=rounded(plant.noise, 3),
            command_noise=rounded(NOISE_SHARE * (high - low), 3),
            command_limit=rounded((min if both else max)(-low, high)),
            one_sided=low >= 0.0,
            delay=delay_of(plant),
            reference_step=jump_of(log),
        )
    )
    design = first_design(wanted)
    return Advice(
        design=design,
        limit=cause,
        settings=_settings(plant, design.chosen.settings, (low, high), running),
        limits_known=running is not None,
    )


def _settings(
    plant: Plant,
    chosen: ControllerSettings,
    limits: tuple[float, float],
    running: ControllerSettings | None,
) -> ControllerSettings:
    designed = {name: getattr(chosen, name) for name in _DESIGNED}
    base = running or attrs.evolve(
        chosen,
        command_min=limits[0],
        command_max=limits[1],
        safe_command=min(max(0.0, limits[0]), limits[1]),
    )
    settings = attrs.evolve(
        base,
        **designed,
        pole_ratios=(1.0,),
        feedback='linear',
        feedback_level='inner',
        fal_gains=(0.0,),
        fal_exponents=chosen.fal_exponents,
    )
    return patient(settings, plant.period)


def running_controller(history: History) -> ControllerSettings | None:
    """Return the settings of the one controller in a log, as they were last; None if unknown."""
    controllers = [
        n for n, values in history.parameters.items() if values.keys() >= _CONTROLLER_HAS
    ]
    steps = history.controller_settings()
    return steps[-1][1] if len(controllers) == 1 and steps else None


def limits_of(log: Log, running: ControllerSettings | None) -> tuple[float, float]:
    """
    Return the limits of the command: those of the controller that ran, or a guess.

    The guess: an end of the command's range at which it was often; else twice that range, of a
    sign that the command had.
    """
    if running is not None:
        return running.command_min, running.command_max
    u = log.command
    low, high = float(u.min()), float(u.max())
    room = 2.0 * max(abs(low), abs(high))
    at_low, at_high = (int(np.sum(u == end)) >= _OFTEN_AT_A_LIMIT for end in (low, high))
    free_low, free_high = 0.0 if low >= 0.0 else -room, 0.0 if high <= 0.0 else room
    return (
        rounded(min(low, 0.0) if at_low else free_low),
        rounded(max(high, 0.0) if at_high else free_high),
    )


def known_dynamics(plant: Plant, settings: ControllerSettings) -> str:
    """
    Say what to set for the controller to know of the damping and the lag that were found.

    Nothing where it is not worth it: a pole slower than a tenth of the controller bandwidth is
    rejected as a disturbance is, one that is faster than the observer is hardly seen.
    """
    order, b0, poles = plant.order, settings.b0, [0.0] * plant.order
    slowest, fastest = 0.1 * settings.controller_bandwidth, settings.inner_bandwidth
    found = []
    if plant.damping.low > 0.0 and slowest < plant.damping.value < fastest:
        found.append('damping')
        poles[0] = -rounded(plant.damping.value, 3)
    if plant.late == 'lag' and plant.lateness is not None and plant.lateness.low > 0.0:
        pole = rounded(1.0 / plant.lateness.value, 3)
        if slowest < pole < fastest:
            found.append('lag, here taken for a delay,')
            order, b0, poles = order + 1, rounded(b0 * pole), [-pole, *poles]
    if not found:
        return ''
    told = [f'--plant-poles {p:g}' for p in poles]
    return (
        f'The {" and the ".join(found)} may be given to the controller: plant_order {order}, '
        f'b0 {b0:g}, plant_poles {poles}; '
        f'for a design with them: --order {order} --b0 {b0:g} {" ".join(told)}.'
    )


def delay_of(plant: Plant) -> float:
    """Return the lateness [s]: that of the scenario to go on from, and of its controller."""
    return max(rounded(plant.lateness.value), 0.0) if plant.lateness else 0.0


def jump_of(log: Log) -> float:
    """Return the largest jump of the reference from one sample to the next, 0 for a smooth one."""
    if not log.reference_moves:
        return 0.0
    steps = np.abs(np.diff(log.reference))
    largest = float(steps.max())
    # A smooth reference moves nearly as far in the next period.
    at = int(np.argmax(steps))
    near = float(np.delete(steps[max(at - 1, 0) : at + 2], min(at, 1)).max(initial=0.0))
    return rounded(largest, 3) if near < 0.5 * largest else 0.0


def rounded(value: float, digits: int = 4) -> float:
    """Return the value with that many significant digits, as one writes it down."""
    return float(f'{value:.{digits}g}')


def reference_text(log: Log) -> str:
    """Return the reference as the text of a CSV file, a row where it changes; '' if unknown."""
    if not np.isfinite(log.reference).all():
        return ''
    kept = np.flatnonzero(np.append(True, np.diff(log.reference) != 0.0))
    rows = (f'{log.h * k:.9g},{log.reference[k]:.9g}' for k in kept)
    return '\n'.join(('time,reference', *rows, ''))


def scenario_of(
    plant: Plant, log: Log, settings: ControllerSettings, reference: Path | None = None
) -> Scenario:
    """
    Return a scenario with the identified chain, from which `nadrc tune` and `simulate` go on.

    It lasts as long as the log, at its rate, with its noise; a delay or lag becomes a dead time
    of the plant. The reference is that of the file, of :func:`reference_text`;
    where it is not known, the dominant sine of the measurement. The disturbance is the dominant
    sine of what b0 and the damping leave unexplained.
    """
    rate = rounded(1.0 / plant.period)
    span = declared(Chain)['damping']
    damping = min(max(rounded(plant.damping.value), float(span.low or 0)), float(span.high or 0))
    length = min(len(log.command) * log.h, _MOST_PERIODS / rate)
    if reference is None:
        followed = _sine(log.measurement, log.h)
    else:
        # As a log has it: samples alone, of which the controller estimates what it can.
        columns = {'time': 'time', 'column': 'reference', 'between': 'hold'}
        followed = SignalSpec(csv=str(reference), values=columns)
    values = {'order': plant.order, 'gain': settings.b0, 'damping': damping}
    return Scenario(
        plant=PlantSpec(name='chain', values=values),
        initial_state=(rounded(float(log.measurement[0])), *[0.0] * (plant.order - 1)),
        reference=followed,
        disturbance=_sine(disturbance(plant, log), log.h),
        noise=Noise(variance=rounded(plant.noise**2), seed=1),
        rate=rate,
        duration=rounded(length),
        input_delay=delay_of(plant),
        reference_alone=reference is not None,
        controllers={NAME: settings},
    )


def _sine(values: Array, h: float) -> SignalSpec:
    """Return the sine that says most of the values, around their mean."""
    mean = float(values.mean())
    power = np.abs(np.fft.rfft(values - mean)) ** 2
    peak = 1 + int(np.argmax(power[1:]))
    sine = {
        'offset': mean,
        'amplitude': float(np.sqrt(2.0) * values.std()),
        'frequency': 2.0 * np.pi * peak / (len(values) * h),
    }
    return SignalSpec(name='sine', values={key: rounded(value) for key, value in sine.items()})


def disturbance(plant: Plant, log: Log) -> Array:
    """Return d = y^(n) + damping y^(n-1) - b0 u, low-pass filtered, without the filter's start."""
    late = 'delay' if plant.lateness else ''
    form = Form(order=plant.order, smoothness=0, late=late)
    parameters = np.append(np.zeros(plant.order - 1), -plant.damping.value)
    if plant.lateness:
        parameters = np.append(parameters, plant.lateness.value)
    w = plant.disturbance_bandwidth
    output, command, _ = filtered(log, form, parameters, w)
    gain = noise_polynomial(form, w, log.h).sum()
    gain /= plant_polynomials(form, parameters, log.h)[1].sum()
    started = min(int(5.0 / (w * log.h)), len(output) // 2)
    found: Array = gain * (output - plant.b0.value * command)[started:]
    return found
