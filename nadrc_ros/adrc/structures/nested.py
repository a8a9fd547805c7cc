"""N-ADRC: level k estimates what the levels before it leave, as eq. (18) of the paper asks."""

from __future__ import annotations

from nadrc_ros.adrc.structures.structure import Structure

STRUCTURE = Structure(name='nested', description='K LESOs in parallel (N-ADRC)')
