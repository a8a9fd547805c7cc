"""What the first pulses tell: the sign of b0, where the machine breaks away, a rough model."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import Any

import attrs
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.tuning.commission.fit import fit, Fitted, scan, Segment
from nadrc_ros.tuning.commission.machine import Samples
from nadrc_ros.tuning.commission.model import Model
from nadrc_ros.tuning.commission.segments import pulses, segments
import numpy as np

ORDERS = (1, 2)
# A model with friction or a stop has to be better than one without by that factor.
_BETTER = 1.03
# Friction, as shares of the largest command that did not move it, from which a search begins.
_FRICTIONS = (0.5, 0.8, 1.0)
# A model that leaves more than that many times the noise proves nothing against what was seen.
_STRANGE = 3.0
_FEWEST = 12
# Damping of a model that grows by a third within a pulse is none of a machine that rests.
_RUNAWAY = 0.3
# So many pulses of both directions say the same.
_UNANIMOUS = 3


@attrs.frozen(kw_only=True, eq=False)
class Nudge:
    """
    What the staircase tells.

    ``sign`` of b0, 0 unknown; ``breakaway`` [command unit] of both directions, down and up: the
    largest pulse without motion and the smallest with one, nan where there is none; ``fitted``,
    the rough model.
    """

    samples: Samples
    sign: int
    breakaway: dict[int, tuple[float, float]]
    fitted: Fitted | None
    refusal: str = ''

    @property
    def lines(self) -> list[str]:
        """Say so."""
        lines = []
        for way, (without, moving) in self.breakaway.items():
            to = 'up' if way > 0 else 'down'
            lines.append(
                f'Command {to}: it moved at {moving:.4g}, and did not at {without:.4g}.'
                if moving == moving
                else f'Command {to}: nothing moved up to {without:.4g}.'
            )
        if self.fitted:
            model = self.fitted.model
            more = 'raises' if self.sign > 0 else 'lowers'
            lines.append(
                f'A higher command {more} the output; at first sight order {model.order}, b0 '
                f'about {model.b0:.3g}, dead time about {1e3 * model.delay:.3g} ms.'
            )
        return [*lines, *filter(None, [self.refusal])]


def judge_nudge(samples: Samples, settings: ExperimentSettings, level: float) -> Nudge:
    """Return what the samples of a staircase tell; ``level`` is the output at rest."""
    parts = pulses(samples)
    moving = [_moves(samples, *part) for part in parts]
    sizes = [float(samples.excitation[first]) for first, _ in parts]
    breakaway = {}
    for way in (-1, 1):
        own = [(abs(size), moves) for size, moves in zip(sizes, moving) if size * way > 0.0]
        if own:
            least = min((size for size, moves in own if moves), default=nan)
            without = [size for size, moves in own if not moves and not size > least]
            breakaway[way] = (max(without, default=0.0), least)
    if not any(moving):
        last = max(map(abs, sizes), default=0.0)
        why = samples.reason if samples.outcome not in ('still', 'done') else ''
        said = f'Nothing moved at commands up to {last:.4g} from the resting one: '
        said += why or 'allow more with --max-command, or more time with --longest.'
        return Nudge(samples=samples, sign=0, breakaway=breakaway, fitted=None, refusal=said)
    kept = [
        part
        for k, part in enumerate(parts)
        # what did not move tells of friction just before it did
        if moving[k] or any(moving[k + 1 : k + 3])
    ]
    found = segments(samples, kept, settings.period, settings.center, settings.noise, level)
    ways = [
        np.sign(_farthest_from_start(samples, *part) * size)
        for part, size, moves in zip(parts, sizes, moving)
        if moves
    ]
    vote = 1 if sum(ways) >= 0.0 else -1
    size = max(abs(size) for size, moves in zip(sizes, moving) if moves)
    rows = [end - first for (first, end), moves in zip(parts, moving) if moves]
    pace = max(0.25 * float(np.median(rows)), 4.0) * settings.period
    both = len({size > 0.0 for size, moves in zip(sizes, moving) if moves}) == 2
    unanimous = vote if both and abs(sum(ways)) == len(ways) >= _UNANIMOUS else 0
    dry = max(min((without for without, _ in breakaway.values()), default=0.0), 1e-3 * size)
    stop = None
    if any(moves != moves for _, moves in breakaway.values()):  # it lies on a stop, perhaps
        stop = vote * max(way for way, (_, moves) in breakaway.items() if moves == moves)
    fitted = best(found, dry, settings.period, pace, size, unanimous, stop)
    if fitted is None:
        said = 'The pulses are too short to tell anything: allow more travel or speed.'
        return Nudge(samples=samples, sign=vote, breakaway=breakaway, fitted=None, refusal=said)
    sign = 1 if fitted.model.b0 > 0.0 else -1
    sure = fitted.b0.low * fitted.b0.high > 0.0
    refusal = ''
    if sign != vote and not (sure and fitted.residual < _STRANGE * settings.noise):
        refusal = (
            'The output went one way and the other: the sign of b0 is not sure. An elastic joint '
            'or a drift may do that; allow more command or travel.'
        )
    return Nudge(
        samples=samples,
        sign=sign if not refusal else 0,
        breakaway=breakaway,
        fitted=fitted,
        refusal=refusal,
    )


def best(
    found: Sequence[Segment],
    dry: float,
    h: float,
    pace: float,
    size: float,
    sign: int,
    stop: float | None = None,
) -> Fitted | None:
    """
    Return the simplest model of those that fit best.

    ``dry`` is the least friction, or load, if there is any; ``sign`` is that of b0, 0 if it is not
    known; of a machine that may lie on a stop,
    ``stop`` is the sign of the output's way from there.
    """
    chosen = None
    if sum(len(each.measurement) for each in found) < _FEWEST:
        return None
    for order in ORDERS:
        free = Model(order=order, b0=1.0)
        own: Fitted | None = None
        kinds = [
            [attrs.evolve(free, damping=damping) for damping in (0.0, 1.0 / pace, 0.3 / h)],
            [
                attrs.evolve(free, friction=share * dry, damping=damping)
                for share in _FRICTIONS
                for damping in (0.0, 1.0 / pace)
            ],
        ]
        if stop is not None:
            ends: dict[str, Any] = {'low': 0.0} if stop > 0.0 else {'high': 0.0}
            kinds.append(
                [
                    attrs.evolve(free, b0=b0, load=share * dry * stop * b0, **ends)
                    for share in (0.0, *_FRICTIONS)
                    for b0 in (1.0, -1.0)
                ]
            )
        for each in kinds:
            start = scan(found, each, h, sign)
            if start is None:
                continue
            fitted = fit(found, start, h, pace, size)
            simple = own is None or fitted.residual * _BETTER < own.residual
            own = fitted if simple else own
        if own is None:
            continue
        # order 2 with much damping is order 1, which is taken unless it runs away
        steady = chosen is not None and chosen.model.damping > -_RUNAWAY / pace
        if chosen is None or own.residual * (_BETTER if steady else 1.0) < chosen.residual:
            chosen = own
    return chosen


def _moves(samples: Samples, first: int, end: int) -> bool:
    return bool((samples.stage[first:end] == 'coast').any())


def _farthest_from_start(samples: Samples, first: int, end: int) -> float:
    y = samples.measurement[first:end]
    base = np.nanmean(samples.measurement[max(first - 3, 0) : first + 1])
    away = np.nan_to_num(y - base)
    return float(away[np.argmax(np.abs(away))])
