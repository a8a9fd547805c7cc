"""Bode plots of control loops: what disturbances and noise do, and how far -1 is away."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, pi
from typing import Any, NamedTuple

from matplotlib import rc_context
from matplotlib.figure import Figure
from nadrc_ros.records.recorded_run import Array
from nadrc_ros.report.roles import GREY, INK, looks
from nadrc_ros.report.style import plain_log_ticks, STYLE
import numpy as np
import numpy.typing as npt

_SIZE = (10.0, 7.4)
_LABEL_BOX = {'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.8, 'pad': 1.0}
# Decades shown: of |L|, and of the others below their largest value.
_DECADES_ABOVE, _DECADES_BELOW, _DECADES_DEEP = 2.0, -3.0, 3.0


class Loop(NamedTuple):
    """
    One loop: frequency responses at ``omega`` [rad/s], and the margins to mark.

    ``loop`` is L, critical at -1; ``crossover`` [rad/s] the highest frequency with |L| = 1,
    ``phase`` [rad] the smallest phase margin, ``gains`` the factors between which L is stable.
    """

    omega: Array
    disturbance_to_output: Array
    noise_to_command: Array
    loop: npt.NDArray[np.complex128]
    crossover: float
    phase: float
    gains: tuple[float, float]


def draw_bode(loops: Mapping[str, Loop], chosen: str, title: str, band: float = 0.0) -> Figure:
    """
    Return four panels: disturbance to output, noise to command, gain and phase of the open loop.

    The margins marked are those of the chosen loop. ``band`` [rad/s] is the highest frequency of
    the disturbance, 0 for none.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=_SIZE)
        ((rejection, noise), (gain, phase)) = figure.subplots(2, 2, sharex=True)
        styles = looks(loops)
        for name, loop in loops.items():
            first = name == chosen
            look: dict[str, Any] = {'color': styles[name].colour, 'linestyle': styles[name].dash}
            look |= {'linewidth': 2.0 if first else 1.2, 'zorder': 3 if first else 2}
            look |= {'label': f'{name}, chosen' if first and len(loops) > 1 else name}
            rejection.loglog(loop.omega, loop.disturbance_to_output, **look)
            noise.loglog(loop.omega, loop.noise_to_command, **look)
            gain.loglog(loop.omega, np.abs(loop.loop), **look)
            phase.semilogx(loop.omega, unwrapped(loop), **look)
        best = loops[chosen]
        _mark_gains(gain, best)
        _mark_phase(phase, best)
        rejection.set_title('disturbance to output  |y / d|  [output unit / unit of y⁽ⁿ⁾]')
        noise.set_title('noise to command  |u / noise|  [command unit / output unit]')
        gain.set_title('open loop, gain  |L|')
        phase.set_title('open loop, phase of L  [degrees]')
        gain.set_ylim(10.0**_DECADES_BELOW, 10.0**_DECADES_ABOVE)
        for axis, column in ((rejection, 'disturbance_to_output'), (noise, 'noise_to_command')):
            top = 2.0 * max(getattr(loop, column).max() for loop in loops.values())
            axis.set_ylim(top * 10.0**-_DECADES_DEEP, top)
        for axis in (rejection, noise, gain, phase):
            axis.set_xlim(best.omega[0], best.omega[-1])
            axis.axvline(best.omega[-1], color=GREY, linewidth=0.8)
        plain_log_ticks(rejection, noise, gain, phase)
        if band > 0.0:
            rejection.axvspan(best.omega[0], band, color=GREY, alpha=0.15, linewidth=0.0)
            rejection.annotate(
                'disturbance', (band, 0.03), **_in_axis(rejection, (-3, 0), 'right')
            )
        for axis in (gain, phase):
            axis.set_xlabel('frequency [rad/s], up to half the sampling rate')
        handles, names = rejection.get_legend_handles_labels()
        figure.suptitle(title, x=0.075, y=0.985, ha='left', va='top', weight='bold')
        figure.legend(
            handles,
            names,
            loc='upper left',
            bbox_to_anchor=(0.07, 0.955),
            ncol=4,
            borderaxespad=0.0,
        )
        figure.subplots_adjust(
            left=0.075, right=0.985, top=0.875, bottom=0.07, hspace=0.2, wspace=0.14
        )
    return figure


def unwrapped(loop: Loop) -> Array:
    """Return the phase of L [degrees], continuous, nearest to -180 at the crossover."""
    angle = np.unwrap(np.angle(loop.loop))
    at = float(np.interp(loop.crossover, loop.omega, angle))
    return np.asarray(np.degrees(angle - 2.0 * pi * round((at + pi) / (2.0 * pi))))


def critical(loop: Loop) -> list[tuple[float, float]]:
    """Return frequency [rad/s] and |L| where L is real and negative, interpolated."""
    found = []
    imaginary = loop.loop.imag
    for i in np.flatnonzero(np.signbit(imaginary[:-1]) != np.signbit(imaginary[1:])):
        share = imaginary[i] / (imaginary[i] - imaginary[i + 1])
        value = loop.loop[i].real + share * (loop.loop[i + 1].real - loop.loop[i].real)
        if value < 0.0:
            found.append((float(loop.omega[i] + share * np.diff(loop.omega)[i]), -float(value)))
    return found


def _mark_gains(axis: Any, loop: Loop) -> None:
    """Draw from |L| to 1 where L is real and negative, at the two that bound the gain."""
    axis.axhline(1.0, color=INK, linewidth=0.9)
    for omega, size in critical(loop):
        if any(abs(size * factor - 1.0) < 0.02 for factor in loop.gains):
            axis.plot([omega, omega], [size, 1.0], color=INK, marker='.', linewidth=1.3, zorder=5)
            right = size < 1.0  # where the curve is not
            axis.annotate(
                f'gain × {1.0 / size:.3g}',
                (omega, size**0.5),
                xytext=(6 if right else -6, 0),
                textcoords='offset points',
                ha='left' if right else 'right',
                va='center',
                bbox=_LABEL_BOX,
                zorder=6,
            )


def _mark_phase(axis: Any, loop: Loop) -> None:
    """Draw -180 degrees, and the phase margin at the crossover if the smallest is there."""
    axis.axhline(-180.0, color=INK, linewidth=0.9)
    if loop.crossover <= 0.0:
        return
    at = float(np.interp(loop.crossover, loop.omega, unwrapped(loop)))
    axis.plot([loop.crossover] * 2, [-180.0, at], color=INK, marker='.', linewidth=1.3, zorder=5)
    found = abs(at + 180.0)
    rest = (
        '' if abs(found - degrees(loop.phase)) < 1.0 else f', elsewhere {degrees(loop.phase):.0f}°'
    )
    axis.annotate(
        f'phase margin {found:.0f}°{rest}',
        (loop.crossover, -180.0),
        xytext=(4, -13),
        textcoords='offset points',
        bbox=_LABEL_BOX,
        zorder=6,
    )


def _in_axis(axis: Any, offset: tuple[int, int], side: str) -> dict[str, Any]:
    return {
        'xycoords': axis.get_xaxis_transform(),
        'xytext': offset,
        'textcoords': 'offset points',
        'ha': side,
        'fontsize': 8.5,
        'color': INK,
    }
