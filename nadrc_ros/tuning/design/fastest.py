"""From a plant to requirements: the fastest loop with the margins that a tuning asks for."""

from __future__ import annotations

import attrs
from nadrc_ros.adrc.design import make_design
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.margins import margins
from nadrc_ros.tuning import LARGEST_W_H, LEAST_DELAY, LEAST_GAIN, LEAST_MODULUS
from nadrc_ros.tuning.design.bandwidths import controller_bandwidth, settling_factor
from nadrc_ros.tuning.design.candidates import single_settings
from nadrc_ros.tuning.design.limits import COARSE, conflict, largest, MORE
from nadrc_ros.tuning.design.requirements import Conflict, LONGEST_SETTLING, Requirements

# Of the settling time that is found: what is nobody's margin, as the plant is not quite that one.
SLACK = 1.2
SPAN, STEPS = 1e5, 14
DIGITS = 3


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
    longest = min(SPAN * shortest, LONGEST_SETTLING)
    causes = {}

    def sound(pace: float) -> bool:
        causes[pace] = obstacle(attrs.evolve(wanted, settling_time=1.0 / pace))
        return not causes[pace]

    if not sound(1.0 / longest):
        raise Conflict(
            f'no settling time up to {longest:.4g} s: {causes[1.0 / longest]} forbids it'
        )
    pace = largest(sound, 1.0 / longest, 1.0 / shortest, STEPS)
    settling = float(f'{min(SLACK / pace, longest):.{DIGITS}g}')
    beyond = min((each for each, cause in causes.items() if cause), default=pace)
    return attrs.evolve(wanted, settling_time=settling), causes[beyond] or 'the rate'


def obstacle(wanted: Requirements) -> str:
    """Return what makes requirements unsound, in a word or two, nothing if they are sound."""
    wc = controller_bandwidth(wanted.order, wanted.settling_time, wanted.period)
    if wc**wanted.order * abs(wanted.reference_step / wanted.b0) > wanted.command_limit:
        return 'the range of the command'
    complaint = conflict(wanted)
    if complaint:
        return complaint.cause
    settings, _ = single_settings(wanted)
    plant = chain(wanted.order, wanted.b0)
    found = margins(make_design(settings), plant, wanted.period, wanted.delay, COARSE)
    enough = (
        found.modulus >= LEAST_MODULUS * MORE
        and found.gain_low * LEAST_GAIN <= 1.0 <= found.gain_high / LEAST_GAIN
        and found.delay >= LEAST_DELAY * wanted.period
    )
    if enough:
        return ''
    return 'the delay' if wanted.delay else 'the margins'
