"""One observer or more: designs that put the same noise on the command, and the one to take."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import attrs
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.structures import STRUCTURES
from nadrc_ros.theory.system import Array
from nadrc_ros.tuning import LARGEST_OVERSHOOT, LARGEST_W_H, LEAST_MODULUS
from nadrc_ros.tuning.design.bandwidths import readable, settings_of
from nadrc_ros.tuning.design.limits import (
    check,
    noise_gain,
    nominal_loop,
    robust_enough,
    single_settings,
    slow_enough,
)
from nadrc_ros.tuning.design.prediction import predict, Prediction, rejection
from nadrc_ros.tuning.design.requirements import Conflict, Requirements
import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize

# Nested levels that are compared; a fourth gains nothing at equal noise.
_COMPARED_LEVELS = (2, 3)
_SLOWEST_SHARE = 0.3  # of wc, below which no observer is sought
# A level more has to leave less than this share of the error to be worth its margin.
WORTH = 0.8
_WORDS = {1: 'one observer', 2: 'two nested observers', 3: 'three nested observers'}


@attrs.frozen(kw_only=True, eq=False)
class Candidate:
    """A design, what decided its observer bandwidth, and what theory expects of it."""

    settings: ControllerSettings
    decided_by: str
    prediction: Prediction

    @property
    def levels(self) -> int:
        """Return the number of levels."""
        return STRUCTURES[self.settings.structure].levels(self.settings.levels)

    @property
    def name(self) -> str:
        """Return a word for the files, which is also a ROS namespace."""
        structure = self.settings.structure
        return f'{structure}_{self.levels}' if self.levels > 1 else structure


def candidates(wanted: Requirements) -> list[Candidate]:
    """
    Return one observer, two and three nested ones, and what was asked for beside those.

    All but the first get the observer bandwidth with which they put the noise of the first on the
    command. Left out is what w h or the delay does not allow at that noise.

    Raises
    ------
    Conflict
        When not even the first exists, or not what was asked for.

    """
    check(wanted)
    first = single(wanted)
    found = [first]
    named = asked(wanted)
    for structure, levels in dict.fromkeys([('nested', k) for k in _COMPARED_LEVELS] + named):
        if (structure, levels) == ('conventional', 1):
            continue
        other = equally_noisy(wanted, structure, levels, first)
        if other is not None:
            found.append(other)
        elif (structure, levels) in named:
            raise Conflict(
                f'structure = {structure} with levels = {levels} is too fast for rate = '
                f'{wanted.rate:g} Hz or delay = {wanted.delay:g} s at the command noise of one '
                'observer; possible: a longer settling time, or structure = conventional'
            )
    return found


def asked(wanted: Requirements) -> list[tuple[str, int]]:
    """Return the structure that was asked for and its levels, nothing if advice was."""
    structure, levels = wanted.structure, wanted.levels
    if structure == 'advised':
        if levels == 0:
            return []
        structure = 'nested' if levels > 1 else 'conventional'
    fixed = ControllerSettings(structure=structure, levels=levels or 2)
    return [(structure, STRUCTURES[structure].levels(fixed.levels))]


def single(wanted: Requirements) -> Candidate:
    """Return one observer, and what theory expects of it."""
    settings, decided_by = single_settings(wanted)
    return Candidate(
        settings=settings, decided_by=decided_by, prediction=predict(settings, wanted)
    )


def equally_noisy(
    wanted: Requirements, structure: str, levels: int, other: Candidate
) -> Candidate | None:
    """Return the design as noisy as ``other``; None if there is none that may be used."""
    wc = other.settings.controller_bandwidth
    target = noise_gain(make_design(other.settings), wanted)

    def excess(w: float) -> float:
        design = make_design(settings_of(wanted, structure, levels, wc, w))
        gain = noise_gain(design, wanted)
        return float(np.log(gain / target)) if gain < inf else 1e3

    low, high = _SLOWEST_SHARE * wc, LARGEST_W_H * wanted.rate
    if excess(low) > 0.0 or excess(high) < 0.0:
        return None
    w = float(optimize.brentq(excess, low, high, rtol=1e-9))
    settings = settings_of(wanted, structure, levels, wc, readable(w))
    design = make_design(settings)
    if not (slow_enough(design, wanted) and robust_enough(design, wanted)):
        return None
    return Candidate(
        settings=settings, decided_by='equal noise', prediction=predict(settings, wanted)
    )


def better_below(wanted: Requirements, one: Candidate, more: Candidate) -> float:
    """Return the frequency [rad/s] above which ``more`` first leaves more than ``one``; or inf."""
    loops = [nominal_loop(make_design(c.settings), wanted) for c in (one, more)]

    def worse(x: ArrayLike) -> Array:
        one_left, more_left = (rejection(loop, wanted, np.exp(x)) for loop in loops)
        return np.log(more_left / one_left)

    wc = one.settings.controller_bandwidth
    grid = np.linspace(np.log(1e-2 * wc), np.log(0.99 * np.pi * wanted.rate), 200)
    signs = worse(grid) >= 0.0
    if signs[0] or not signs.any():
        return 0.0 if signs[0] else inf
    i = int(np.argmax(signs))
    return float(np.exp(optimize.brentq(lambda x: float(worse(x)), grid[i - 1], grid[i])))


def advised(found: Sequence[Candidate]) -> Candidate:
    """Return one observer, or more where each level leaves a fifth less and the loop is robust."""
    best = found[0]
    for other in _nested(found):
        predicted = other.prediction
        robust = predicted.margins.modulus >= LEAST_MODULUS
        forgiven = max(LARGEST_OVERSHOOT, best.prediction.pole_overshoot)
        robust = robust and predicted.pole_overshoot <= forgiven
        if robust and predicted.error < WORTH * best.prediction.error:
            best = other
    return best


def advice(wanted: Requirements, found: Sequence[Candidate], best: Candidate) -> str:
    """Return what to take, what it brings at equal noise of the command, and what it costs."""
    one, nested = found[0], _nested(found)
    under = _disturbance(wanted)
    if not nested:
        return 'Take one observer: at its noise this rate and delay allow no nested ones.'
    if best is one:
        reasons: dict[str, list[str]] = {}
        for c in nested:
            leave = f'{_WORDS[c.levels]} leave {_share(c, one)}'
            reasons.setdefault(_why_not(c), []).append(leave)
        said = [
            f'{" and ".join(leave)} of its error under {under}, {why}'
            for why, leave in reasons.items()
        ]
        return (
            f'Take one observer: at the same noise of the command {"; ".join(said)}.'
            f'{_limit(wanted, one, nested[0])}'
        )
    others = ', '.join(f'{_WORDS[c.levels]} {_share(c, one)}' for c in nested if c is not best)
    return (
        f'Take {_WORDS[best.levels]}: at the same noise of the command they leave '
        f'{_share(best, one)} of the error of one under {under}{others and f" ({others})"}.'
        f'{_limit(wanted, one, best)} The price: {_price(one, best)}.'
    )


def _why_not(candidate: Candidate) -> str:
    near = candidate.prediction.margins.modulus
    if near < LEAST_MODULUS:
        return f'but come too near to instability (modulus {near:.2f}, wanted {LEAST_MODULUS:g})'
    if candidate.prediction.pole_overshoot > LARGEST_OVERSHOOT:
        return 'but bear no poles of the plant that are wrong by two'
    return 'which is too little for the margins lost'


def _limit(wanted: Requirements, one: Candidate, more: Candidate) -> str:
    below = better_below(wanted, one, more)
    if below == inf:
        return ''
    helpful = _WORDS[more.levels].capitalize()
    return f' {helpful} help only against disturbances below {below:.3g} rad/s.'


def _nested(found: Sequence[Candidate]) -> list[Candidate]:
    return [c for c in found if c.settings.structure == 'nested' and c.levels in _WORDS]


def _share(more: Candidate, one: Candidate) -> str:
    return f'{100.0 * more.prediction.error / one.prediction.error:.0f} %'


def _disturbance(wanted: Requirements) -> str:
    if wanted.disturbance_frequency == 0.0:
        return 'a step of the disturbance'
    return f'disturbances up to {wanted.disturbance_frequency:g} rad/s'


def _price(one: Candidate, best: Candidate) -> str:
    before, after = one.prediction.margins, best.prediction.margins
    return (
        f'b / b0 from {after.gain_low:.2f} to {after.gain_high:.3g} instead of '
        f'{before.gain_low:.2f} to {before.gain_high:.3g}, delay margin '
        f'{1e3 * after.delay:.3g} instead of {1e3 * before.delay:.3g} ms'
    )
