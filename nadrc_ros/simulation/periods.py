"""Times and the periods t_k = k / rate of a run."""

from __future__ import annotations

from math import ceil


def first_period(time: float, rate: float) -> int:
    """Return the first k with k / rate at or after ``time`` [s]."""
    k = max(ceil(time * rate) - 2, 0)
    while k / rate < time:
        k += 1
    return k
