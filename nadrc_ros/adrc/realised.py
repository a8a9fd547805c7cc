"""
What an inner loop made of the command that it took as its reference.

Source: R. Hanus, M. Kinnaert and J.-L. Henrotte, Conditioning technique, a general anti-windup and
bumpless transfer method, Automatica 23(6), 1987: the realisable reference.
"""

from __future__ import annotations

from math import copysign, exp, log

from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.feedback import fal
from nadrc_ros.adrc.settings import HIGHEST, LOWEST
from nadrc_ros.adrc.state import output_estimate, raw_command, State
from nadrc_ros.adrc.status import MODE_OK
from nadrc_ros.adrc.supervisor import PolicyState

_LOG_HIGHEST = log(HIGHEST)


def realised_reference(
    design: Design, state: State, policy: PolicyState, command: float, unknown: float
) -> float:
    """
    Return the applied command of the outer loop, from the inner one after its tick.

    In control, that is the reference for which the law, in the state that it has, would ask for
    just the ``command`` u that its limits left:

        k_1 g(r_applied - x_1) = k_1 g(r - x_1) + b0 (u - u_raw),

    g the identity or fal, r the profile that the law follows. So it is r where nothing limits.
    Otherwise the plant of the outer loop gets the output of the inner one, as that estimates it;
    ``unknown`` before its first valid measurement.
    """
    if policy.mode != MODE_OK:
        return output_estimate(design, state) if policy.last == policy.last else unknown
    r = state.profile[0]
    raw = raw_command(design, state)
    if command == raw:
        return r
    gain = design.feedback_gains[0]
    if design.known and design.linear:
        gain = state.feedback[0]
    missing = state.gain[0] * (command - raw) / gain
    if design.linear:
        r += missing
    else:
        x, alpha, delta = output_estimate(design, state), design.exponents[0], design.fal_delta
        if design.known:
            x -= state.ripple[0]
        r = x + fal_inverse(fal(r - x, alpha, delta) + missing, alpha, delta)
    return min(max(r, LOWEST), HIGHEST)


def fal_inverse(value: float, alpha: float, delta: float) -> float:
    """Return the e for which :func:`~nadrc_ros.adrc.feedback.fal` gives ``value``."""
    magnitude = abs(value)
    if magnitude <= delta**alpha:
        return value * float(delta ** (1.0 - alpha))
    return copysign(exp(min(log(magnitude) / alpha, _LOG_HIGHEST)), value)
