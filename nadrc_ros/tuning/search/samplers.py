"""The searches, as Optuna samplers, each made anew for one generation from a seed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any
import warnings

from nadrc_ros.extras import MissingPackage
from nadrc_ros.tuning.search.settings import TuneSettings
import numpy as np
import optuna
from optuna.distributions import BaseDistribution
from optuna.samplers import BaseSampler, CmaEsSampler, NSGAIISampler, RandomSampler
from optuna.samplers.nsgaii import BLXAlphaCrossover, PolynomialMutation
from optuna.search_space import IntersectionSearchSpace
from optuna.study import Study
from optuna.trial import FrozenTrial

# The first generation is that many times larger, to find where it is worth looking.
FIRST = 4
# How close a mutation stays to what it mutates.
CLOSE = 10.0


def make_sampler(tuning: TuneSettings, seed: int, history: Sequence[FrozenTrial]) -> BaseSampler:
    """
    Return the sampler of the next generation after ``history``.

    Raises
    ------
    UserError
        When the package of the sampler is not installed.

    """
    makers: dict[str, Callable[[], BaseSampler]] = {
        'nsga2': lambda: _nsga2(tuning, seed),
        'cmaes': lambda: _cmaes(tuning, seed, history),
        'pso': lambda: SwarmSampler(tuning, seed),
    }
    with warnings.catch_warnings():
        # The options used below are called experimental for years, or since Optuna 5.
        warnings.simplefilter('ignore', optuna.exceptions.ExperimentalWarning)
        try:
            return makers[tuning.method]()
        except ImportError as error:
            raise MissingPackage(f'--sampler {tuning.method}', error.name, 'tune') from None


def _nsga2(tuning: TuneSettings, seed: int) -> BaseSampler:
    return _OneGeneration(
        population_size=tuning.population,
        crossover=BLXAlphaCrossover(),
        mutation=PolynomialMutation(eta=CLOSE),
        seed=seed,
    )


class _OneGeneration(NSGAIISampler):
    """NSGA-II for one generation, whose number it does not count anew for each trial."""

    _number: int | None = None

    def get_trial_generation(self, study: Study, trial: FrozenTrial) -> int:
        """Return the number of the generation, and let the trial know it."""
        key = self._get_generation_key()
        if self._number is None:
            self._number = super().get_trial_generation(study, trial)
        elif key not in trial.system_attrs:
            study._storage.set_trial_system_attr(trial._trial_id, key, self._number)
        return self._number


def _cmaes(tuning: TuneSettings, seed: int, history: Sequence[FrozenTrial]) -> BaseSampler:
    """Start from the distribution of the best of the first generation, which is random."""
    if not history:
        return RandomSampler(seed=seed)
    import cmaes  # noqa: F401

    return CmaEsSampler(
        source_trials=list(history),
        popsize=tuning.population,
        independent_sampler=RandomSampler(seed=seed),
        seed=seed,
    )


class SwarmSampler(RandomSampler):
    """
    Particle swarm optimisation by pymoo, told all earlier generations again; the first is random.

    The swarm is a function of its seed and of what it was told, so nothing else is stored.
    """

    def __init__(self, tuning: TuneSettings, seed: int) -> None:
        from pymoo.algorithms.soo.nonconvex.pso import PSO  # noqa: F401

        super().__init__(seed)
        self.population = tuning.population
        self.first_seed = tuning.seed
        self.space = IntersectionSearchSpace()
        self.waiting: list[dict[str, Any]] | None = None

    def infer_relative_search_space(
        self, study: Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        """Return the space that all finished trials share."""
        return self.space.calculate(study)

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return the next particle; nothing before the first generation is known."""
        if not search_space:
            return {}
        if self.waiting is None:
            self.waiting = self._particles(study, search_space)
        return self.waiting.pop(0)

    def _particles(self, study: Study, space: dict[str, BaseDistribution]) -> list[dict[str, Any]]:
        from optuna._transform import _SearchSpaceTransform
        from pymoo.algorithms.soo.nonconvex.pso import PSO
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination

        scale = _SearchSpaceTransform(space, transform_0_1=True)
        known = [t for t in study.get_trials(deepcopy=False) if t.values is not None]
        size = self.population
        first = sorted(known[: FIRST * size], key=lambda trial: trial.values[0])[:size]
        later = known[FIRST * size :]
        told = [first, *(later[i : i + size] for i in range(0, len(later), size))]
        swarm = PSO(pop_size=size, sampling=np.array([scale.transform(t.params) for t in first]))
        swarm.setup(
            Problem(n_var=len(space), n_obj=1, xl=0.0, xu=1.0),
            termination=NoTermination(),
            seed=self.first_seed,
        )
        for trials in told:
            particles = swarm.ask()
            particles.set('X', np.array([scale.transform(trial.params) for trial in trials]))
            particles.set('F', np.array([trial.values for trial in trials]))
            swarm.tell(infills=particles)
        return [scale.untransform(x) for x in swarm.ask().get('X')]
