"""
What limits the observer bandwidth: the fastest single observer, the fastest loop that is sound.

Requirements that leave no bandwidth are refused with the numbers, and what would be possible.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import ceil, floor, inf, log10, pi
from typing import NamedTuple

import attrs
from nadrc_ros.adrc.design import Design, make_design, polynomial
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST
from nadrc_ros.theory.delayed import (
    command_variance,
    delayed_loop,
    is_stable_loop,
    Loop,
    REFERENCE,
    step_responses,
)
from nadrc_ros.theory.loop import chain, loop_growth
from nadrc_ros.theory.margins import Margins, margins
from nadrc_ros.theory.system import StateSpace
from nadrc_ros.tuning import (
    LARGEST_OVERSHOOT,
    LARGEST_W_H,
    LEAST_DELAY,
    LEAST_GAIN,
    LEAST_MODULUS,
    WRONG_POLES,
)
from nadrc_ros.tuning.design.bandwidths import (
    command_of_step,
    controller_bandwidth,
    readable,
    reference_step,
    settings_of,
    settling_factor,
)
from nadrc_ros.tuning.design.requirements import Conflict, FOLLOWED, LONGEST_SETTLING, Requirements
import numpy as np

# Observer over controller bandwidth.
_SLOWEST_RATIO, _USUAL_RATIO, _FASTEST_RATIO = 3.0, 5.0, 10.0
_DEVIATIONS = 3.0  # of the command, that fit into its limits
_LARGEST_STEP = 1e-3 * HIGHEST  # what overshoots it is a number of a sensor still
# Points of a margin that only decides, and what is asked for more than a tuning, with its own
# points, asks for.
_COARSE_POINTS, _MODULUS = 300, 1.02 * LEAST_MODULUS
_BISECTIONS = 12
# Of its distance from -1 without a delay, what a loop with one keeps that cannot have more.
_KEPT = 0.75
# What is asked for with known frequencies: beside each of them a loop may come nearer to -1 in a
# narrow band.
_KEPT_BESIDE = 0.5
# A possible settling time is sought up to so many times the one asked for, to three digits; where
# longer need not be better, also below it, in so many steps first.
_MUCH_SLOWER, _FINE_BISECTIONS, _COARSE_STEPS, _LAST_BISECTIONS = 1e3, 22, 8, 10
# The fastest sound loop is sought between the shortest settling time and so many times that.
_PACES, _PACE_BISECTIONS = 1e5, 14
# Of the settling time that is found: what is nobody's margin, as the plant is not quite that one.
_SLACK = 1.2
# The observer that forgives wrong poles is sought in so many steps, and taken by so much faster.
_OBSERVER_BISECTIONS, _FASTER = 6, 1.012

Test = Callable[[Design, Requirements], bool]


def known_plant(wanted: Requirements) -> StateSpace:
    """Return the plant as far as it is known: integrators, or poles, with the right b0."""
    return chain(wanted.order, wanted.b0, polynomial(wanted.poles))


def nominal_loop(design: Design, wanted: Requirements) -> Loop:
    """Return the loop with the right b0, and the delay that is known."""
    return delayed_loop(design, known_plant(wanted), wanted.period, wanted.delay)


def loop_margins(
    design: Design, wanted: Requirements, delay: float, points: int = 3000
) -> Margins:
    """Return the margins with the right b0 and a ``delay`` [s], sought at so many frequencies."""
    return margins(design, known_plant(wanted), wanted.period, delay, points)


def noise_gain(design: Design, wanted: Requirements) -> float:
    """Return the standard deviation of the command over that of the noise, in closed loop."""
    return float(command_variance(nominal_loop(design, wanted)) ** 0.5)


def pole_overshoot(settings: ControllerSettings, wanted: Requirements, factor: float) -> float:
    """
    Return the share by which a step overshoots if the plant has poles ``factor`` times as fast.

    It is 0 without known poles, and inf for an unstable loop.
    """
    if not any(wanted.poles):
        return 0.0
    plant = chain(wanted.order, wanted.b0, polynomial([factor * p for p in wanted.poles]))
    loop = delayed_loop(make_design(settings), plant, wanted.period, wanted.delay)
    if not is_stable_loop(loop):
        return inf
    (response,), _ = step_responses(loop, [REFERENCE], FOLLOWED * wanted.settling_time)
    return max(float(response.max()) - 1.0, 0.0)


def slow_enough(design: Design, wanted: Requirements) -> bool:
    """Tell whether w h of every level is at most ``LARGEST_W_H``."""
    return max(design.bandwidths) <= LARGEST_W_H * wanted.rate * (1.0 + 1e-9)


def robust_enough(design: Design, wanted: Requirements) -> bool:
    """Tell whether the loop is stable, also with a delay that is a period off either way."""
    plant, h = known_plant(wanted), wanted.period
    if wanted.delay == 0.0:
        return loop_growth(design, plant, h) < 1.0
    delays = wanted.delay, wanted.delay + h, max(wanted.delay - h, 0.0)
    return all(is_stable_loop(delayed_loop(design, plant, h, delay)) for delay in delays)


def far_enough(design: Design, wanted: Requirements) -> bool:
    """Tell whether the delay leaves the distance from -1 that a tuning asks for."""
    if wanted.delay == 0.0:
        return True
    return loop_margins(design, wanted, wanted.delay, _COARSE_POINTS).modulus >= _MODULUS


def quiet_enough(design: Design, wanted: Requirements) -> bool:
    """Tell whether the noise moves the command by no more than it may."""
    return noise_gain(design, wanted) * wanted.noise_std <= noise_budget(wanted)


def noise_budget(wanted: Requirements) -> float:
    """Return the largest standard deviation of the command: 3 of them inside the command limit."""
    room = wanted.command_limit / _DEVIATIONS
    return min(wanted.command_noise or room, room)


LIMITS: dict[str, Test] = {
    f'w h = {LARGEST_W_H:g}': slow_enough,
    'the delay': robust_enough,
    f'the distance from -1, {LEAST_MODULUS:g} with the delay': far_enough,
    'the limit of the command noise': quiet_enough,
}


def largest(
    holds: Callable[[float], bool], low: float, high: float, steps: int = _BISECTIONS
) -> float:
    """Return the largest number from ``low``, where it holds, to ``high``, by bisection."""
    if holds(high):
        return high
    for _ in range(steps):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def check(wanted: Requirements) -> None:
    """
    Refuse requirements that exclude each other.

    Raises
    ------
    Conflict
        Names the requirements, the numbers, and what would be possible.

    """
    fastest = pi * wanted.rate
    if wanted.disturbance_frequency >= fastest:
        raise Conflict(
            f'disturbance_frequency = {wanted.disturbance_frequency:g} rad/s cannot be seen at '
            f'rate = {wanted.rate:g} Hz; possible: below {fastest:.4g} rad/s, half the rate'
        )
    complaint = conflict(wanted)
    if complaint:
        raise Conflict(f'{complaint.say()}; possible: {_slower(wanted)}')
    step = reference_step(wanted)
    if step > _LARGEST_STEP:
        raise Conflict(
            f'command_limit = {wanted.command_limit:g} with b0 = {wanted.b0:g} moves the output '
            f'by {step:.3g} in settling_time = {wanted.settling_time:g} s; possible: another b0 '
            f'or unit of time, or a reference_step up to {_LARGEST_STEP:g}'
        )


class Complaint(NamedTuple):
    """What requirements fail by, in a word, and what says in a sentence what it asks for."""

    cause: str
    say: Callable[[], str]


def conflict(wanted: Requirements) -> Complaint | None:
    """Return what keeps even an observer of 3 wc from working, nothing if it works."""
    asked = f'settling_time = {wanted.settling_time:g} s'
    least = _SLOWEST_RATIO * settling_factor(wanted.order) / wanted.settling_time
    most = LARGEST_W_H * wanted.rate
    if least > most:
        return Complaint(
            'the rate',
            lambda: (
                f'{asked} is too short for rate = {wanted.rate:g} Hz: the observer needs 3 wc = '
                f'{least:.4g} rad/s, and {LARGEST_W_H:g} rate = {most:.4g} rad/s is the most'
            ),
        )
    wc = controller_bandwidth(wanted)
    design = make_design(settings_of(wanted, 'conventional', 1, wc, _SLOWEST_RATIO * wc))
    if not _bears(design, wanted, wanted.delay):
        known = wanted.disturbance_frequencies
        if any(known) and _bears(*_without_frequencies(design, wanted), wanted.delay):
            return Complaint(
                'a known frequency',
                lambda: (
                    f'{asked} with delay = {wanted.delay:g} s and disturbance_frequencies = '
                    f'{known} leaves the loop {_modulus(design, wanted):.2g} from instability '
                    f'(modulus): it needs {_least_modulus(design, wanted):.2g}'
                ),
            )
        return Complaint(
            'the delay',
            lambda: (
                f'{asked} is too short for delay = {wanted.delay:g} s: such a loop tolerates '
                f'{_longest_delay(design, wanted):.3g} s, even one that knows it'
            ),
        )
    if not quiet_enough(design, wanted):
        least = noise_gain(design, wanted) * wanted.noise_std
        budget = f'command_noise = {wanted.command_noise:g}'
        if wanted.command_noise != noise_budget(wanted):
            budget = f'command_limit = {wanted.command_limit:g}, of which noise may take a third,'
        return Complaint(
            'the noise',
            lambda: (
                f'{budget} cannot be kept with {asked} and noise_std = {wanted.noise_std:g}: an '
                f'observer of 3 wc already causes a standard deviation of {least:.3g}'
            ),
        )
    return None


def _bears(design: Design, wanted: Requirements, delay: float) -> bool:
    """Tell whether the loop is robust with this delay, which it knows, and far enough from -1."""
    late = attrs.evolve(wanted, delay=delay)
    told, at_once = (attrs.evolve(design, input_delay=each) for each in (delay, 0.0))
    if delay == 0.0 or not robust_enough(told, late):
        return robust_enough(told, late)
    return _modulus(told, late) >= _least_modulus(at_once, wanted)


def _modulus(design: Design, wanted: Requirements) -> float:
    return loop_margins(design, wanted, wanted.delay, _COARSE_POINTS).modulus


def _least_modulus(design: Design, wanted: Requirements) -> float:
    """Return the distance from -1 below which a loop behind a delay is refused."""
    at_once = attrs.evolve(design, input_delay=0.0)
    least = min(_MODULUS, _KEPT * loop_margins(at_once, wanted, 0.0, _COARSE_POINTS).modulus)
    return _KEPT_BESIDE * least if any(wanted.disturbance_frequencies) else least


def _without_frequencies(design: Design, wanted: Requirements) -> tuple[Design, Requirements]:
    plain = attrs.evolve(wanted, disturbance_frequencies=(0.0,))
    w, wc = design.bandwidths[0], design.controller_bandwidth
    return make_design(settings_of(plain, 'conventional', 1, wc, w)), plain


def _longest_delay(design: Design, wanted: Requirements) -> float:
    """Return the longest delay [s] that the loop bears, shorter than that of ``wanted``."""
    least = 1e-3 * wanted.period
    if not _bears(design, wanted, least):
        return 0.0
    return largest(lambda delay: _bears(design, wanted, delay), least, wanted.delay)


def _slower(wanted: Requirements) -> str:
    """
    Return the shortest settling time without a conflict, in words, rounded up.

    Behind a delay a known frequency needs a loop that is fast enough for it, so that the longest
    one may be what is possible, or none with that frequency.
    """

    def fails(settling: float) -> bool:
        return bool(conflict(attrs.evolve(wanted, settling_time=settling)))

    low = wanted.settling_time
    high = min(low * _MUCH_SLOWER, LONGEST_SETTLING)
    known = any(wanted.disturbance_frequencies) and wanted.delay > 0.0
    upward = [*np.geomspace(low, high, _COARSE_STEPS)] if known else [low, high]
    for before, longer in pairwise(upward):
        if not fails(longer):
            shortest = largest(fails, before, longer, _FINE_BISECTIONS)
            digit = 10.0 ** (floor(log10(shortest)) - 2)
            rounded = ceil(shortest / digit * (1.0 + 1e-9)) * digit
            return f'a settling time of at least {rounded:.4g} s'
    if known:
        down = [*np.geomspace(low, low / _MUCH_SLOWER, _COARSE_STEPS)]
        for before, shorter in pairwise(down):
            if not fails(shorter):
                longest = largest(lambda t: not fails(t), shorter, before, _LAST_BISECTIONS)
                return f'a settling time of at most {readable(longest):.4g} s'
        return 'no settling time with these frequencies: leave them out'
    return f'no settling time up to {high:g} s'


def single_settings(wanted: Requirements) -> tuple[ControllerSettings, str]:
    """
    Return one observer, and what decided: 5 wc, or with a noise budget the fastest up to 10 wc.

    Up to there it is faster where that makes a step forgive known poles that are wrong by a factor
    of two; slower, down to 3 wc, where sampling, delay or noise demand it.
    """
    wc = float(f'{controller_bandwidth(wanted):.4g}')
    ratio = _FASTEST_RATIO if wanted.command_noise > 0.0 else _USUAL_RATIO
    w, decided_by = ratio * wc, 'the rule of thumb'

    def design(v: float) -> Design:
        return make_design(settings_of(wanted, 'conventional', 1, wc, v))

    def holding(test: Test) -> Callable[[float], bool]:
        return lambda v: test(design(v), wanted)

    def forgives(v: float) -> bool:
        settings = settings_of(wanted, 'conventional', 1, wc, v)
        return all(pole_overshoot(settings, wanted, f) <= LARGEST_OVERSHOOT for f in WRONG_POLES)

    slowest, top = _SLOWEST_RATIO * wc, _FASTEST_RATIO * wc
    if not forgives(w) and forgives(top):
        strict = largest(lambda v: not forgives(v), w, top, _OBSERVER_BISECTIONS)
        w, decided_by = min(_FASTER * strict, top), 'known poles that may be wrong by two'
    for name, test in LIMITS.items():
        holds = holding(test)
        if holds(w):
            continue
        nearer = test is far_enough and _modulus(design(w), wanted) < _modulus(
            design(slowest), wanted
        )
        if holds(slowest):
            w, decided_by = largest(holds, slowest, w), name
        elif nearer:
            w, decided_by = slowest, name
    return settings_of(wanted, 'conventional', 1, wc, readable(w)), decided_by


def fastest(wanted: Requirements) -> tuple[Requirements, str]:
    """
    Return requirements with the shortest settling time that is sound, and what forbids a shorter.

    The settling time of ``wanted`` does not count. Sound are requirements without a conflict whose
    one observer has the modulus, the gain margins and the delay margin that a tuning asks for by
    default, and whose reference step, if one is named, keeps the command inside its limits.

    Raises
    ------
    Conflict
        When no settling time is sound.

    """
    shortest = settling_factor(wanted.order) / (LARGEST_W_H * wanted.rate)
    longest = min(_PACES * shortest, LONGEST_SETTLING)
    causes = {}

    def sound(pace: float) -> bool:
        causes[pace] = obstacle(attrs.evolve(wanted, settling_time=1.0 / pace))
        return not causes[pace]

    if not sound(1.0 / longest):
        raise Conflict(
            f'no settling time up to {longest:.4g} s: {causes[1.0 / longest]} forbids it'
        )
    pace = largest(sound, 1.0 / longest, 1.0 / shortest, _PACE_BISECTIONS)
    settling = float(f'{min(_SLACK / pace, longest):.3g}')
    beyond = min((each for each, cause in causes.items() if cause), default=pace)
    return attrs.evolve(wanted, settling_time=settling), causes[beyond] or 'the rate'


def obstacle(wanted: Requirements) -> str:
    """Return what makes requirements unsound, in a word or two, nothing if they are sound."""
    each = command_of_step(wanted, controller_bandwidth(wanted))
    if each * abs(wanted.reference_step / wanted.b0) > wanted.command_limit:
        return 'the range of the command'
    complaint = conflict(wanted)
    if complaint:
        return complaint.cause
    settings, _ = single_settings(wanted)
    found = loop_margins(make_design(settings), wanted, wanted.delay, _COARSE_POINTS)
    enough = (
        found.modulus >= _MODULUS
        and found.gain_low * LEAST_GAIN <= 1.0 <= found.gain_high / LEAST_GAIN
        and found.delay >= LEAST_DELAY * wanted.period
    )
    if enough:
        return ''
    return 'the delay' if wanted.delay else 'the margins'
