"""What a process holds of the machine, over time."""

from __future__ import annotations

from itertools import pairwise
from math import comb
from pathlib import Path
from typing import NamedTuple

# Memory grows by jumps: a page that is used for the first time, a table that is made larger. So
# the residuals of a line through it are no noise, and their size tells nothing about its slope;
# what grew in one of these blocks and in another, however, are independent.
BLOCKS = 12
LEFT_OUT = 1


class Held(NamedTuple):
    """At a time [s]: resident memory that is not shared with others [kB], and open files."""

    time: float
    memory: int
    files: int


class Growth(NamedTuple):
    """Median growth over the blocks [kB/min], and a confidence interval of it: see ``LEVEL``."""

    median: float
    low: float
    high: float

    def leaks(self, least: float = 0.0) -> bool:
        """Whether it is more than ``least``: what leaks grows all the time, all else sometimes."""
        return self.low > least


# The sign test: the median is below the second of twelve values once in 315 times, whatever their
# distribution.
LEVEL = 1.0 - 2.0 * sum(comb(BLOCKS, i) for i in range(LEFT_OUT + 1)) / 2.0**BLOCKS


def held(pid: int, time: float) -> Held:
    """Return what a running process holds now."""
    process = Path('/proc', str(pid))
    lines = (process / 'status').read_text(encoding='utf-8').splitlines()
    (memory,) = (int(line.split()[1]) for line in lines if line.startswith('RssAnon:'))
    return Held(time, memory, len(list((process / 'fd').iterdir())))


def growth(samples: list[Held]) -> Growth:
    """Cut the samples into blocks and see by how much the memory grew in each."""
    last = len(samples) - 1
    ends = [samples[round(last * i / BLOCKS)] for i in range(BLOCKS + 1)]
    rates = sorted(60.0 * (b.memory - a.memory) / (b.time - a.time) for a, b in pairwise(ends))
    middle = 0.5 * (rates[BLOCKS // 2 - 1] + rates[BLOCKS // 2])
    return Growth(middle, rates[LEFT_OUT], rates[-1 - LEFT_OUT])
