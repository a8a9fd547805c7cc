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
# A model with friction has to be better than one without by that factor, one with a stop need not.
_BETTER, _AS_GOOD = 1.03, 0.97
# Friction, as shares of the largest command that did not move it, from which a search begins.
_FRICTIONS = (0.5, 0.8, 1.0)
# Within so many times its noise the output stays on one side of where it rests.
_ONE_WAY = 5.0
# And one of the whole log has to leave no more than so many times the noise.
_EXPLAINED = 1.2
# A model that leaves more than that many times the noise proves nothing against what was seen.
_STRANGE = 1.5
# Nor does one that knows b0 no better than that, as a share of it: it predicts nothing.
SURE = 0.5
# Two pulses of three say what a fit is believed with that does not explain all.
_MAJORITY = 0.3
_FEWEST = 12
# Damping of a model that grows by a third within a pulse is none of a machine that rests.
_RUNAWAY = 0.3
# No dead time is longer than so many times what it took to see a motion, but for the earliest one.
_LATEST = 1.5
# Frequencies of a spring from which a search begins, in radians in the usual pulse.
_STIFF = (0.3, 1.0, 3.0)
# So many pulses of both directions say the same.
_UNANIMOUS = 3


@attrs.frozen(kw_only=True, eq=False)
class Nudge:
    """
    What the staircase tells.

    ``sign`` of b0, 0 unknown; ``breakaway`` [command unit] of both directions, down and up: the
    largest pulse without motion and the smallest with one, nan where there is none; ``fitted``,
    the rough model, of so many ``moves``; ``latest`` [s], which no
    dead time is longer than; ``stop``, the sign of the way from a stop on which it may lie.
    """

    samples: tuple[Samples, ...]
    sign: int
    breakaway: dict[int, tuple[float, float]]
    fitted: Fitted | None
    moves: int = 0
    latest: float = 0.0
    stop: float | None = None
    refusal: str = ''

    @property
    def enough(self) -> bool:
        """Tell whether that is enough to go on with."""
        return self.fitted is not None and not self.refusal and self.moves >= _UNANIMOUS

    @property
    def largest(self) -> float:
        """Return the largest pulse that was sent [command unit]."""
        return max(float(np.nanmax(np.abs(each.excitation))) for each in self.samples)

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


def judge_nudge(runs: tuple[Samples, ...], settings: ExperimentSettings, level: float) -> Nudge:
    """Return what the samples of staircases tell; ``level`` is the output at rest."""
    parts = [_Pulse(samples, *part) for samples in runs for part in pulses(samples)]
    moved = [each for each in parts if each.moves]
    breakaway = {}
    for way in (-1, 1):
        own = [each for each in parts if each.size * way > 0.0]
        if own:
            least = min((abs(each.size) for each in own if each.moves), default=nan)
            without = [abs(e.size) for e in own if not e.moves and not abs(e.size) > least]
            breakaway[way] = (max(without, default=0.0), least)
    nothing = Nudge(samples=runs, sign=0, breakaway=breakaway, fitted=None)
    if not moved:
        last = max((abs(each.size) for each in parts), default=0.0)
        why = runs[-1].reason if runs[-1].outcome not in ('still', 'done') else ''
        said = f'Nothing moved at commands up to {last:.4g} from the resting one: '
        said += why or 'allow more with --max-command, or more time with --longest.'
        return attrs.evolve(nothing, refusal=said)
    kept = [
        each
        for k, each in enumerate(parts)
        # what did not move tells of friction just before it did
        if each.moves or any(other.moves for other in parts[k + 1 : k + 3])
    ]
    ways = [each.way for each in moved]
    vote = 1 if sum(ways) >= 0.0 else -1
    size = max(abs(each.size) for each in moved)
    rows = float(np.median([each.end - each.first for each in moved]))
    pace = max(0.25 * rows, 4.0) * settings.period
    latest = _LATEST * sorted(each.seen for each in moved)[:2][-1] + 2.0 * settings.period
    all_ways = not any(moves != moves for _, moves in breakaway.values())
    unanimous = vote if all_ways and abs(sum(ways)) == len(ways) >= _UNANIMOUS else 0
    dry = max(min((without for without, _ in breakaway.values()), default=0.0), 1e-3 * size)
    stop: float | None = None
    if not all_ways:  # it lies on a stop, perhaps
        stop = vote * max(way for way, (_, moves) in breakaway.items() if moves == moves)
    else:
        stop = _only_way(runs, settings, level)
    what = settings.period, settings.center, settings.noise, level
    whole = [
        segment
        for samples in runs
        for first, _ in pulses(samples)[:1]
        for segment in segments(samples, [(first, len(samples.time))], *what)
    ]
    found = [
        segment
        for samples in runs
        for segment in segments(
            samples, [(each.first, each.end) for each in kept if each.samples is samples], *what
        )
    ]
    h, noise = settings.period, settings.noise
    # all of it in one, where nothing makes it stop
    fitted = best(whole, None, h, pace, size, unanimous, latest, noise)
    if fitted is None or fitted.residual > _EXPLAINED * noise:
        fitted = best(found, dry, h, pace, size, unanimous, latest, noise, stop)
    if fitted is None:
        said = 'The pulses are too short to tell anything: allow more travel or speed.'
        return attrs.evolve(nothing, sign=vote, refusal=said)
    sign = 1 if fitted.model.b0 > 0.0 else -1
    told = fitted.b0.low * fitted.b0.high > 0.0
    explained = (
        fitted.b0.half_width < SURE
        and len(moved) >= _UNANIMOUS
        and fitted.residual < _STRANGE * settings.noise
    )
    most_say_so = told and sign == vote and abs(sum(ways)) >= _MAJORITY * len(ways)
    refusal = ''
    if not (most_say_so or explained):
        refusal = (
            'The sign of b0 is not sure: the output went one way and the other, or as no model '
            'does. An elastic joint or a drift may do that; allow more command or travel.'
        )
    return attrs.evolve(
        nothing,
        sign=sign if not refusal else 0,
        fitted=fitted,
        moves=len(moved),
        latest=latest,
        stop=stop,
        refusal=refusal,
    )


def best(
    found: Sequence[Segment],
    dry: float | None,
    h: float,
    pace: float,
    size: float,
    sign: int,
    latest: float,
    noise: float,
    stop: float | None = None,
) -> Fitted | None:
    """
    Return the simplest model of those that fit best.

    ``dry`` is the least friction, or load, None if there is none; ``sign`` is that of b0, 0 if it
    is not known; of a machine that may lie on a stop, ``stop`` is the sign of the output's way
    from there.
    """
    chosen = None
    if sum(len(each.measurement) for each in found) < _FEWEST:
        return None
    for order in ORDERS:
        free = Model(order=order, b0=1.0)
        own: Fitted | None = None
        kinds = [
            [
                *(attrs.evolve(free, damping=damping) for damping in (0.0, 1.0 / pace, 0.3 / h)),
                *(attrs.evolve(free, stiffness=(k / pace) ** 2) for k in _STIFF if order == 2),
            ]
        ]
        if dry is not None:
            kinds.append(
                [
                    attrs.evolve(free, friction=share * dry, damping=damping)
                    for share in _FRICTIONS
                    for damping in (0.0, 1.0 / pace)
                ]
            )
        if dry is not None and stop is not None:
            ends: dict[str, Any] = {'low': 0.0} if stop > 0.0 else {'high': 0.0}
            kinds.append(
                [
                    attrs.evolve(free, b0=b0, load=share * dry * stop * b0, **ends)
                    for share in (0.0, *_FRICTIONS)
                    for b0 in (1.0, -1.0)
                ]
            )
        for each in kinds:
            start = scan(found, each, h, sign, latest)
            if start is None:
                continue
            fitted = fit(found, start, h, pace, size, latest, noise)
            # of two that are as good, a stop where one was seen
            better = _AS_GOOD if start.low == 0.0 or start.high == 0.0 else _BETTER
            if own is None or fitted.residual * better < own.residual:
                own = fitted
        if own is None:
            continue
        # order 2 with much damping is order 1, which is taken unless it runs away
        steady = chosen is not None and chosen.model.damping > -_RUNAWAY / pace
        if chosen is None or own.residual * (_BETTER if steady else 1.0) < chosen.residual:
            chosen = own
    return chosen


def _only_way(
    runs: tuple[Samples, ...], settings: ExperimentSettings, level: float
) -> float | None:
    """Return the way of an output that never went the other one from where it rests."""
    y = np.concatenate([samples.measurement for samples in runs]) - level
    farthest = float(np.nanmax(y)), -float(np.nanmin(y))
    noisy = _ONE_WAY * settings.noise
    if min(farthest) > noisy or max(farthest) < 3.0 * noisy:
        return None
    return 1.0 if farthest[0] > farthest[1] else -1.0


class _Pulse:
    """
    A pulse of a staircase, in the rows from ``first`` on, and the rest that follows.

    Its ``size`` [command unit], whether the output ``moves``, after what time that was ``seen``
    [s], and which ``way`` it went for a command up.
    """

    def __init__(self, samples: Samples, first: int, end: int) -> None:
        self.samples, self.first, self.end = samples, first, end
        self.size = float(samples.excitation[first])
        coasts = samples.stage[first:end] == 'coast'
        self.moves = bool(coasts.any())
        self.seen = float(samples.time[first + int(np.argmax(coasts))] - samples.time[first])
        # as long as it was driven, and that again
        driven = int(np.argmin(samples.stage[first:end] == 'pulse')) or end - first
        y = samples.measurement[first : min(first + 2 * driven, end)]
        before = samples.measurement[: first + 1]
        away = np.nan_to_num(y - before[np.isfinite(before)][-3:].mean())
        self.way = float(np.sign(away[np.argmax(np.abs(away))] * self.size))
