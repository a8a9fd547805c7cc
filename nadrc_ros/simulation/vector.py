"""
The two kinds of vector that the per-step functions see.

A list of floats (fast in plain Python) and a one-dimensional array (fast when compiled) are both.
"""

from __future__ import annotations

from typing import Protocol


class Vector(Protocol):
    """Floats that are read by index."""

    def __getitem__(self, index: int, /) -> float:
        """Return the entry at ``index``."""
        ...

    def __len__(self) -> int:
        """Return the number of entries."""
        ...


class MutableVector(Vector, Protocol):
    """A buffer that results are written into by index."""

    def __setitem__(self, index: int, value: float, /) -> None:
        """Write the entry at ``index``."""
        ...
