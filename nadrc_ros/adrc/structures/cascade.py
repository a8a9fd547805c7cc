"""
Cascade ESO: each level filters the output estimate of the one before it.

Source: K. Lakomy, R. Madonski, Cascade extended state observer for active disturbance rejection
control applications under measurement noise, ISA Transactions 109, 2021.
"""

from __future__ import annotations

from nadrc_ros.adrc.structures.structure import Structure

STRUCTURE = Structure(name='cascade', description='K LESOs in series (cascade ESO)', chained=True)
