"""Rows of samples as blocks of float32, as a page gets them, and what is kept of them."""

from __future__ import annotations

from collections import deque
from struct import Struct
from threading import Lock

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Sequence, rows, columns, flags and t0: little endian, and the floats behind it are aligned.
HEADER = Struct('<IIIId')
THINNED, DROPPED, GAP = 1, 2, 4


def pack(sequence: int, flags: int, rows: Array) -> bytes:
    """Return the block of some rows, whose first column is the time [s]."""
    t0 = float(rows[0, 0]) if len(rows) else 0.0
    floats = rows.astype(np.float32)
    floats[:, 0] = rows[:, 0] - t0  # before it is rounded
    return HEADER.pack(sequence, *rows.shape, flags, t0) + floats.tobytes()


def unpack(block: bytes) -> tuple[int, int, float, Array]:
    """Return sequence, flags, t0 and rows of a block, times being since t0."""
    sequence, rows, columns, flags, t0 = HEADER.unpack_from(block)
    floats = np.frombuffer(block, np.float32, rows * columns, HEADER.size)
    return sequence, flags, t0, floats.reshape(rows, columns).astype(float)


def thin(rows: Array, bins: int) -> Array:
    """
    Return two rows for each of at most so many bins: the least and the largest of every signal.

    They have the first and the last time of the bin. NaN is left out where there is a number. So a
    plot with no more pixels than bins shows what it would have shown.
    """
    if len(rows) <= 2 * bins:
        return rows
    starts = np.unique(np.linspace(0, len(rows), bins, endpoint=False).astype(int))
    ends = np.append(starts[1:], len(rows)) - 1
    found = np.empty((2 * len(starts), rows.shape[1]))
    found[0::2] = np.fmin.reduceat(rows, starts, axis=0)
    found[1::2] = np.fmax.reduceat(rows, starts, axis=0)
    found[0::2, 0], found[1::2, 0] = rows[starts, 0], rows[ends, 0]
    return found


class Ring:
    """The rows of the last ``seconds``, at most ``most`` of them; any thread may ask."""

    def __init__(self, columns: int, seconds: float, most: int) -> None:
        self.columns = columns
        self._seconds, self._most = seconds, most
        self._chunks: deque[Array] = deque()
        self._count = 0
        self._lock = Lock()

    def add(self, rows: Array) -> None:
        """Add rows that are later than those which are there."""
        if not len(rows):
            return
        with self._lock:
            self._chunks.append(rows)
            self._count += len(rows)
            oldest = rows[-1, 0] - self._seconds
            while self._count > self._most or self._chunks[0][-1, 0] < oldest:
                if len(self._chunks) == 1:
                    break
                self._count -= len(self._chunks.popleft())

    def between(self, begin: float, end: float) -> Array:
        """Return the rows from ``begin`` to ``end`` [s], both included."""
        with self._lock:
            chunks = [c for c in self._chunks if c[-1, 0] >= begin and c[0, 0] <= end]
        if not chunks:
            return np.empty((0, self.columns))
        rows = np.concatenate(chunks)
        return rows[(rows[:, 0] >= begin) & (rows[:, 0] <= end)]

    @property
    def first(self) -> float:
        """Return the time of the oldest row [s], 0 without any."""
        with self._lock:
            return float(self._chunks[0][0, 0]) if self._chunks else 0.0

    @property
    def last(self) -> float:
        """Return the time of the newest row [s], 0 without any."""
        with self._lock:
            return float(self._chunks[-1][-1, 0]) if self._chunks else 0.0
