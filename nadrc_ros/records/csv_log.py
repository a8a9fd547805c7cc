"""The signals of a loop from a CSV file that the recorder did not write."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
import re

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.records.recording import RecordingError
from nadrc_ros.records.source import Array, REQUIRED, rows_of, Source
from nadrc_ros.scenario.csv_file import CsvFile, open_csv, Series
import numpy as np

# Of columns, what people call them: the first that there is only one of counts.
_USUAL_NAMES = {
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


def read_csv_log(
    path: Path, source: Source
) -> tuple[dict[str, Array], float, str, dict[str, str]]:
    """
    Return the signals of a file on the times of its measurements, its end, and what it told.

    That is how it was understood, and the units of ``output`` and ``command`` in its headings.

    A row of the file has a measurement and the command that was sent in reply; cells may be empty,
    as where each signal has rows of its own. See :func:`rows_of`.

    Raises
    ------
    RecordingError
        When it is no table, a column does not exist or cannot be guessed, or the times do not
        increase.

    """
    if source.namespace:
        raise RecordingError('a namespace is that of topics; name columns with --measurement etc.')
    try:
        file = open_csv(path)
        given = {name: file.names[file.place(column)] for name, column in _given(source).items()}
        columns = guessed(file.names, given)
        time = columns.pop('time')
        series = file.series(time, list(columns.values()), source.time_unit)
    except RecordingError:
        raise
    except UserError as error:
        raise RecordingError(str(error)) from None
    stamps, values = {}, {}
    for signal, column in columns.items():
        known = np.isfinite(series.columns[column])
        if known.any():
            stamps[signal], values[signal] = series.time[known], series.columns[column][known]
    for signal in REQUIRED:
        if signal not in stamps:
            raise RecordingError(f'column {columns[signal]} has no numbers in it')
    told = _told(file, series, {'time': time, **columns}, given, source.time_unit)
    units = {
        name: file.unit_in_brackets(columns[signal])
        for name, signal in (('output', 'measurement'), ('command', 'command'))
    }
    return *rows_of(stamps, values), told, units


def _given(source: Source) -> dict[str, str]:
    return {'time': source.time, **source.signals} if source.time else dict(source.signals)


def _told(
    file: CsvFile, series: Series, columns: dict[str, str], given: dict[str, str], unit: str
) -> str:
    """Say how the file is written, which column is what, and what was guessed."""
    time = columns['time']
    known = unit or file.unit_of(time)
    step = f'{np.median(np.diff(series.time)):.4g} s a row' if len(series.time) > 1 else ''
    words = []
    for signal, column in columns.items():
        note = [] if signal in given or signal == column else ['guessed by its name']
        if signal == 'time':
            note += [*([f'in {known}'] if known else []), *([step] if step else [])]
        words.append(f'{signal} {column}' + (f' ({", ".join(note)})' if note else ''))
    words += [] if 'reference' in columns else ['no reference']
    told = f'{file.told}; {", ".join(words)}'
    if not known and not series.dated:
        told += f'; {time} has no unit, and seconds are assumed: if not, --time-unit ms'
    return told + ('; the last row was cut short and was skipped' if series.cut else '')


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
    for signal, usual in _USUAL_NAMES.items():
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
