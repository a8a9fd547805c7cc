"""One observer or more: designs that put the same noise on the command, side by side."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import attrs
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.structures import STRUCTURES
from nadrc_ros.theory.system import Array
from nadrc_ros.tuning import LARGEST_W_H
from nadrc_ros.tuning.design.bandwidths import (
    controller_bandwidth,
    FASTEST,
    readable,
    settings_of,
    SLOWEST,
    USUAL,
)
from nadrc_ros.tuning.design.limits import (
    check,
    largest,
    LIMITS,
    noise_gain,
    nominal_loop,
    robust_enough,
    slow_enough,
    SLOWEST_SHARE,
    Test,
)
from nadrc_ros.tuning.design.prediction import predict, Prediction, rejection
from nadrc_ros.tuning.design.requirements import Conflict, Requirements
import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize

# Nested levels that are compared; a fourth gains nothing at equal noise.
COMPARED = (2, 3)


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
    for structure, levels in dict.fromkeys([('nested', k) for k in COMPARED] + named):
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


def single_settings(wanted: Requirements) -> tuple[ControllerSettings, str]:
    """
    Return one observer, and what decided: 5 wc, or with a noise budget the fastest up to 10 wc.

    Slower, down to 3 wc, where sampling, delay or noise demand it.
    """
    wc = float(f'{controller_bandwidth(wanted.order, wanted.settling_time, wanted.period):.4g}')
    ratio = FASTEST if wanted.command_noise > 0.0 else USUAL
    w, decided_by = ratio * wc, 'the rule of thumb'

    def holding(test: Test) -> Callable[[float], bool]:
        return lambda v: test(make_design(settings_of(wanted, 'conventional', 1, wc, v)), wanted)

    for name, test in LIMITS.items():
        holds = holding(test)
        if not holds(w) and holds(SLOWEST * wc):
            w, decided_by = largest(holds, SLOWEST * wc, w), name
    return settings_of(wanted, 'conventional', 1, wc, readable(w)), decided_by


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

    low, high = SLOWEST_SHARE * wc, LARGEST_W_H * wanted.rate
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
