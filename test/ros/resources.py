"""What a process holds of the machine, over time."""

from __future__ import annotations

from math import sqrt
from pathlib import Path
from typing import NamedTuple


class Held(NamedTuple):
    """At a time [s]: resident memory that is not shared with others [kB], and open files."""

    time: float
    memory: int
    files: int


class Growth(NamedTuple):
    """Least-squares slope [kB/min], and the half-width of its 95 % confidence interval."""

    slope: float
    doubt: float


def held(pid: int, time: float) -> Held:
    """Return what a running process holds now."""
    process = Path('/proc', str(pid))
    lines = (process / 'status').read_text(encoding='utf-8').splitlines()
    (memory,) = (int(line.split()[1]) for line in lines if line.startswith('RssAnon:'))
    return Held(time, memory, len(list((process / 'fd').iterdir())))


def growth(samples: list[Held]) -> Growth:
    """Fit a line to the memory."""
    n = len(samples)
    t = [sample.time / 60.0 for sample in samples]
    m = [float(sample.memory) for sample in samples]
    mean_t, mean_m = sum(t) / n, sum(m) / n
    spread = sum((x - mean_t) ** 2 for x in t)
    slope = sum((x - mean_t) * (y - mean_m) for x, y in zip(t, m)) / spread
    rest = sum((y - mean_m - slope * (x - mean_t)) ** 2 for x, y in zip(t, m))
    return Growth(slope, 1.96 * sqrt(rest / (n - 2) / spread))
