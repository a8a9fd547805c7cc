"""
The words that signals are described with: one field name, one default, unit, range and meaning.

A node that declares every word once can therefore offer every signal under flat parameter names.
With all defaults ``decaying_cosine`` is the disturbance exp(-t) cos t of the paper (Abdul-Adheem &
Ibraheem, nested linear extended state observers, section IV); its reference cos 0.5 t is
``cosine`` with ``frequency`` 0.5.
"""

from __future__ import annotations

from typing import Any

from nadrc_ros.adrc.fields import number
from nadrc_ros.adrc.settings import FASTEST, LARGEST, LEAST, LONGEST, SMALLEST, STEEPEST


def offset() -> Any:
    """Declare the level that everything else is added to."""
    return number(0.0, SMALLEST, LARGEST, '', 'constant part, and the value before start_time')


def amplitude() -> Any:
    """Declare the size of the part that changes."""
    return number(
        1.0, SMALLEST, LARGEST, '', 'size of the changing part (of the move, for a trapezoid)'
    )


def start_time() -> Any:
    """Declare the time at which the changing part begins."""
    return number(0.0, 0.0, LONGEST, 's', 'time at which the changing part begins; offset before')


def frequency() -> Any:
    """Declare the angular frequency."""
    return number(1.0, 0.0, FASTEST, 'rad/s', 'angular frequency (at the start, for a chirp)')


def phase() -> Any:
    """Declare the angle at the start."""
    # Larger ones are no other angles, and have fewer digits.
    return number(0.0, -1e3, 1e3, 'rad', 'angle at start_time')


def slope() -> Any:
    """Declare the rate of a ramp."""
    return number(1.0, -STEEPEST, STEEPEST, '1/s', 'rate of change after start_time')


def end_frequency() -> Any:
    """Declare the angular frequency that a chirp ends with."""
    return number(
        10.0, 0.0, FASTEST, 'rad/s', 'angular frequency at and after the end of the sweep'
    )


def sweep_time() -> Any:
    """Declare how long a chirp changes its frequency."""
    return number(
        10.0, 1.0 / FASTEST, LONGEST, 's', 'duration of the sweep from frequency to end_frequency'
    )


def velocity() -> Any:
    """Declare the speed limit of a move."""
    return number(1.0, LEAST, LARGEST, '1/s', 'largest speed of the move')


def acceleration() -> Any:
    """Declare the acceleration of a move."""
    return number(1.0, LEAST, LARGEST, '1/s^2', 'acceleration and deceleration of the move')


def decay() -> Any:
    """Declare the rate of an exponential envelope."""
    return number(1.0, 0.0, FASTEST, '1/s', 'rate of the exponential envelope')
