"""The power spectral density of a command that is held over each period."""

from __future__ import annotations

from nadrc_ros.report.columns import Array
import numpy as np

SHORTEST = 64
SEGMENTS = 8


def command_spectrum(time: Array, command: Array, rate: float) -> tuple[Array, Array] | None:
    """
    Return frequencies [Hz] and the one-sided density [unit of u squared per Hz], by Welch.

    Hann windows that overlap by half, the mean of each taken off. What was not recorded is taken
    to be held, as the command was. None for a run too short to say anything.
    """
    from scipy.signal import welch

    held = _on_grid(time, command, rate)
    if held.size < SHORTEST:
        return None
    length = max(SHORTEST, 2 * held.size // (SEGMENTS + 1))
    frequency, density = welch(held, rate, nperseg=length)
    return frequency[1:], density[1:]


def _on_grid(time: Array, command: Array, rate: float) -> Array:
    known = np.isfinite(command)
    if not known.any():
        return np.empty(0)
    periods = np.rint((time[known] - time[known][0]) * rate).astype(np.int64)
    newest = np.searchsorted(periods, np.arange(periods[-1] + 1), 'right') - 1
    return np.asarray(command[known][newest])
