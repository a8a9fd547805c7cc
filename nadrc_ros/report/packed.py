"""What the script of a page reads: text and columns of numbers, in a tenth of their size."""

from __future__ import annotations

from base64 import b64encode
import gzip

from nadrc_ros.records.recorded_run import Array
import numpy as np

# Single precision serves where it is finer than this share of the range of a column.
_FINE = 1e-6


def packed(content: str | bytes) -> str:
    """Return content under gzip in base 64, of which no sign has a meaning in HTML."""
    data = content.encode() if isinstance(content, str) else content
    return b64encode(gzip.compress(data, mtime=0)).decode()


class Columns:
    """
    Columns of numbers, each of them once.

    The first bytes of all numbers are together, then the second ones: these are much the same.
    Times are the nanoseconds since the one before.

    Attributes
    ----------
    kinds
        Of each column its kind, ``time``, ``single`` or ``double``, and its length.

    """

    def __init__(self) -> None:
        self.kinds: list[tuple[str, int]] = []
        self._places: dict[bytes, int] = {}

    def add(self, values: Array, time: bool = False) -> int:
        """Return the place of a column."""
        kind, numbers = 'double', values.astype('<f8')
        with np.errstate(over='ignore', invalid='ignore'):
            single = values.astype('<f4')
            coarse = np.nanmax(np.abs(single - values), initial=0.0) > _FINE * _range(values)
        if time:
            kind, numbers = 'time', np.diff(np.rint(1e9 * values), prepend=0.0)
        elif not coarse:
            kind, numbers = 'single', single
        data = numbers.view(np.uint8).reshape(len(numbers), numbers.itemsize).T.tobytes()
        if data not in self._places:
            self._places[data] = len(self.kinds)
            self.kinds.append((kind, len(numbers)))
        return self._places[data]

    @property
    def data(self) -> bytes:
        """Return the bytes of all columns."""
        return b''.join(self._places)


def _range(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if known.size else 0.0
