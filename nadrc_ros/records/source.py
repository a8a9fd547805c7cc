"""The signals of a log that is not the recorder's: what they are called, and as rows of a run."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
import re

import attrs
from nadrc_ros.adrc.settings import MAX_LEVELS
from nadrc_ros.records.recording import ESTIMATES, NEEDED, RecordingError, TRUTH
from nadrc_ros.records.rows import Row, Rows, SECOND
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
REQUIRED = ('measurement', 'command')
LEVELS = tuple(f'level_{k}' for k in range(1, MAX_LEVELS + 1))
SIGNALS = (*NEEDED, *TRUTH, *ESTIMATES, *LEVELS)
# Samples of a log that are made rows together.
AT_ONCE = 10_000
# Of columns, what people call them: the first that there is only one of counts.
USUAL = {
    'time': ('time', 't', 'timestamp', 'stamp', 'seconds', 'zeit', 'date', 'datetime', 'clock'),
    'command': (
        *('command', 'cmd', 'u', 'control_effort', 'control', 'effort', 'controller_output', 'co'),
        *('manipulated_variable', 'mv', 'actuator', 'input', 'pwm', 'duty', 'voltage'),
    ),
    'reference': (
        *('reference', 'ref', 'r', 'setpoint', 'set_point', 'sp', 'target', 'desired', 'goal'),
        *('sollwert', 'soll'),
    ),
    'measurement': (
        *('measurement', 'measured', 'meas', 'y', 'state', 'process_variable', 'pv', 'feedback'),
        *('output', 'actual', 'sensor', 'istwert', 'ist', 'position', 'speed', 'velocity'),
        *('temperature', 'height', 'rpm'),
    ),
}


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
                raise RecordingError(f'{name} is no signal; those are {", ".join(SIGNALS)}')


def guessed(names: Iterable[str], given: Mapping[str, str]) -> dict[str, str]:
    """
    Return the columns by signal: those that were given, and those of a usual name.

    Raises
    ------
    RecordingError
        When time, measurement or command are not among them.

    """
    free = [name for name in names if name not in given.values()]
    found = dict(given)
    for signal, usual in USUAL.items():
        if signal in found:
            continue
        for word in usual:
            called = [name for name in free if _word(name) == word]
            if len(called) == 1:
                found[signal] = called[0]
                free.remove(called[0])
                break
    for signal in ('time', *REQUIRED):
        if signal not in found:
            left = ', '.join(free) or 'no column is left'
            raise RecordingError(f'which column is the {signal}? name it with --{signal}: {left}')
    return found


def _word(name: str) -> str:
    """Return the last part of a name that says something, in lower case and without a unit."""
    bare = re.sub(r'\s*[\[(].*[\])]$', '', name.strip().lower())
    parts = [part for part in re.split(r'[/.]', bare) if part not in ('', 'data')]
    word = re.sub(r'[\s-]+', '_', parts[-1].strip('_ ')) if parts else ''
    return re.sub(r'_(s|sec|ms|us|ns|min)$', '', word)


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
    when = np.rint(SECOND * (times - times[order[0]])).astype(np.int64)
    value = np.concatenate([values[name] for name in names])
    rows = Rows(names)
    columns = {name: array('d') for name in ('time', *names)}

    def keep(found: Iterable[Row]) -> None:
        for row in found:
            columns['time'].append(row.time)
            for name, number in row.values.items():
                columns[name].append(number)

    for begin in range(0, len(order), AT_ONCE):
        part = order[begin : begin + AT_ONCE]
        for k, time, number in zip(*(each[part].tolist() for each in (signal, when, value))):
            rows.take(names[k], time, number)
        keep(rows.close(int(when[part[len(part) // 2]]) - 1))  # a row needs what comes soon after
    keep(rows.end())
    assert rows.begin is not None
    stop = (rows.stop - rows.begin) / SECOND
    return {name: np.array(column) for name, column in columns.items()}, stop
