"""
Find the designs of the fair comparison again: differential evolution under a budget of effort.

Every evaluation is kept, because one design serves all budgets that it does not exceed: each
search starts from the best that earlier ones of the same observer met on their way.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, log, log10
from typing import Any

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import Scenario
from nadrc_ros.simulation.batch import RunMetrics
from nadrc_ros.simulation.experiment import Experiment
import numpy as np
import numpy.typing as npt
from paper.candidates import (
    AIMS,
    BUDGETS,
    Candidate,
    CANDIDATES,
    designed,
    Designs,
    INERT,
    load_scenario,
    RANGES,
)
from paper.runs import metrics_of, without_noise
from paper.section import Tell
from scipy.optimize import differential_evolution
from scipy.stats import qmc

SEEDS = (1001, 1002, 1003, 1004)  # not among those of the evaluation
SEARCH_SEED = 1
FIRST_POINTS = 128
# A search starts from the best that are known, and from some of the next best for variety.
ELITE, OTHERS, STRIDE = 12, 12, 9
GENERATIONS = 14
# A design over the budget is worse than any other, and the worse the further it is over.
FORBIDDEN = 1e3
# Over this much with the first seed, the other seeds cannot bring it back.
HOPELESS = 1.1

Array = npt.NDArray[np.float64]


@attrs.frozen
class Score:
    """Averages over the tuning seeds; infinite where nothing useful was measured."""

    noisy_itae: float = inf
    clean_itae: float = inf
    isu: float = inf

    def cost(self, aim: str, budget: float) -> float:
        """Return what the search makes least."""
        if self.isu <= budget:
            return self.noisy_itae if aim == 'noisy' else self.clean_itae
        return FORBIDDEN * (1.0 + log(min(self.isu, 1e9) / budget))


Point = tuple[float, ...]


class Search:
    """All that is known about one candidate, and the search for more."""

    def __init__(self, candidate: Candidate, scenario: Scenario, jobs: int) -> None:
        self.candidate = candidate
        self.scenario = scenario
        self.jobs = jobs
        self.bounds = [tuple(map(log10, RANGES[name])) for name in candidate.tuned]
        if candidate.levels > 1:
            self.bounds.append((1.0, float(candidate.levels)))
        self.known: dict[Point, Score] = {}

    def start(self, simpler: Search | None) -> None:
        """Score points all over the ranges, and the best of a simpler candidate."""
        low, high = np.array(self.bounds).T
        points = low + (high - low) * qmc.Sobol(len(low), seed=SEARCH_SEED).random(FIRST_POINTS)
        if self.candidate.levels > 1:
            points[:, -1] = np.rint(points[:, -1])
        if simpler is not None:
            points = np.vstack([points, *map(self._embedded, simpler.found())])
        self.scores(points, max(BUDGETS))

    def improve(self, aim: str, budget: float) -> None:
        """Search for less, from what is known."""
        ranked = sorted(self.known, key=lambda point: self.known[point].cost(aim, budget))
        differential_evolution(
            lambda columns: [score.cost(aim, budget) for score in self.scores(columns.T, budget)],
            self.bounds,
            init=np.array(ranked[:ELITE] + ranked[ELITE : ELITE + OTHERS * STRIDE : STRIDE]),
            maxiter=GENERATIONS,
            tol=1e-3,
            seed=SEARCH_SEED,
            polish=False,
            vectorized=True,
            updating='deferred',
            integrality=[False] * len(self.candidate.tuned) + [True] * (self.candidate.levels > 1),
        )

    def best(self, aim: str, budget: float) -> Point:
        """Return the best point that is known."""
        return min(self.known, key=lambda point: self.known[point].cost(aim, budget))

    def found(self) -> list[tuple[Candidate, Point]]:
        """Return the best points for all aims and budgets."""
        return [(self.candidate, self.best(aim, budget)) for aim in AIMS for budget in BUDGETS]

    def designs(self) -> dict[str, list[dict[str, Any]]]:
        """Return the best settings by aim, in the order of the budgets."""
        return {
            aim: [self.candidate.values(list(self.best(aim, budget))) for budget in BUDGETS]
            for aim in AIMS
        }

    def _embedded(self, source: tuple[Candidate, Point]) -> list[float]:
        other, point = source
        given = dict(zip(other.tuned, point))
        numbers = [
            given[name] if name in given else log10(INERT[name]) for name in self.candidate.tuned
        ]
        level = point[-1] if other.levels > 1 else 1.0
        return [*numbers, level] if self.candidate.levels > 1 else numbers

    def scores(self, points: Array, budget: float) -> list[Score]:
        """Return the score of each row, measured where it is not known."""
        keys: list[Point] = [tuple(float(f'{x:.9g}') for x in point) for point in points]
        new = [key for key in dict.fromkeys(keys) if not self._is_settled(key, budget)]
        settings = [
            designed(self.scenario, self.candidate.name, self.candidate.values(list(key)))
            for key in new
        ]
        for key, score in zip(
            new, measured(self.scenario.experiment, settings, budget, self.jobs)
        ):
            self.known[key] = score
        return [self.known[key] for key in keys]

    def _is_settled(self, key: Point, budget: float) -> bool:
        score = self.known.get(key)
        return score is not None and (score.noisy_itae < inf or score.isu > HOPELESS * budget)


def measured(
    experiment: Experiment, settings: Sequence[ControllerSettings], budget: float, jobs: int
) -> list[Score]:
    """Return the score of each controller; only the effort of those that are far too costly."""
    first = metrics_of(experiment, settings, SEEDS[:1], jobs)
    scores = [Score(isu=_isu(runs)) for runs in first]
    hopeful = [i for i, score in enumerate(scores) if score.isu <= HOPELESS * budget]
    chosen = [settings[i] for i in hopeful]
    noisy = metrics_of(experiment, chosen, SEEDS[1:], jobs)
    clean = metrics_of(without_noise(experiment), chosen, SEEDS[:1], jobs)
    for i, others, (silent,) in zip(hopeful, noisy, clean):
        runs = [*first[i], *others]
        scores[i] = Score(
            noisy_itae=float(np.mean([run.itae for run in runs])),
            clean_itae=silent.itae,
            isu=_isu([*runs, silent]) if silent.skipped else _isu(runs),
        )
    return scores


def _isu(runs: Sequence[RunMetrics]) -> float:
    """Return the mean effort, infinite if the plant ran away in one of the runs."""
    if any(run.skipped for run in runs):
        return inf
    return float(np.mean([run.isu for run in runs]))


def retune(tell: Tell, jobs: int, candidates: Sequence[Candidate] = CANDIDATES) -> Designs:
    """
    Return a design for each candidate, aim and budget; takes half an hour.

    The seeds of the noise and of the evolution are fixed, so the same machine finds the same.
    """
    scenario = load_scenario()
    searches: dict[str, Search] = {}
    done, problems = 0, len(candidates) * len(AIMS) * len(BUDGETS)
    for candidate in candidates:
        search = searches[candidate.name] = Search(candidate, scenario, jobs)
        search.start(searches.get(candidate.simpler))
        for budget in BUDGETS:
            for aim in AIMS:
                search.improve(aim, budget)
                done += 1
                tell(done / problems)
    return {name: search.designs() for name, search in searches.items()}
