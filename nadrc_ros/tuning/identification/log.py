"""A recorded run as a gapless log, its noise, and the refusal of one that tells nothing."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, comb, floor

from nadrc_ros.records.recorded_run import RecordedRun
from nadrc_ros.records.recording import RecordingError
from nadrc_ros.records.spacing import GAP_SPACINGS
from nadrc_ros.tuning.identification.predictor import Array, Log
import numpy as np

_FEWEST_SAMPLES = 200
# With a tenth missing, one by one or four in a row, b0 still lies in its interval, a wider one.
_MOST_LOST = 0.1
_MOST_AT_A_LIMIT = 0.9
_MOST_WITHOUT_REFERENCE = 0.2
# A spread of the output up to that many times its noise is no motion.
_STILL = 1.3
# So much faster or slower than they should, measurements are not those of the rate of a run.
_OFF_RATE = 0.05
# A reference with that share of its power in one line, after so many turns, is a sine alone.
_ONE_LINE, _TURNS = 0.9, 3
_NOISE_DIFFERENCES = 4
# The median of |x| of a normal variable of deviation one.
_NORMAL_MEDIAN = 0.67449
# Values of the past that predict the next one, each the mean of so many periods: less noise.
_PAST, _BLOCK, _FEWEST_BLOCKS = 5, 4, 40
# In the logs of the bench the wrong direction helps less than the right one.
_CLEARLY = 2.0
# What is left of a prediction that fits to rounding errors, of the deviation.
_ROUNDING = 1e-9
ADVICE = (
    'record at least some seconds of a reference that moves, best a square or moves to and fro'
)
SWAPPED = (
    'the measurement predicts the command, which is the smoother one, better than the command '
    'the measurement: are command and measurement swapped?'
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
    if kept.size < _FEWEST_SAMPLES:
        raise RecordingError(
            f'only {kept.size} samples with a command, and it takes {_FEWEST_SAMPLES}: {ADVICE}'
        )
    place = place[kept] - place[kept[0]]
    grid = np.arange(place[-1] + 1)
    lost = 1.0 - kept.size / grid.size
    if lost > _MOST_LOST:
        raise RecordingError(
            f'{100 * lost:.0f} % of the periods have no measurement: it was not sent, or lost. At '
            f'most {100 * _MOST_LOST:.0f} % may: {_remedy(columns["time"][kept], place)}'
        )
    held = np.searchsorted(place, grid, 'right') - 1
    reference = _filled(columns['reference'][kept])
    start = 0
    if np.isnan(reference).any():
        start = int(np.argmax(np.isfinite(reference[held])))
        if np.isnan(reference).mean() > _MOST_WITHOUT_REFERENCE:
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
    return bool(peak >= _TURNS and near > _ONE_LINE * power.sum())


def noise_deviation(measurement: Array) -> float:
    """
    Return the standard deviation of the measurement noise, from differences of order four.

    They leave nothing of a motion that is slow against the period and of white noise of variance
    v leave C(8, 4) v (von Neumann; Hall, Kay and Titterington, Biometrika 77, 1990). Their median
    does not see the kinks that a square reference makes. A coarse sensor, which gives the same
    value most of the time, has a median of nothing; there all differences count.
    """
    left = np.abs(np.diff(measurement, _NOISE_DIFFERENCES))
    scale = float(np.sqrt(comb(2 * _NOISE_DIFFERENCES, _NOISE_DIFFERENCES)))
    middle = float(np.median(left)) / _NORMAL_MEDIAN
    return (middle or float(np.sqrt(np.mean(left**2)))) / scale


def seems_swapped(log: Log) -> bool:
    """
    Tell whether the measurement drives the command (Granger, Econometrica 37, 1969).

    A plant makes its output smoother than its command, and the past of the command helps to
    predict it. A controller that integrates does so, too, but not without the other direction.
    """
    y, u = _blocks(log.measurement), _blocks(log.command)
    if len(y) < _FEWEST_BLOCKS or not (y.std() > 0.0 and u.std() > 0.0):
        return False
    smoother = np.diff(u).std() / u.std() < np.diff(y).std() / y.std()
    return bool(smoother and _help(u, y) > _CLEARLY * _help(y, u))


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
    if count < _FEWEST_SAMPLES or count < (1.0 - _MOST_LOST) * periods:
        return 'record at a lower rate, or on a machine with less to do'
    return f'--from {_short(time[first], ceil)} --to {_short(time[last], floor)} has no gap'


def _short(time: float, cut: Callable[[float], int]) -> str:
    return f'{1e-3 * cut(1e3 * time):.10g}'


def _check_rate(run: RecordedRun) -> None:
    """Compare the times, which count periods, with the stamps of the measurements."""
    stamps = run.columns.get('measurement_stamp', np.empty(0))
    if len(stamps) < _FEWEST_SAMPLES:
        return
    ratio = float(np.nanmedian(np.diff(stamps)) / np.median(np.diff(run.columns['time'])))
    if abs(ratio - 1.0) > _OFF_RATE:
        raise RecordingError(
            f'the rate of the run is {run.rate:g} Hz, and the stamps of the measurements are '
            f'{1.0 / ratio:.3g} times as dense: record with the rate of the sensor'
        )


def _check_excited(log: Log) -> None:
    u = log.command
    if np.ptp(u) == 0.0:
        raise RecordingError(f'the command is {u[0]:g} all the time: {ADVICE}')
    for limit, share in ((u.min(), np.mean(u == u.min())), (u.max(), np.mean(u == u.max()))):
        if share > _MOST_AT_A_LIMIT:
            raise RecordingError(
                f'the command is at {limit:g} for {100 * share:.0f} % of the time: '
                'ask for slower motion, or give the actuator wider limits'
            )
    spread = float(np.std(log.measurement))
    if spread <= _STILL * noise_deviation(log.measurement):
        raise RecordingError(
            f'the output does not move: it scatters by {spread:.3g}, no more than its noise: '
            f'{ADVICE}'
        )


def _blocks(values: Array) -> Array:
    means: Array = values[: len(values) // _BLOCK * _BLOCK].reshape(-1, _BLOCK).mean(axis=1)
    return means


def _help(values: Array, cause: Array) -> float:
    """Return how many times the past of the cause lowers the error of the prediction."""
    own = np.column_stack((_past(values), np.ones(len(values) - _PAST)))
    least = _ROUNDING * float(values.std())
    alone, both = (
        least + _left(known, values[_PAST:])
        for known in (own, np.column_stack((own, _past(cause))))
    )
    return alone / both


def _past(values: Array) -> Array:
    scaled = (values - values.mean()) / values.std()
    return np.column_stack([scaled[_PAST - k : len(scaled) - k] for k in range(1, _PAST + 1)])


def _left(known: Array, values: Array) -> float:
    return float(np.std(values - known @ np.linalg.lstsq(known, values, rcond=None)[0]))
