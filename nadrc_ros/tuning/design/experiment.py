"""The experiment of a first design: every candidate on the nominal plant, and what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, copysign, floor, pi
from typing import NamedTuple

import attrs
from nadrc_ros.adrc.settings import SLOWEST_RATE
from nadrc_ros.scenario import PlantSpec, Scenario, SignalSpec
from nadrc_ros.simulation.faults import Faults, MeasurementFault
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.tuning import TIMEOUT_PERIODS
from nadrc_ros.tuning.design.bandwidths import reference_step
from nadrc_ros.tuning.design.candidates import Candidate
from nadrc_ros.tuning.design.requirements import Requirements

# In settling times: the start, which is bumpless and would spoil the step; the step of the
# reference alone; the disturbance beside it.
START, ALONE, TOGETHER = 0.2, 2.0, 4.0
CYCLES = 3.0
MOST_PERIODS = 10_000
SEED = 1


class Expected(NamedTuple):
    """
    Figures of merit of one candidate in a run of the experiment, with noise.

    ``itae`` [output unit s^2], ``isu`` [command unit^2 s], the part of it that noise has on
    average, ``noise_isu``: the variance of the command times the length of the run, and the share
    of the time in which the command was ``saturated``.
    """

    itae: float
    isu: float
    noise_isu: float
    saturated: float


def experiment(wanted: Requirements, ordered: Sequence[Candidate]) -> Scenario:
    """
    Return a step of the reference, and later the disturbance, for all candidates.

    A delay becomes one of the measurement, in whole periods.
    """
    start = START * wanted.settling_time + wanted.delay
    later = start + ALONE * wanted.settling_time
    return Scenario(
        plant=PlantSpec(name='chain', values={'order': wanted.order, 'gain': wanted.b0}),
        reference=SignalSpec(
            name='step', values={'amplitude': reference_step(wanted), 'start_time': start}
        ),
        disturbance=_disturbance(wanted, later),
        noise=Noise(variance=wanted.noise_std**2, seed=SEED),
        faults=_faults(wanted),
        controllers={candidate.name: candidate.settings for candidate in ordered},
        rate=wanted.rate,
        duration=float(f'{later + _length(wanted):.3g}'),
    )


def expect(scenario: Scenario, candidate: Candidate) -> Expected:
    """
    Return the figures of merit of one candidate.

    Of a run of very many periods only every k-th is simulated, with as much noise per second: such
    a loop is so slow against its rate that this makes no difference worth waiting for.
    """
    found = _thinned(scenario).run(candidate.name).metrics
    spent = candidate.prediction.command_noise**2 * found.duration
    return Expected(found.itae, found.isu, spent, found.saturated_fraction)


def _thinned(scenario: Scenario) -> Scenario:
    every = ceil(scenario.duration * scenario.rate / MOST_PERIODS)
    every = min(every, floor(scenario.rate / SLOWEST_RATE))
    if every <= 1:
        return scenario
    rate = scenario.rate / every
    patience = TIMEOUT_PERIODS / rate
    slow = {
        name: attrs.evolve(
            settings,
            measurement_timeout=max(settings.measurement_timeout, patience),
            max_dt=max(settings.max_dt, patience),
        )
        for name, settings in scenario.controllers.items()
    }
    noise = attrs.evolve(scenario.noise, variance=scenario.noise.variance / every)
    return attrs.evolve(scenario, rate=rate, controllers=slow, noise=noise)


def _disturbance(wanted: Requirements, start: float) -> SignalSpec:
    # A command of one sign can cancel a disturbance of the other.
    size = -copysign(wanted.load, wanted.b0) if wanted.one_sided else wanted.load
    values = {'amplitude': size, 'start_time': start}
    if wanted.disturbance_frequency == 0.0:
        return SignalSpec(name='step', values=values)
    return SignalSpec(name='sine', values={**values, 'frequency': wanted.disturbance_frequency})


def _length(wanted: Requirements) -> float:
    """Return how long the disturbance acts: cycles, but not more periods than are quickly run."""
    length = TOGETHER * wanted.settling_time
    if wanted.disturbance_frequency > 0.0:
        cycles = CYCLES * 2.0 * pi / wanted.disturbance_frequency
        length = max(length, min(cycles, MOST_PERIODS * wanted.period))
    return length


def _faults(wanted: Requirements) -> Faults:
    if wanted.delay == 0.0:
        return Faults()
    return Faults(measurement=(MeasurementFault(kind='delayed', time=wanted.delay),))
