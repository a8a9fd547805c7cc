"""
Nonlinear ESO, nested: state i is corrected by fal of the innovation, with exponent 2^-i.

Up to |e| = eso_delta it is the nested linear observer, beyond it corrects less than in proportion.
The paper names nonlinear observers as future work. Source of the exponents 1, 1/2, 1/4: J. Han,
From PID to active disturbance rejection control, IEEE Trans. Ind. Electron. 56(3), 2009.
"""

from __future__ import annotations

from nadrc_ros.adrc.structures.structure import Structure

STRUCTURE = Structure(
    name='nonlinear', description='K nonlinear ESOs in parallel (fal gains)', nonlinear=True
)
