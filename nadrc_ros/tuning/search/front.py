"""The front of tracking against effort, and the point of it that is taken."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import attrs
from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.tuning.search.score import Figures, undominated
from nadrc_ros.tuning.search.study import Trial
import numpy as np

# Times the least objective: what is worse nobody wants, and it would only shift the knee.
_WORST_OVER_BEST = 10.0
# A knee is that far below the chord, of length 1 in both axes: less is the scatter of a search.
_CLEARLY_BELOW = 0.05


class Point(NamedTuple):
    """A feasible design, with its figures over all seeds and corners."""

    values: dict[str, float]
    figures: Figures


@attrs.frozen
class Choice:
    """The number of a point in the front, from 0, and why it."""

    index: int
    why: str


def front(trials: Sequence[Trial]) -> list[Point]:
    """Return the feasible designs that no other beats in both, by rising effort."""
    points = [
        Point(trial.values, trial.score.figures)
        for trial in trials
        if trial.score.figures is not None and not trial.score.violations
    ]
    found = undominated(points, lambda point: point.figures)
    return [
        p for p in found if p.figures.objective <= _WORST_OVER_BEST * found[-1].figures.objective
    ]


def knee(points: Sequence[Point]) -> int:
    """
    Return where more effort begins to buy little.

    That is the largest distance below the chord between the ends, both axes logarithmic and of
    length 1. A front without a point clearly below it has no knee: then it is the least objective.
    Source: V. Satopaa et al., Finding a "kneedle" in a haystack, ICDCS Workshops, 2011.
    """
    if len(points) < 3:
        return len(points) - 1
    x, y = (_scaled([getattr(p.figures, name) for p in points]) for name in ('isu', 'objective'))
    below = 1.0 - x - y
    return int(np.argmax(below)) if below.max() > _CLEARLY_BELOW else len(points) - 1


def choose(
    points: Sequence[Point], budget: float, isu: float | None, number: int | None
) -> Choice:
    """
    Return the point of a front, which has at least one, that is asked for.

    By default the knee, with a budget the least objective.

    Raises
    ------
    UserError
        When there is none like that.

    """
    if number is not None:
        if not 1 <= number <= len(points):
            raise SettingError('--choose', number, f'a point of the front, 1 to {len(points)}')
        return Choice(number - 1, f'point {number}, as asked for')
    if isu is not None:
        affordable = [i for i, point in enumerate(points) if point.figures.isu <= isu]
        if not affordable:
            raise UserError(
                f'--isu {isu:g}: no design found is that cheap, the cheapest costs '
                f'{points[0].figures.isu:.4g}'
            )
        return Choice(affordable[-1], f'best within ISU {isu:g}')
    if budget:
        return Choice(len(points) - 1, f'best within the budget {budget:g}')
    index = knee(points)
    last = index == len(points) - 1
    return Choice(index, 'least objective, no knee' if last else 'knee of the front')


def _scaled(values: Sequence[float]) -> np.ndarray:
    logs = np.log(np.maximum(values, 1e-300))
    return np.asarray((logs - logs.min()) / max(float(np.ptp(logs)), 1e-300))
