"""A recorded run as a gapless log, and the refusal of one that tells nothing."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, floor

from nadrc_ros.records.recorded_run import RecordedRun
from nadrc_ros.records.recording import RecordingError
from nadrc_ros.records.spacing import GAP_SPACINGS
from nadrc_ros.tuning.identification.motion import noise_deviation
from nadrc_ros.tuning.identification.predictor import Array, Log
import numpy as np

FEWEST_SAMPLES = 200
# With a tenth missing, one by one or four in a row, b0 still lies in its interval, a wider one.
MOST_LOST = 0.1
MOST_AT_A_LIMIT = 0.9
MOST_WITHOUT_REFERENCE = 0.2
# A spread of the output up to that many times its noise is no motion.
STILL = 1.3
# So much faster or slower than they should, measurements are not those of the rate of a run.
OFF_RATE = 0.05
# A reference with that share of its power in one line, after so many turns, is a sine alone.
ONE_LINE, TURNS = 0.9, 3
ADVICE = (
    'record at least some seconds of a reference that moves, best a square or moves to and fro'
)


def log_of(run: RecordedRun) -> Log:
    """
    Return the run with one value each period: what was lost is filled in.

    A lost measurement lies on the line between its neighbours, the command and the reference hold.
    A start without a reference is left out if it is short; else the reference counts as unknown.

    Raises
    ------
    RecordingError
        When the data cannot tell b0, with what is missing and what to do.

    """
    columns = run.columns
    _check_rate(run)
    known = np.isfinite(columns['measurement']) & np.isfinite(columns['command'])
    place = np.rint((columns['time'] - columns['time'][0]) * run.rate).astype(np.int64)
    kept = np.flatnonzero(known)
    if kept.size:
        kept = kept[np.append(True, np.diff(place[kept]) > 0)]
    if kept.size < FEWEST_SAMPLES:
        raise RecordingError(
            f'only {kept.size} samples with a command, and it takes {FEWEST_SAMPLES}: {ADVICE}'
        )
    place = place[kept] - place[kept[0]]
    grid = np.arange(place[-1] + 1)
    lost = 1.0 - kept.size / grid.size
    if lost > MOST_LOST:
        raise RecordingError(
            f'{100 * lost:.0f} % of the periods have no measurement: it was not sent, or lost. At '
            f'most {100 * MOST_LOST:.0f} % may: {_remedy(columns["time"][kept], place)}'
        )
    held = np.searchsorted(place, grid, 'right') - 1
    reference = _filled(columns['reference'][kept])
    start = 0
    if np.isnan(reference).any():
        start = int(np.argmax(np.isfinite(reference[held])))
        if np.isnan(reference).mean() > MOST_WITHOUT_REFERENCE:
            reference, start = np.full(kept.size, np.nan), 0
    log = Log(
        measurement=np.interp(grid, place, columns['measurement'][kept])[start:],
        command=columns['command'][kept][held][start:],
        reference=reference[held][start:],
        h=1.0 / run.rate,
    )
    _check_excited(log)
    return log


def is_one_sine(reference: Array) -> bool:
    """Tell whether nearly all of the reference's motion is one line of its spectrum."""
    power = np.abs(np.fft.rfft((reference - reference.mean()) * np.hanning(len(reference)))) ** 2
    peak = int(np.argmax(power))
    near = power[max(peak - 2, 0) : peak + 3].sum()
    return bool(peak >= TURNS and near > ONE_LINE * power.sum())


def dominant_sine(values: Array, h: float) -> tuple[float, float, float]:
    """Return mean, amplitude and angular frequency [rad/s] of the sine that says most of it."""
    mean = float(values.mean())
    power = np.abs(np.fft.rfft(values - mean)) ** 2
    peak = 1 + int(np.argmax(power[1:]))
    return mean, float(np.sqrt(2.0) * values.std()), 2.0 * np.pi * peak / (len(values) * h)


def _filled(values: Array) -> Array:
    """Hold the last known value; what comes before the first stays nan."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    filled: Array = values[last]
    return filled


def _remedy(time: Array, place: Array) -> str:
    """Propose the longest part without gaps, if it is long enough, else another recording."""
    ends = np.append(np.flatnonzero(np.diff(place) > GAP_SPACINGS), len(place) - 1)
    starts = np.append(0, ends[:-1] + 1)
    longest = int(np.argmax(place[ends] - place[starts]))
    first, last = starts[longest], ends[longest]
    periods, count = place[last] - place[first] + 1, last - first + 1
    if count < FEWEST_SAMPLES or count < (1.0 - MOST_LOST) * periods:
        return 'record at a lower rate, or on a machine with less to do'
    return f'--from {_short(time[first], ceil)} --to {_short(time[last], floor)} has no gap'


def _short(time: float, cut: Callable[[float], int]) -> str:
    return f'{1e-3 * cut(1e3 * time):.10g}'


def _check_rate(run: RecordedRun) -> None:
    """Compare the times, which count periods, with the stamps of the measurements."""
    stamps = run.columns.get('measurement_stamp', np.empty(0))
    if len(stamps) < FEWEST_SAMPLES:
        return
    ratio = float(np.nanmedian(np.diff(stamps)) / np.median(np.diff(run.columns['time'])))
    if abs(ratio - 1.0) > OFF_RATE:
        raise RecordingError(
            f'the rate of the run is {run.rate:g} Hz, and the stamps of the measurements are '
            f'{1.0 / ratio:.3g} times as dense: record with the rate of the sensor'
        )


def _check_excited(log: Log) -> None:
    u = log.command
    if np.ptp(u) == 0.0:
        raise RecordingError(f'the command is {u[0]:g} all the time: {ADVICE}')
    for limit, share in ((u.min(), np.mean(u == u.min())), (u.max(), np.mean(u == u.max()))):
        if share > MOST_AT_A_LIMIT:
            raise RecordingError(
                f'the command is at {limit:g} for {100 * share:.0f} % of the time: '
                'ask for slower motion, or give the actuator wider limits'
            )
    spread = float(np.std(log.measurement))
    if spread <= STILL * noise_deviation(log.measurement):
        raise RecordingError(
            f'the output does not move: it scatters by {spread:.3g}, no more than its noise: '
            f'{ADVICE}'
        )
