"""
N-ADRC without its second subtraction: the outer LESO only serves the feedback with its states.

The command is b0 u = v - d_1, so the outer LESO receives v = b0 u + d_1 exactly as eq. (20) of the
paper prints it. Beside the full N-ADRC it shows which part of it brings an improvement.
"""

from __future__ import annotations

from nadrc_ros.adrc.structures.structure import Structure

STRUCTURE = Structure(
    name='filtered',
    description='two LESOs, only the inner disturbance estimate cancelled',
    levels=lambda settings: 2,
    cancelled=lambda levels: 1,
)
