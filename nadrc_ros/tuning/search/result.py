"""What a tuning found: the numbers of each controller, and the files that keep them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
import platform
from typing import Any

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import dump, Scenario
from nadrc_ros.scenario.parameter_files import node_parameters, parameter_text
from nadrc_ros.simulation.batch import run_metrics
from nadrc_ros.simulation.metrics import MetricValues
from nadrc_ros.theory.margins import Margins
from nadrc_ros.tuning.search.front import Choice, choose, front, knee, Point
from nadrc_ros.tuning.search.score import FIRST_SEED, Judge
from nadrc_ros.tuning.search.settings import TuneSettings
from nadrc_ros.tuning.search.study import TuningStudy
from nadrc_ros.tuning.search.variables import designed, Variable
import numpy as np

# Seeds that the search does not see, to say what to expect.
_UNSEEN_SEEDS = range(FIRST_SEED + 100_000, FIRST_SEED + 100_016)


@attrs.frozen(kw_only=True)
class Tuned:
    """
    The front of one controller and the design that was taken from it.

    ``predicted`` are its figures of merit in the scenario with its own seed, ``unseen`` mean and
    standard deviation with seeds that the search did not use.
    """

    name: str
    study: str
    trials: int
    varied: Sequence[Variable]
    front: list[Point]
    knee: int
    choice: Choice
    settings: ControllerSettings
    predicted: MetricValues
    unseen: dict[str, float]
    margins: Margins


def tuned(study: TuningStudy, name: str, isu: float | None, number: int | None) -> Tuned:
    """
    Return what a study found.

    Raises
    ------
    UserError
        When no design meets the constraints, or none is as asked for.

    """
    trials, judge = study.trials(), study.judge
    points = front(trials)
    if not points:
        broken = Counter(key for trial in trials for key in trial.score.violations)
        counted = ', '.join(f'{key} {count}' for key, count in broken.most_common())
        raise UserError(
            f'{name}: none of {len(trials)} designs meets the constraints (violated: {counted})'
        )
    choice = choose(points, judge.tuning.budget, isu, number)
    settings = designed(judge.settings, points[choice.index].values)
    own = attrs.evolve(judge.scenario, controllers={name: settings})
    return Tuned(
        name=name,
        study=study.name,
        trials=len(trials),
        varied=study.varied,
        front=points,
        knee=knee(points),
        choice=choice,
        settings=settings,
        predicted=own.run(name).metrics,
        unseen=_unseen(own, settings, judge),
        margins=judge.margins(settings),
    )


def _unseen(scenario: Scenario, settings: ControllerSettings, judge: Judge) -> dict[str, float]:
    seeds = _UNSEEN_SEEDS if scenario.noise.random else _UNSEEN_SEEDS[:1]
    experiment, objective = scenario.experiment, judge.tuning.objective
    runs = [run_metrics(experiment, settings, seed, judge.compiled) for seed in seeds]
    values = [getattr(run, objective) for run in runs]
    return {
        'seeds': len(seeds),
        objective: float(np.mean(values)),
        f'{objective}_std': float(np.std(values)),
        'isu': float(np.mean([run.isu for run in runs])),
    }


def texts(scenario: Scenario, found: Sequence[Tuned]) -> dict[str, str]:
    """Return by file name the scenario with the tuned controllers, and each one's parameters."""
    controllers = scenario.controllers | {one.name: one.settings for one in found}
    parameters = {
        f'{one.name}.yaml': parameter_text(node_parameters(one.settings, scenario.rate))
        for one in found
    }
    return {'scenario.yaml': dump(attrs.evolve(scenario, controllers=controllers)), **parameters}


def document(name: str, tuning: TuneSettings, found: Sequence[Tuned]) -> dict[str, Any]:
    """Return what ``tune.json`` keeps."""
    return {
        'scenario': name,
        'tuning': attrs.asdict(tuning),
        'versions': _versions(tuning.method),
        'controllers': {one.name: _controller(one) for one in found},
    }


def _controller(one: Tuned) -> dict[str, Any]:
    return {
        'study': one.study,
        'trials': one.trials,
        'ranges': {v.name: [v.low, v.high] for v in one.varied},
        'front': [{**attrs.asdict(p.figures), 'values': p.values} for p in one.front],
        'knee': one.knee + 1,
        'chosen': one.choice.index + 1,
        'why': one.choice.why,
        'predicted': one.predicted.as_dict(),
        'unseen': one.unseen,
        'margins': one.margins.as_dict(),
    }


def _versions(method: str) -> dict[str, str]:
    """Return the versions of all that a result depends on."""
    packages = ['nadrc_ros', 'numpy', 'optuna']
    packages += {'cmaes': ['cmaes'], 'pso': ['pymoo']}.get(method, [])
    found = {'python': platform.python_version()}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = 'source tree'
    return found
