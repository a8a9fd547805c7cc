"""A first design from requirements: the one to take and why, and the experiment that compares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import ceil, copysign, floor, inf, pi
from typing import Any, NamedTuple

import attrs
from nadrc_ros.adrc.design import bandwidths, make_design
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import SLOWEST_RATE
from nadrc_ros.scenario import PlantSpec, Scenario, SignalSpec
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.theory.pid import equivalent_pid, FilteredPID
from nadrc_ros.tuning import LARGEST_OVERSHOOT, LARGEST_W_H, LEAST_MODULUS, WRONG_POLES
from nadrc_ros.tuning.design.bandwidths import (
    command_of_step,
    patient,
    reference_step,
    settling_factor,
)
from nadrc_ros.tuning.design.candidates import advice, advised, asked, Candidate, candidates
from nadrc_ros.tuning.design.limits import loop_margins, pole_overshoot
from nadrc_ros.tuning.design.requirements import LOAD_SHARE, Requirements, STEP_SHARE

# In settling times: the start, which is bumpless and would spoil the step; the step of the
# reference alone; the disturbance beside it.
_START, _ALONE, _TOGETHER = 0.2, 2.0, 4.0
_CYCLES = 3.0
# Of the controller bandwidth: a pole beyond it is a lag that a loop of one order less bears, if
# that is of order 1, or of a higher one.
_FAST_POLE, _FASTER_POLE = 6.0, 10.0
_MOST_PERIODS = 10_000
_SEED = 1


@attrs.frozen(kw_only=True, eq=False)
class FirstDesign:
    """What was wanted, the candidates (one observer first), the chosen one, and the experiment."""

    wanted: Requirements
    candidates: tuple[Candidate, ...]
    chosen: Candidate
    advice: str
    scenario: Scenario

    @property
    def title(self) -> str:
        """Return one line that says what was wanted."""
        wanted = self.wanted
        delay = f', delay {wanted.delay:g} s' if wanted.delay else ''
        return (
            f'plant order {wanted.order}, b0 = {wanted.b0:g}: settling time '
            f'{wanted.settling_time:g} s at {wanted.rate:g} Hz, noise {wanted.noise_std:g}{delay}'
        )

    @property
    def rules(self) -> list[str]:
        """Say how the bandwidths were found, with sources."""
        wanted, one = self.wanted, self.candidates[0]
        wc, w = one.settings.controller_bandwidth, one.settings.inner_bandwidth
        held = ', less for the hold' if wanted.order == 1 else ''
        step, load = reference_step(wanted), wanted.load
        rules = [
            f'controller bandwidth wc = {wc:.4g} rad/s: {settling_factor(wanted.order):.4g} / '
            f'settling time{held}, exact for (s + wc)^{wanted.order} (Gao 2003; rule of '
            'thumb: 4 or 6 / settling time for order 1 or 2, Herbst 2013)',
            f'one observer w = {w:.4g} rad/s, set by {one.decided_by}: {w / wc:.3g} wc (3 to 10, '
            f'Herbst 2013), w / rate = {w * wanted.period:.3g} (at most {LARGEST_W_H:g})',
            'more observers: as fast as the same noise of the command allows',
            f'compared under: a reference step of {step:g} '
            f'({self._share(bool(wanted.reference_step), STEP_SHARE)}), a disturbance of {load:g} '
            f'in units of y^({wanted.order}) '
            f'({self._share(bool(wanted.disturbance), LOAD_SHARE)})',
        ]
        if wanted.delay > 0.0:
            rules.append(self._told)
        if any(wanted.poles):
            rules.append(self._forgives)
        if wanted.half_gain:
            rules.append(
                'half of the observer gains act (Herbst, Hempel, Goehrt, Streif 2020; Herbst, '
                'Hempel 2025)'
            )
        return rules

    @cached_property
    def _with_wrong_poles(self) -> dict[str, float]:
        """Return by what share a step overshoots if the poles are wrong by two."""
        named = zip(('half as fast', 'twice as fast'), WRONG_POLES, strict=True)
        settings, wanted = self.chosen.settings, self.wanted
        return {said: pole_overshoot(settings, wanted, factor) for said, factor in named}

    @property
    def _forgives(self) -> str:
        return (
            f'{self.chosen.name}, should the poles of the plant be wrong: '
            f'{_said(self._with_wrong_poles)} (at most {100.0 * LARGEST_OVERSHOOT:g} % is asked '
            'for)'
        )

    @property
    def _told(self) -> str:
        """Say what it brings that the observers know the delay."""
        near = self.chosen.prediction.margins.modulus
        ignorant = attrs.evolve(make_design(self.chosen.settings), input_delay=0.0)
        without = loop_margins(ignorant, self.wanted, self.wanted.delay).modulus
        said = f'comes within {without:.2f} of it' if without > 0.0 else 'is unstable'
        return (
            f'the observers know the delay (input_delay = {self.wanted.delay:g} s): the loop '
            f'stays {near:.2f} away from instability (modulus), and without that it {said}; '
            'a period more or less leaves it stable'
        )

    def _share(self, named: bool, share: float) -> str:
        if named:
            return 'as asked for'
        return (
            f'assumed: takes {100.0 * share:g} % of command_limit = {self.wanted.command_limit:g}'
        )

    @property
    def warning(self) -> str:
        """Say what the chosen design cannot do that one may expect of it, nothing if it can."""
        return '; '.join(filter(None, (self._saturated, self._near, self._strict)))

    @property
    def _strict(self) -> str:
        if not any(self.wanted.poles):
            return ''
        over = self._with_wrong_poles.items()
        bad = {name: value for name, value in over if value > LARGEST_OVERSHOOT}
        if not bad:
            return ''
        limit = _FAST_POLE if self.wanted.order == 2 else _FASTER_POLE
        wc, fastest = self.chosen.settings.controller_bandwidth, -min(self.wanted.poles)
        one = self.chosen is self.candidates[0]
        remedy = f'identify them, or take {"a longer settling time" if one else "one observer"}'
        lower = self.wanted.order - 1
        if lower and fastest > limit * wc:
            remedy = (
                f'leave the fastest one out, with one observer of order {lower} and '
                f'b0 = {self.wanted.b0 / fastest:.4g}'
            )
        return f'should the poles of the plant be wrong: {_said(bad)}; {remedy}'

    @property
    def _saturated(self) -> str:
        wanted = self.wanted
        needed, step = abs(wanted.load / wanted.b0), reference_step(wanted)
        if needed >= wanted.command_limit and wanted.disturbance_frequency == 0.0:
            return (
                f'a disturbance of {wanted.load:g} takes a command of {needed:.4g}, and '
                f'command_limit = {wanted.command_limit:g}: no controller holds the output'
            )
        wc = self.chosen.settings.controller_bandwidth
        peak = command_of_step(wanted, wc) * abs(step / wanted.b0)
        if peak <= wanted.command_limit:
            return ''
        return (
            f'a step of {step:g} asks for a command of {peak:.4g}, more than '
            f'command_limit = {wanted.command_limit:g}: it settles later, or not at all for order '
            f'3 and more; use steps up to {wanted.command_limit / peak:.3g} of that, or a smooth '
            'reference'
        )

    @property
    def _near(self) -> str:
        near = self.chosen.prediction.margins.modulus
        if near >= LEAST_MODULUS:
            return ''
        remedy = 'a longer settling time' if self.wanted.delay else 'a faster observer'
        if self.wanted.delay and any(self.wanted.disturbance_frequencies):
            remedy = 'another settling time, or no disturbance_frequencies,'
        return (
            f'the loop comes within {near:.2f} of instability (modulus), and `nadrc tune` asks '
            f'for {LEAST_MODULUS:g}: {remedy} keeps farther away'
        )

    @property
    def pid(self) -> FilteredPID | None:
        """Return the filtered PI or PID controller that one observer is, for orders 1 and 2."""
        design = make_design(self.candidates[0].settings)
        if self.wanted.order > 2 or design.known or self.wanted.delay > 0.0:
            return None
        return equivalent_pid(design)

    def expected(self) -> dict[str, Expected]:
        """Run the experiment; return the figures of merit of each candidate by name."""
        return {c.name: expect(self.scenario, c) for c in self.candidates}

    def document(self, expected: Mapping[str, Expected]) -> dict[str, Any]:
        """Return everything as plain data; None is for what is infinite, or not there."""
        return {
            'requirements': {
                **attrs.asdict(self.wanted),
                'disturbance': self.wanted.load,
                'reference_step': reference_step(self.wanted),
            },
            'rules': self.rules,
            'advice': self.advice,
            'warning': self.warning,
            'chosen': self.chosen.name,
            'pid': None if self.pid is None else _plain(self.pid),
            'candidates': {
                c.name: {
                    'settings': attrs.asdict(c.settings),
                    'bandwidths': bandwidths(c.settings, c.levels),
                    'predicted': _plain(c.prediction),
                    'expected': _plain(expected[c.name]),
                }
                for c in self.candidates
            },
        }


def first_design(wanted: Requirements) -> FirstDesign:
    """
    Return a first design that meets the requirements.

    Raises
    ------
    Conflict
        When there is none.
    SettingError
        For a delay of more periods than a controller keeps commands of.

    """
    found = candidates(wanted)
    try:
        found[0].settings.check_rate(wanted.rate)
    except SettingError as error:
        raise SettingError('delay', error.value, error.allowed) from None
    best = advised(found)
    named = {(c.settings.structure, c.levels): c for c in found}
    chosen = next((named[key] for key in asked(wanted)), best)
    return FirstDesign(
        wanted=wanted,
        candidates=tuple(found),
        chosen=chosen,
        advice=advice(wanted, found, best),
        scenario=experiment(wanted, sorted(found, key=lambda c: c is not chosen)),
    )


def _said(overshoots: Mapping[str, float]) -> str:
    return ', '.join(
        f'{name} as given, the loop is unstable'
        if value == inf
        else f'{name} as given, a step overshoots by {100.0 * value:.2g} %'
        for name, value in overshoots.items()
    )


def _plain(value: Any) -> Any:
    if hasattr(value, '_asdict'):
        value = value._asdict()
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if hasattr(value, 'tolist'):
        return value.tolist()
    return None if value == inf else float(value)


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

    A delay becomes one at the input of the plant.
    """
    start = _START * wanted.settling_time + wanted.delay
    later = start + _ALONE * wanted.settling_time
    return Scenario(
        plant=_plant(wanted),
        reference=SignalSpec(
            name='step', values={'amplitude': reference_step(wanted), 'start_time': start}
        ),
        disturbance=_disturbance(wanted, later),
        noise=Noise(variance=wanted.noise_std**2, seed=_SEED),
        input_delay=wanted.delay,
        controllers={candidate.name: candidate.settings for candidate in ordered},
        rate=wanted.rate,
        duration=float(f'{later + _length(wanted):.3g}'),
    )


def _plant(wanted: Requirements) -> PlantSpec:
    if any(wanted.poles):
        return PlantSpec(name='lags', values={'poles': wanted.poles, 'gain': wanted.b0})
    return PlantSpec(name='chain', values={'order': wanted.order, 'gain': wanted.b0})


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
    every = ceil(scenario.duration * scenario.rate / _MOST_PERIODS)
    every = min(every, floor(scenario.rate / SLOWEST_RATE))
    if every <= 1:
        return scenario
    rate = scenario.rate / every
    slow = {name: patient(c, 1.0 / rate) for name, c in scenario.controllers.items()}
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
    length = _TOGETHER * wanted.settling_time
    if wanted.disturbance_frequency > 0.0:
        cycles = _CYCLES * 2.0 * pi / wanted.disturbance_frequency
        length = max(length, min(cycles, _MOST_PERIODS * wanted.period))
    return length
