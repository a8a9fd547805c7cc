"""The samples of a run as a page has them: all rows, with breaks where nothing is known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import attrs
from nadrc_ros.records.recorded_run import Array, RecordedRun
from nadrc_ros.records.recording import JOINED
from nadrc_ros.records.spacing import GAP_SPACINGS
from nadrc_ros.records.states import Lasting
from nadrc_ros.report.curves import kept
import numpy as np

# So many rows of a run are in a page, 10 minutes at 500 Hz; a page of several runs has as many as
# of two, shared.
MOST_ROWS = 300_000
MOST_OF_ALL = 2 * MOST_ROWS
# An event so many seconds away from the begin of a gap is about it.
_NEAR = 0.25


class Gap(NamedTuple):
    """From when to when [s] there was no measurement, and why."""

    begin: float
    end: float
    cause: str


@attrs.frozen(eq=False)
class Trace:
    """
    What is drawn of a run.

    Attributes
    ----------
    columns
        ``time`` [s] and the signals by name, (N,); a row of nan breaks all lines.
    gaps
        Where there was no measurement.
    states
        What the controller did, as far as it told.
    every
        Of so many rows the lowest and the highest of each signal are there; 1 = all rows.

    """

    columns: dict[str, Array]
    gaps: list[Gap]
    states: list[Lasting]
    every: int


def trace_of(run: RecordedRun, most: int = MOST_ROWS) -> Trace:
    """Return what is drawn of a run, an angle of which turns on; thinned to ``most`` rows."""
    columns = {
        'time': run.time,
        'reference': run.reference,
        'output': run.output,
        'error': run.error,
        'command': run.command,
        **{name: run.column(name) for name in JOINED},
        'truth': run.total_disturbance,
        'estimate': run.disturbance_estimate,
        'miss': run.disturbance_estimate - run.total_disturbance,
        **{level: run.columns[level] for level in run.levels if len(run.levels) > 1},
    }
    if run.knows_output:
        columns['measurement'] = run.columns['measurement']
    columns = {name: each for name, each in columns.items() if np.isfinite(each).any()}
    rows, every = len(run.time), 1
    if rows > most:
        signals = [each for name, each in columns.items() if name != 'time']
        points = max(8, most // len(signals))
        chosen = np.unique(np.concatenate([kept(each, points) for each in signals]))
        columns = {name: each[chosen] for name, each in columns.items()}
        every = -(-3 * rows // points)
    return Trace(_broken(columns, run.figure_gaps), _gaps(run), run.states, every)


def _broken(columns: Mapping[str, Array], gaps: list[tuple[float, float]]) -> dict[str, Array]:
    """Return columns with a row of nan at the begin of each gap, so that no line crosses it."""
    begins = np.array([begin for begin, _ in gaps])
    places = np.searchsorted(columns['time'], begins)
    return {
        name: np.insert(each, places, begins if name == 'time' else np.nan)
        for name, each in columns.items()
    }


def _gaps(run: RecordedRun) -> list[Gap]:
    """Return where there was no measurement for so long that it is a gap, with its cause."""
    measured = run.time[np.isfinite(run.columns['measurement'])]
    if not measured.size:
        return []
    ends = np.append(measured[1:], max(run.stop, run.time[-1]))
    silent = np.flatnonzero(ends - measured > GAP_SPACINGS / run.rate)
    spans = [(float(measured[k]), float(ends[k])) for k in silent]
    return [Gap(begin, end, _cause(run, begin, end)) for begin, end in spans]


def _cause(run: RecordedRun, begin: float, end: float) -> str:
    """Return why there was no measurement from ``begin`` to ``end`` [s], in words."""
    near = _NEAR + 2.0 / run.rate
    gaps, faults = (
        [
            (e.time, e.message)
            for e in run.events
            if e.time is not None and e.kind == kind and e.time < begin + near
        ]
        for kind in ('gap', 'fault')
    )
    told = [said for time, said in gaps if 'measurement' in said and time > begin - near]
    text = told[-1] if told else f'no measurement for {end - begin:.4g} s'
    fault = faults[-1][1] if faults else 'none'
    return text if fault == 'none' else f'{text}, fault "{fault}"'
