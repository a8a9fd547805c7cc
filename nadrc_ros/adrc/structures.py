"""
The observer structures: how K extended state observers are coupled. One entry here is one more.

Sources, beside the paper: K. Lakomy, R. Madonski, Cascade extended state observer for active
disturbance rejection control applications under measurement noise, ISA Transactions 109, 2021;
A. Godbole, J. Kolhe, S. Talole, Performance analysis of generalized extended state observer in
tackling sinusoidal disturbances, IEEE Trans. Control Syst. Technol. 21(6), 2013; J. Han, From PID
to active disturbance rejection control, IEEE Trans. Ind. Electron. 56(3), 2009.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import attrs
from nadrc_ros.adrc.fields import Registry


@attrs.frozen(kw_only=True)
class Structure:
    """
    Coupling of K observer levels.

    ``levels(asked)`` and ``extended_states(asked)`` give K and m for the settings of that name;
    ``reach(K)`` how many disturbance estimates, counted from level 1, enter the input of each
    level, by default those of the levels before it; ``cancelled(K)`` how many the command
    subtracts; ``chained`` says that a level is corrected by the output estimate of the one before
    it instead of the measurement; ``nonlinear`` that large innovations correct less than in
    proportion.
    """

    description: str
    levels: Callable[[int], int] = lambda asked: asked
    extended_states: Callable[[int], int] = lambda asked: 1
    reach: Callable[[int], Sequence[int]] = range
    cancelled: Callable[[int], int] = lambda levels: levels
    chained: bool = False
    nonlinear: bool = False


STRUCTURES = Registry(
    'structure',
    {
        # Lakomy and Madonski: each level filters the output estimate of the one before it.
        'cascade': Structure(description='K LESOs in series (cascade ESO)', chained=True),
        # Eq. (3) of the paper.
        'conventional': Structure(description='one LESO (C-ADRC)', levels=lambda asked: 1),
        # The command is b0 u = v - d_1, so the outer LESO receives v = b0 u + d_1 exactly as eq.
        # (20) prints it. Beside the full N-ADRC it shows which part of it brings an improvement.
        'filtered': Structure(
            description='two LESOs, only the inner disturbance estimate canceled',
            levels=lambda asked: 2,
            cancelled=lambda levels: 1,
        ),
        # Godbole et al.: the disturbance is modelled as a polynomial of degree m - 1.
        'generalized': Structure(
            description='one ESO with m extended states',
            levels=lambda asked: 1,
            extended_states=lambda asked: asked,
        ),
        # Level k estimates what the levels before it leave, as eq. (18) asks.
        'nested': Structure(description='K LESOs in parallel (N-ADRC)'),
        # State i is corrected by fal of the innovation with Han's exponents 2^-i: up to |e| =
        # eso_delta as the nested one. The paper names nonlinear observers as future work.
        'nonlinear': Structure(
            description='K nonlinear ESOs in parallel (fal gains)', nonlinear=True
        ),
        # Eq. (20) to the letter: the outer LESO is fed with v = b0 u + d_1 + d_2. Its estimate is
        # G_2/(1+G_2) of what the inner observer leaves, so a constant residual is only halved.
        'printed': Structure(
            description='two LESOs, the outer one with the input of eq. (20) as printed',
            levels=lambda asked: 2,
            reach=lambda levels: (0, 2),
        ),
    },
)
