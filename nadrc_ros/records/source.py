"""The signals of a log that is not the recorder's: what they are called, and as rows of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import re

import attrs
from nadrc_ros.adrc.settings import MAX_LEVELS
from nadrc_ros.records.recording import ESTIMATES, NEEDED, RecordingError, TRUTH
from nadrc_ros.records.rows import OVERDUE, SLOWER
from nadrc_ros.records.spacing import GAP
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
REQUIRED = ('measurement', 'command')
LEVELS = tuple(f'level_{k}' for k in range(1, MAX_LEVELS + 1))
SIGNALS = (*NEEDED, *TRUTH, *ESTIMATES, *LEVELS)
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
    Return signals that came each at its own times on those of the measurements, and the last time.

    A row belongs to one measurement and holds the last value of every other signal that came
    before the next measurement: zero-order hold, and for the command the one that acted meanwhile.
    Reference and output are those at the measurement. The rules are those of
    :class:`~nadrc_ros.records.rows.Rows`, for whole columns at once: a log may have millions.
    The first row is the first measurement with a command, at ``time`` 0.

    Parameters
    ----------
    stamps, values
        Of each signal, when [s] and what, (N,) in order of time.

    """
    grid = stamps['measurement']
    ends = np.append(grid[1:], np.inf)
    first = int(np.searchsorted(ends, stamps['command'][0], 'right'))
    columns = {'time': grid - grid[first]}
    for name in (name for name in SIGNALS if name in stamps):
        index = np.searchsorted(stamps[name], ends, 'left') - 1
        columns[name] = np.where(index >= 0, values[name][np.maximum(index, 0)], np.nan)
    if 'reference' in stamps:
        columns['reference'] = _reference(grid, stamps['reference'], values['reference'])
    if 'output' in stamps:
        columns['output'] = _output(grid, stamps['output'], values['output'])
    columns['measurement'] = values['measurement']
    stop = max(float(times[-1]) for times in stamps.values()) - float(grid[first])
    return {name: column[first:] for name, column in columns.items()}, stop


def _output(grid: Array, stamps: Array, values: Array) -> Array:
    """Return the first output after each time of ``grid``, or the last just before it, or nan."""
    spans = np.append(np.diff(grid), np.inf)
    usual = float(np.median(spans[:-1])) if len(grid) > 1 else np.inf
    after = np.searchsorted(stamps, grid, 'left')
    ahead = np.append(stamps, np.inf)[after] - grid
    behind = grid - np.append(-np.inf, stamps)[after]
    found = np.append(values, np.nan)[after]
    just = np.where(behind < 0.5 * usual, np.append(np.nan, values)[after], np.nan)
    return np.where(ahead < np.minimum(OVERDUE * usual, spans), found, just)


def _reference(grid: Array, stamps: Array, values: Array) -> Array:
    """
    Return a reference at the times of ``grid``, nan before it came.

    Where it moves, and comes about as often as rows do, it lies on the line between two samples;
    a step, or a setpoint that is sent now and then, is held.
    """
    place = np.searchsorted(stamps, grid, 'right') - 1
    held = np.where(place >= 0, values[np.maximum(place, 0)], np.nan)
    usual = float(np.median(np.diff(grid))) if len(grid) > 1 else 0.0
    if len(stamps) < 3 or np.median(np.diff(stamps)) > SLOWER * usual:
        return held
    one = np.clip(place, 1, len(stamps) - 2)
    span = stamps[one + 1] - stamps[one]
    moves = (place == one) & (values[one] != values[one - 1]) & (span > 0.0)
    moves &= (span <= GAP * usual) & np.isfinite(values[one + 1])
    share = (grid - stamps[one]) / np.where(span > 0.0, span, 1.0)
    return np.where(moves, values[one] + (values[one + 1] - values[one]) * share, held)
