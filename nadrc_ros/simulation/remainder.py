"""What the observer levels leave of the total disturbance."""

from __future__ import annotations

from math import isfinite

from nadrc_ros.adrc.design import Design
from nadrc_ros.adrc.state import State
from nadrc_ros.simulation.vector import MutableVector


def accumulate_remainders(
    design: Design, state: State, truth: float, t: float, h: float, sums: MutableVector
) -> None:
    """
    Add the period [t, t + h] to the ITAE of what is left after each level, one sum per level.

    ``sums[k]`` grows by h t |L - d_1 - ... - d_{k+1}|, with L the ``truth`` at ``t`` and the
    estimates after the sample of ``t``: the errors e_3 (inner level) and zeta_3 (both) of the
    paper. What is not finite, or would make a sum overflow, is left out.
    """
    remainder = truth
    if design.error_based:
        remainder -= state.profile[design.order]
    for k in range(design.levels):
        remainder -= state.levels[k][design.order]
        total = sums[k] + h * t * abs(remainder)
        if isfinite(total):
            sums[k] = total
