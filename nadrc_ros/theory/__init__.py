"""
What theory says about the law: bounds, transfer functions, margins, noise of the command.

For design and tests, never for a node. Everything is a pure function of a ``Design`` and a sample
period, and every discrete matrix is that of the update as implemented.
"""
