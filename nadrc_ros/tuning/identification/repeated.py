"""The experiment of a log as a scenario: the plant that was found, what it followed, its noise."""

from __future__ import annotations

from pathlib import Path

from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario.scenario import Scenario
from nadrc_ros.scenario.specs import PlantSpec, SignalSpec
from nadrc_ros.simulation.faults import Faults, MeasurementFault
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plants import Chain
from nadrc_ros.tuning.identification.advice import delay_of, rounded
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
import numpy as np

NAME = 'identified'
# A search simulates thousands of such runs.
MOST_PERIODS = 50_000


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

    It lasts as long as the log, at its rate, with its noise; a delay or lag becomes a delay of the
    measurement, in whole periods. The reference is that of the file, of :func:`reference_text`;
    where it is not known, the dominant sine of the measurement. The disturbance is the dominant
    sine of what b0 and the damping leave unexplained.
    """
    rate = rounded(1.0 / plant.period)
    span = declared(Chain)['damping']
    damping = min(max(rounded(plant.damping.value), float(span.low or 0)), float(span.high or 0))
    length = min(len(log.command) * log.h, MOST_PERIODS / rate)
    if reference is None:
        followed = _sine(log.measurement, log.h)
    else:
        # Held between its samples, as nothing tells that its derivatives were known.
        columns = {'time': 'time', 'column': 'reference', 'between': 'hold'}
        followed = SignalSpec(csv=str(reference), values=columns)
    return Scenario(
        plant=PlantSpec(
            name='chain',
            values={'order': plant.order, 'gain': settings.b0, 'damping': damping},
        ),
        initial_state=(rounded(float(log.measurement[0])), *[0.0] * (plant.order - 1)),
        reference=followed,
        disturbance=_sine(disturbance(plant, log), log.h),
        noise=Noise(variance=rounded(plant.noise**2), seed=1),
        rate=rate,
        duration=rounded(length),
        faults=_late(plant),
        controllers={NAME: settings},
    )


def _sine(values: Array, h: float) -> SignalSpec:
    mean, size, frequency = (rounded(value) for value in dominant_sine(values, h))
    return SignalSpec(
        name='sine', values={'offset': mean, 'amplitude': size, 'frequency': frequency}
    )


def _late(plant: Plant) -> Faults:
    late = delay_of(plant)
    if late == 0.0:
        return Faults()
    return Faults(measurement=(MeasurementFault(kind='delayed', time=late),))


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
