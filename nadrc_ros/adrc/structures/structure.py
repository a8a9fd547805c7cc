"""What distinguishes one observer structure from another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import attrs

if TYPE_CHECKING:
    from nadrc_ros.adrc.settings import ControllerSettings


def all_before(levels: int) -> Sequence[int]:
    """Level k receives what the levels before it already cancel: sum_{j<k} d_j."""
    return range(levels)


def all_levels(levels: int) -> int:
    """Say that the command subtracts the disturbance estimates of all levels."""
    return levels


@attrs.frozen(kw_only=True)
class Structure:
    """
    Coupling of K observer levels.

    ``levels`` and ``extended_states`` give K and m for the settings; ``reach(K)`` how many
    disturbance estimates, counted from level 1, enter the input of each level; ``cancelled(K)``
    how many the command subtracts; ``chained`` says that a level is corrected by the output
    estimate of the one before it instead of the measurement; ``nonlinear`` that large innovations
    correct less than in proportion.
    """

    name: str
    description: str
    levels: Callable[[ControllerSettings], int] = lambda settings: settings.levels
    extended_states: Callable[[ControllerSettings], int] = lambda settings: 1
    reach: Callable[[int], Sequence[int]] = all_before
    cancelled: Callable[[int], int] = all_levels
    chained: bool = False
    nonlinear: bool = False
