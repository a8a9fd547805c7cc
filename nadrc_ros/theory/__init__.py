"""
What theory says about the law: bounds, transfer functions, margins, noise.

For design and tests, never for a node: here, and only here in ``adrc``, numpy and scipy may be
imported. Everything is a pure function of a ``Design`` and a sample period, and every discrete
matrix is that of the update as implemented.
"""
