"""How good a design is: its figures of merit over seeds and corners, and what it violates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from math import log
from typing import Any, TypeVar

import attrs
from nadrc_ros.adrc.cascade import CascadeSettings, loops_of
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import Scenario
from nadrc_ros.scenario.user_code import blame
from nadrc_ros.simulation.batch import run_metrics, RunMetrics
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.faults import Faults
from nadrc_ros.theory.cascade import cascade_loop
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.margins import loop_margins, Margins, margins
from nadrc_ros.tuning.search.settings import TuneSettings
from nadrc_ros.tuning.search.variables import designed
import numpy as np

T = TypeVar('T')
# Of each corner, one for each seed.
Runs = list[list[RunMetrics]]
# Not those of a scenario, so that what is found can be judged with others.
FIRST_SEED = 1001
# With the first seed alone: that far over the budget, or beyond a better design, is hopeless.
_HOPELESS = 1.05
_MARGIN_POINTS = 100  # frequencies of a margin: it is found between them anyway
# How far a design is beyond a constraint that cannot be run, is unstable, or ran away.
_NEVER = 10.0
# Faults of the actuator whose size is counted in commands.
_LIMITING = ('limited', 'rate_limited')


@attrs.frozen
class Figures:
    """Objective and effort of a design, over the corners."""

    objective: float
    isu: float

    def beats(self, other: Figures, factor: float = 1.0) -> bool:
        """Tell whether the other is worse by ``factor`` in both."""
        return factor * self.objective <= other.objective and factor * self.isu <= other.isu


def undominated(items: Iterable[T], figures: Callable[[T], Figures]) -> list[T]:
    """Return the items that no other beats in both, by rising effort."""

    def order(item: T) -> tuple[float, float]:
        found = figures(item)
        return found.isu, found.objective

    kept: list[T] = []
    for item in sorted(items, key=order):
        if not kept or figures(item).objective < figures(kept[-1]).objective:
            kept.append(item)
    return kept


@attrs.frozen(kw_only=True)
class Score:
    """
    What is known of a design.

    ``figures`` over all seeds and ``first`` with the first seed, None where it was not run so far;
    ``violations`` by constraint: how far it is beyond, none for a feasible design. Of ratios that
    is the logarithm, of the modulus the difference, of the delay what lacks [s].
    """

    figures: Figures | None = None
    first: Figures | None = None
    violations: dict[str, float] = attrs.field(factory=dict)


@attrs.frozen
class Corner:
    """A plant to try: the experiment, and a factor on the input gain of the plant."""

    experiment: Experiment
    gain: float

    @property
    def quiet(self) -> Corner:
        """Return the same plant with a perfect measurement."""
        noise = self.experiment.noise
        noise = attrs.evolve(noise, variance=0.0, derivative_variances=(0.0,))
        return attrs.evolve(self, experiment=attrs.evolve(self.experiment, noise=noise))


class Judge:
    """Scores designs of one controller of a scenario; can be sent to another process."""

    def __init__(
        self, scenario: Scenario, name: str, tuning: TuneSettings, compiled: bool
    ) -> None:
        self.scenario = scenario
        self.settings = scenario.controllers[name]
        self.tuning = tuning
        self.compiled = compiled
        count = tuning.seeds if scenario.noise.random else 1
        self.seeds = range(FIRST_SEED, FIRST_SEED + count)
        self._corners: list[Corner] = []

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, '_corners': []}  # a user's plant cannot be sent

    @property
    def corners(self) -> list[Corner]:
        """Return the nominal plant, then every combination of the ends of what is spread."""
        if not self._corners:
            self._corners = corners(self.scenario, self.tuning)
        return self._corners

    def score(self, values: dict[str, float], better: Sequence[Figures] = ()) -> Score:
        """
        Return the score of a design, by name of what varies; ``better`` are figures to beat.

        The cheap "no" comes first: the settings themselves, theory (a millisecond), one noise
        sequence, then the others. ``better`` are figures with that first sequence alone, for like
        is compared with like: the mean over all sequences of another design would let luck decide.
        They come from earlier generations only, so that the score of a design does not depend on
        which of its own generation was scored before, that is on the number of cores.
        """
        try:
            settings = designed(self.settings, values)
            settings.check_rate(self.scenario.rate)
        except SettingError:
            return Score(violations={'settings': _NEVER})
        violations = {k: v for k, v in self.theory(settings).items() if v > 0.0}
        if violations:
            return Score(violations=violations)
        return self._measured(settings, better)

    def theory(self, settings: ControllerSettings) -> dict[str, float]:
        """
        Return how far beyond each constraint the loop with a chain of integrators is.

        In place of the plant are n integrators of gain b0, which the law makes of any plant whose
        total disturbance is cancelled; nonlinear parts are in their linear zones. Negative where
        the constraint is kept.
        """
        tuning, h = self.tuning, 1.0 / self.scenario.rate
        designs = [make_design(each) for each in loops_of(settings)]
        fastest = max(max(design.bandwidths) for design in designs) * h
        if fastest > tuning.largest_wh * (1.0 + 1e-9):
            return {'largest_wh': log(fastest / tuning.largest_wh)}
        found = self.margins(settings)
        if found.modulus == 0.0:
            return {'stability': _NEVER}
        low, high = tuning.gain_margin * found.gain_low, tuning.gain_margin / found.gain_high
        gain = max(low, high)
        return {
            'gain_margin': log(gain) if gain > 0.0 else 0.0,
            'modulus_margin': tuning.modulus_margin - found.modulus,
            'delay_margin': tuning.delay_margin * h - found.delay,
        }

    def margins(self, settings: ControllerSettings) -> Margins:
        """
        Return the margins of the loop with a chain of the nominal b0, and the known delay.

        With a table of b0 it is one for which the table is right, with known poles one that has
        them.
        """
        plant, rate = self.corners[0].experiment.plant, self.scenario.rate
        loops = loops_of(settings)
        gain = loops[-1].b0 if len(loops[-1].b0_table) > 1 else plant.b0
        delay = self.scenario.faults.delay(rate) + self.scenario.input_delay
        designs = [make_design(each) for each in loops]
        poles = [0.0] * (plant.order - designs[-1].order) + designs[-1].damping
        nominal = chain(plant.order, gain, poles)
        if len(designs) > 1:
            return loop_margins(cascade_loop(designs, nominal, 1.0 / rate, delay), _MARGIN_POINTS)
        return margins(designs[0], nominal, 1.0 / rate, delay, _MARGIN_POINTS)

    def _measured(self, settings: ControllerSettings, better: Sequence[Figures]) -> Score:
        first_seed = self.seeds[:1]
        runs = [self._runs(settings, first_seed, corner) for corner in self.corners]
        # With `noise_free` the tracking is that of runs of its own, else that of the same.
        tracked = runs
        if self.tuning.noise_free:
            tracked = [self._runs(settings, first_seed, corner.quiet) for corner in self.corners]
        violations = self._violated(runs + tracked)
        if violations:
            return Score(violations=violations)
        first = self._figures(tracked, runs)
        too_costly = self.tuning.budget > 0.0 and first.isu > _HOPELESS * self.tuning.budget
        if too_costly or any(one.beats(first, _HOPELESS) for one in better):
            return Score(first=first, violations=self._over_budget(first))
        for corner, found in zip(self.corners, runs):
            found += self._runs(settings, self.seeds[1:], corner)
        violations = self._violated(runs)
        if violations:
            return Score(first=first, violations=violations)
        figures = self._figures(tracked, runs)
        return Score(figures=figures, first=first, violations=self._over_budget(figures))

    def _runs(
        self, settings: ControllerSettings, seeds: Sequence[int], corner: Corner
    ) -> list[RunMetrics]:
        scaled = with_gain(settings, corner.gain)
        with blame(*self.scenario.code):
            found = [run_metrics(corner.experiment, scaled, s, self.compiled) for s in seeds]
        gain = corner.gain
        return [
            attrs.evolve(run, isu=run.isu / gain**2, max_command=run.max_command / gain)
            for run in found
        ]

    def _violated(self, runs: Runs) -> dict[str, float]:
        every = [run for found in runs for run in found]
        if any(run.skipped for run in every):
            return {'stability': _NEVER}
        peak, largest = self.tuning.peak, max(run.max_command for run in every)
        return {'peak': log(largest / peak)} if 0.0 < peak < largest else {}

    def _over_budget(self, figures: Figures) -> dict[str, float]:
        budget = self.tuning.budget
        return {'budget': log(figures.isu / budget)} if 0.0 < budget < figures.isu else {}

    def _figures(self, tracked: Runs, runs: Runs) -> Figures:
        over: Callable[..., Any] = max if self.tuning.over == 'worst' else np.mean
        name = self.tuning.objective
        return Figures(
            float(over([np.mean([getattr(run, name) for run in found]) for found in tracked])),
            float(over([np.mean([run.isu for run in found]) for found in runs])),
        )


def corners(scenario: Scenario, tuning: TuneSettings) -> list[Corner]:
    """
    Return the nominal plant and every combination of the ends of what is spread.

    Raises
    ------
    SettingError, ScenarioError
        When a plant refuses an end.

    """
    gains = tuning.b0_spread or (1.0,)
    ends = product(*([(name, end) for end in span] for name, span in tuning.plant.items()))
    found = [Corner(scenario.experiment, 1.0)]
    for values in ends:
        try:
            spec = attrs.evolve(scenario.plant, values={**scenario.plant.values, **dict(values)})
        except SettingError as error:
            raise error.inside('plant') from None
        for gain in gains:
            if values or gain != 1.0:
                faults = _faults_with_gain(scenario.faults, gain)
                experiment = attrs.evolve(scenario, plant=spec, faults=faults).experiment
                found.append(Corner(experiment, gain))
    return found


def _faults_with_gain(faults: Faults, gain: float) -> Faults:
    """Return the faults of commands that are counted in ``gain`` times their unit."""
    command = tuple(
        attrs.evolve(fault, size=fault.size * gain) if fault.kind in _LIMITING else fault
        for fault in faults.command
    )
    return attrs.evolve(faults, command=command)


def with_gain(settings: ControllerSettings, gain: float) -> ControllerSettings:
    """
    Return the controller that does to the nominal plant what this one does to ``gain`` times it.

    The plant of input gain g gets g u: so all commands are counted in g u, which makes b0 / g of
    b0, and its effort is g^2 times that of u.
    """
    if gain == 1.0:
        return settings
    if isinstance(settings, CascadeSettings):  # what an outer loop commands is no input
        return attrs.evolve(settings, inner=with_gain(settings.inner, gain))
    return attrs.evolve(
        settings,
        b0=settings.b0 / gain,
        b0_table=tuple(v / gain if i % 2 else v for i, v in enumerate(settings.b0_table)),
        command_min=settings.command_min * gain,
        command_max=settings.command_max * gain,
        command_rate_limit=settings.command_rate_limit * gain,
        safe_command=settings.safe_command * gain,
    )
