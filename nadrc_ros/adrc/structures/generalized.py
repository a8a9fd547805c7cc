"""
Generalized ESO: one level that models the disturbance as a polynomial of degree m - 1.

Source: A. Godbole, J. Kolhe, S. Talole, Performance analysis of generalized extended state
observer in tackling sinusoidal disturbances, IEEE Trans. Control Syst. Technol. 21(6), 2013.
"""

from __future__ import annotations

from nadrc_ros.adrc.structures.structure import Structure

STRUCTURE = Structure(
    name='generalized',
    description='one ESO with m extended states',
    levels=lambda settings: 1,
    extended_states=lambda settings: settings.extended_states,
)
