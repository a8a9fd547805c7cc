"""C-ADRC: one extended state observer, eq. (3) of the paper."""

from __future__ import annotations

from nadrc_ros.adrc.structures.structure import Structure

STRUCTURE = Structure(
    name='conventional', description='one LESO (C-ADRC)', levels=lambda settings: 1
)
