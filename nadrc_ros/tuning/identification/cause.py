"""Which of command and measurement drives the other."""

from __future__ import annotations

from nadrc_ros.tuning.identification.predictor import Array, Log
import numpy as np

# Values of the past that predict the next one, each the mean of so many periods: less noise.
PAST, BLOCK = 5, 4
FEWEST_BLOCKS = 40
# In the logs of the bench the wrong direction helps less than the right one.
CLEARLY = 2.0
# What is left of a prediction that fits to rounding errors, of the deviation.
ROUNDING = 1e-9

SWAPPED = (
    'the measurement predicts the command, which is the smoother one, better than the command '
    'the measurement: are command and measurement swapped?'
)


def seems_swapped(log: Log) -> bool:
    """
    Tell whether the measurement drives the command (Granger, Econometrica 37, 1969).

    A plant makes its output smoother than its command, and the past of the command helps to
    predict it. A controller that integrates does so, too, but not without the other direction.
    """
    y, u = _blocks(log.measurement), _blocks(log.command)
    if len(y) < FEWEST_BLOCKS or not (y.std() > 0.0 and u.std() > 0.0):
        return False
    smoother = np.diff(u).std() / u.std() < np.diff(y).std() / y.std()
    return bool(smoother and _help(u, y) > CLEARLY * _help(y, u))


def _blocks(values: Array) -> Array:
    means: Array = values[: len(values) // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=1)
    return means


def _help(values: Array, cause: Array) -> float:
    """Return how many times the past of the cause lowers the error of the prediction."""
    own = np.column_stack((_past(values), np.ones(len(values) - PAST)))
    least = ROUNDING * float(values.std())
    alone, both = (
        least + _left(known, values[PAST:])
        for known in (own, np.column_stack((own, _past(cause))))
    )
    return alone / both


def _past(values: Array) -> Array:
    scaled = (values - values.mean()) / values.std()
    return np.column_stack([scaled[PAST - k : len(scaled) - k] for k in range(1, PAST + 1)])


def _left(known: Array, values: Array) -> float:
    return float(np.std(values - known @ np.linalg.lstsq(known, values, rcond=None)[0]))
