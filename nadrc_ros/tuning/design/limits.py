"""What limits the observer bandwidth, and requirements that leave no bandwidth at all."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, floor, log10, pi
from typing import NamedTuple

import attrs
from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.adrc.settings import LARGEST
from nadrc_ros.theory.delayed import command_variance, delayed_loop, Loop
from nadrc_ros.theory.loop import chain, loop_growth
from nadrc_ros.theory.margins import margins
from nadrc_ros.tuning import LARGEST_W_H, LEAST_MODULUS
from nadrc_ros.tuning.design.bandwidths import (
    controller_bandwidth,
    reference_step,
    settings_of,
    settling_factor,
    SLOWEST,
)
from nadrc_ros.tuning.design.requirements import Conflict, LONGEST_SETTLING, Requirements

DELAY_SHARE = 0.5
DEVIATIONS = 3.0
MUCH_SLOWER = 1e3  # times the settling time asked for, up to which a possible one is sought
BISECTIONS = 12
FINE = 22  # of three digits over such a span
LARGEST_STEP = 1e-3 * LARGEST  # what overshoots it is a number of a sensor still
SLOWEST_SHARE = 0.3  # of wc, below which no observer is sought

# Points of a margin that only decides, and what is asked for more than a tuning, with its own
# points, asks for.
COARSE, MORE = 300, 1.02

Test = Callable[[Design, Requirements], bool]


def nominal_loop(design: Design, wanted: Requirements) -> Loop:
    """Return the loop with the right b0, and the delay that is known."""
    return delayed_loop(design, chain(wanted.order, wanted.b0), wanted.period, wanted.delay)


def noise_gain(design: Design, wanted: Requirements) -> float:
    """Return the standard deviation of the command over that of the noise, in closed loop."""
    return float(command_variance(nominal_loop(design, wanted)) ** 0.5)


def slow_enough(design: Design, wanted: Requirements) -> bool:
    """Tell whether w h of every level is at most ``LARGEST_W_H``."""
    return max(design.bandwidths) <= LARGEST_W_H * wanted.rate * (1.0 + 1e-9)


def robust_enough(design: Design, wanted: Requirements) -> bool:
    """Tell whether the loop is stable and the delay at most half of what it bears without it."""
    plant = chain(wanted.order, wanted.b0)
    if wanted.delay == 0.0:
        return loop_growth(design, plant, wanted.period) < 1.0
    return wanted.delay <= DELAY_SHARE * margins(design, plant, wanted.period, 0.0, COARSE).delay


def far_enough(design: Design, wanted: Requirements) -> bool:
    """Tell whether the delay leaves the distance from -1 that a tuning asks for."""
    if wanted.delay == 0.0:
        return True
    plant = chain(wanted.order, wanted.b0)
    found = margins(design, plant, wanted.period, wanted.delay, COARSE)
    return found.modulus >= LEAST_MODULUS * MORE


def quiet_enough(design: Design, wanted: Requirements) -> bool:
    """Tell whether the noise moves the command by no more than it may."""
    return noise_gain(design, wanted) * wanted.noise_std <= noise_budget(wanted)


def noise_budget(wanted: Requirements) -> float:
    """Return the largest standard deviation of the command: 3 of them inside the command limit."""
    room = wanted.command_limit / DEVIATIONS
    return min(wanted.command_noise or room, room)


LIMITS: dict[str, Test] = {
    f'w h = {LARGEST_W_H:g}': slow_enough,
    'the delay': robust_enough,
    f'the distance from -1, {LEAST_MODULUS:g} with the delay': far_enough,
    'the limit of the command noise': quiet_enough,
}


def largest(
    holds: Callable[[float], bool], low: float, high: float, steps: int = BISECTIONS
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
        raise Conflict(f'{complaint.text}; possible: {_slower(wanted)}')
    step = reference_step(wanted)
    if step > LARGEST_STEP:
        raise Conflict(
            f'command_limit = {wanted.command_limit:g} with b0 = {wanted.b0:g} moves the output '
            f'by {step:.3g} in settling_time = {wanted.settling_time:g} s; possible: another b0 '
            f'or unit of time, or a reference_step up to {LARGEST_STEP:g}'
        )


class Complaint(NamedTuple):
    """What requirements fail by, in a word, and what it asks for, in a sentence."""

    cause: str
    text: str


def conflict(wanted: Requirements) -> Complaint | None:
    """Return what keeps even an observer of 3 wc from working, nothing if it works."""
    asked = f'settling_time = {wanted.settling_time:g} s'
    least = SLOWEST * settling_factor(wanted.order) / wanted.settling_time
    most = LARGEST_W_H * wanted.rate
    if least > most:
        return Complaint(
            'the rate',
            f'{asked} is too short for rate = {wanted.rate:g} Hz: the observer needs 3 wc = '
            f'{least:.4g} rad/s, and {LARGEST_W_H:g} rate = {most:.4g} rad/s is the most',
        )
    wc = controller_bandwidth(wanted.order, wanted.settling_time, wanted.period)
    design = make_design(settings_of(wanted, 'conventional', 1, wc, SLOWEST * wc))
    if not robust_enough(design, wanted):
        bears = margins(design, chain(wanted.order, wanted.b0), wanted.period).delay
        return Complaint(
            'the delay',
            f'{asked} is too short for delay = {wanted.delay:g} s: such a loop bears '
            f'{bears:.3g} s, and half of that at most should be used up',
        )
    if not quiet_enough(design, wanted):
        least = noise_gain(design, wanted) * wanted.noise_std
        budget = f'command_noise = {wanted.command_noise:g}'
        if wanted.command_noise != noise_budget(wanted):
            budget = f'command_limit = {wanted.command_limit:g}, of which noise may take a third,'
        return Complaint(
            'the noise',
            f'{budget} cannot be kept with {asked} and noise_std = {wanted.noise_std:g}: an '
            f'observer of 3 wc already causes a standard deviation of {least:.3g}',
        )
    return None


def _slower(wanted: Requirements) -> str:
    """Return the shortest settling time without a conflict, in words, rounded up."""

    def fails(settling: float) -> bool:
        return bool(conflict(attrs.evolve(wanted, settling_time=settling)))

    low = wanted.settling_time
    high = min(low * MUCH_SLOWER, LONGEST_SETTLING)
    if fails(high):
        return f'no settling time up to {high:g} s'
    shortest = largest(fails, low, high, FINE)
    digit = 10.0 ** (floor(log10(shortest)) - 2)
    return f'a settling time of at least {ceil(shortest / digit * (1.0 + 1e-9)) * digit:.4g} s'
