"""What moves a loop from outside, by which the command's effect is told from a disturbance's."""

from __future__ import annotations

from nadrc_ros.tuning.identification.predictor import (
    Array,
    differences,
    Form,
    Log,
    noise_polynomial,
)
import numpy as np
from scipy.signal import lfilter
from scipy.stats import spearmanr

# Poles of the instruments, relative to the noise bandwidth, and how many of each.
POLES, STAGES = (0.1, 0.3, 1.0), 5
# How many past changes make the habit of a command, and in how many rows it may answer.
HABIT, ROWS_LATE = 6, 4
# Changes of the command below that part of the largest are none, and so many must be.
STEADY, FEWEST_CHANGES = 1e-6, 10
# Correlations of ranks that are an answer: larger than that, and than so many standard errors.
RELATED, CERTAIN = 0.2, 4.0


def outside_space(log: Log, form: Form, bandwidth: float, open_loop: bool) -> Array | None:
    """
    Return what the reference, in an open loop the command, can have caused: (N, columns).

    The signal prefiltered as the model is, through chains of all-pass filters behind lags of
    several speeds (Laguerre's functions; Wahlberg, IEEE Trans. Automatic Control 36, 1991): they
    stand for its derivatives, and are not spoiled by a row that repeats the one before. A loop
    that starts away from its reference is stepped by it. None if there is no such signal.
    """
    if log.reference_moves:
        return laguerre(log.reference - log.measurement[0], log, form, bandwidth)
    return laguerre(log.command - log.command[0], log, form, bandwidth) if open_loop else None


def answers(log: Log, innovations: Array) -> bool:
    """
    Tell whether the command answers the measurement, as in a closed loop.

    A surprise of the measurement is then one of the command in that row or in the next ones. The
    command's is what it does not do by its own habit, an autoregression of its changes; ranks
    keep a step of the reference from hiding it.
    """
    moved = np.diff(log.command)
    past = np.column_stack([moved[HABIT - k - 1 : -k - 1] for k in range(HABIT)])
    new = moved[HABIT:]
    new = new - past @ np.linalg.lstsq(past, new)[0]
    count = min(len(new), len(innovations))
    new, surprise = new[-count:], innovations[-count:]
    changed = np.abs(new) > STEADY * np.abs(new).max()
    for late in range(ROWS_LATE):
        used = changed[late:]
        if used.sum() < FEWEST_CHANGES:
            return False
        related = abs(spearmanr(new[late:][used], surprise[: count - late][used]).statistic)
        if related > max(RELATED, CERTAIN / float(np.sqrt(used.sum()))):
            return True
    return False


def laguerre(signal: Array, log: Log, form: Form, bandwidth: float) -> Array:
    """Return the prefiltered signal through Laguerre's functions, without the first rows."""
    poles = noise_polynomial(form, bandwidth, log.h)
    moved = lfilter(differences(form.smoothness), poles, signal)
    columns = [moved]
    for ratio in POLES:
        pole = np.exp(-ratio * bandwidth * log.h)
        stage = lfilter([1.0 - pole], [1.0, -pole], moved)
        for _ in range(STAGES):
            columns.append(stage)
            stage = lfilter([-pole, 1.0], [1.0, -pole], stage)
    return np.column_stack(columns)[log.lead :]
