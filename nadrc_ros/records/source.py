"""The signals of a log that is not the recorder's: where they are, and as rows of a run."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping

import attrs
from nadrc_ros.adrc.errors import did_you_mean
from nadrc_ros.adrc.settings import MAX_LEVELS
from nadrc_ros.records.recording import ESTIMATES, JOINED, NEEDED, RecordingError, TRUTH
from nadrc_ros.records.rows import Row, Rows, SECOND
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
REQUIRED = ('measurement', 'command')
_LEVELS = tuple(f'level_{k}' for k in range(1, MAX_LEVELS + 1))
SIGNALS = (*NEEDED, *JOINED, *TRUTH, *ESTIMATES, *_LEVELS)
# Samples of a log that are made rows together.
_SAMPLES_AT_ONCE = 10_000


@attrs.frozen(kw_only=True)
class Source:
    """
    Where the signals of a loop are in a log that is not the recorder's.

    Attributes
    ----------
    signals
        The topic of a bag, or the column of a CSV file, by the name of a signal, as
        ``{'measurement': '/x/state'}``; the others are sought by their usual names.
    namespace
        Of the loop in a bag that has several.
    time, time_unit
        The column of time in a CSV file and its unit (s, ms, us, ns, min, h); '' is to find out.

    """

    signals: Mapping[str, str] = attrs.field(factory=dict)
    namespace: str = ''
    time: str = ''
    time_unit: str = ''

    def __attrs_post_init__(self) -> None:
        """Refuse what is no signal."""
        for name in self.signals:
            if name not in SIGNALS:
                raise RecordingError(f'there is no signal {name!r}: {did_you_mean(name, SIGNALS)}')


def rows_of(
    stamps: Mapping[str, Array], values: Mapping[str, Array]
) -> tuple[dict[str, Array], float]:
    """
    Return signals that came each at its own times as the rows that a recorder makes of them.

    Parameters
    ----------
    stamps, values
        Of each signal, when [s] and what, (N,) in order of time.

    Returns
    -------
    tuple
        Columns (M,), with the ``time`` [s] since the first row, see
        :class:`~nadrc_ros.records.rows.Rows`; and when the last sample came.

    """
    names = [name for name in SIGNALS if name in stamps]
    times = np.concatenate([stamps[name] for name in names])
    order = np.argsort(times, kind='stable')
    signal = np.repeat(np.arange(len(names)), [len(stamps[name]) for name in names])
    when = np.rint(SECOND * (times - times[order[0]]))  # perhaps more than 64 bits hold
    value = np.concatenate([values[name] for name in names])
    rows = Rows(names)
    columns = {name: array('d') for name in ('time', *names)}

    def keep(found: Iterable[Row]) -> None:
        for row in found:
            columns['time'].append(row.time)
            for name, number in row.values.items():
                columns[name].append(number)

    for begin in range(0, len(order), _SAMPLES_AT_ONCE):
        part = order[begin : begin + _SAMPLES_AT_ONCE]
        for k, time, number in zip(*(each[part].tolist() for each in (signal, when, value))):
            rows.take(names[k], int(time), number)
        keep(rows.close(int(when[part[len(part) // 2]]) - 1))  # a row needs what comes soon after
    keep(rows.end())
    assert rows.begin is not None
    stop = (rows.stop - rows.begin) / SECOND
    return {name: np.array(column) for name, column in columns.items()}, stop
