"""
N-ADRC with eq. (20) of the paper to the letter: the outer LESO is fed with v = b0 u + d_1 + d_2.

Its estimate is G_2/(1+G_2) of what the inner observer leaves, so a constant residual is only
halved.
"""

from __future__ import annotations

from nadrc_ros.adrc.structures.structure import Structure

STRUCTURE = Structure(
    name='printed',
    description='two LESOs, the outer one with the input of eq. (20) as printed',
    levels=lambda settings: 2,
    reach=lambda levels: (0, 2),
)
