"""
The figures of merit of a run, accumulated sample by sample.

One quadrature rule serves all integrals: the left rectangle, h f(t_k), exact for the square of a
command that is held over each period. The paper (Abdul-Adheem & Ibraheem, nested linear extended
state observers, Table I) uses ITAE and ISU without defining them; read are the integrals of t |e|
and of u^2.

A sample that is not finite, or would make a sum overflow, is left out of everything and counted.
"""

from __future__ import annotations

from math import isfinite, nan, sqrt
from typing import Any

import attrs
from nadrc_ros.simulation.protocols import MutableVector

# Where each sum is, so that the update compiles.
ITAE, ISU, IAE, ISE, ITSE, MAX_ERROR, PEAK_ERROR, MAX_COMMAND = range(8)
TOTAL_VARIATION, SATURATED, DURATION, SAMPLES, SKIPPED, LAST_COMMAND, SETTLED, SIZE = range(8, 16)
# Figures that nothing has, too.
_COUNTS = ('samples', 'skipped', 'duration')


def _known(value: float | None) -> float:
    """Return a figure that a document has, nan for null."""
    return nan if value is None else value


def _figure() -> Any:
    return attrs.field(converter=_known, eq=repr)  # nan is not equal to itself


@attrs.frozen(kw_only=True)
class MetricValues:
    """
    The figures of merit over the samples so far; e is the error, u the command.

    Attributes
    ----------
    itae
        Integral of t |e| [unit of e, s^2].
    isu
        Integral of u^2 [unit of u squared, s].
    iae
        Integral of |e| [unit of e, s].
    ise
        Integral of e^2 [unit of e squared, s].
    itse
        Integral of t e^2 [unit of e squared, s^2].
    rmse
        Square root of ``ise`` over ``duration`` [unit of e].
    max_error
        Largest |e| [unit of e].
    peak_error
        Largest |e| at or after the settle time [unit of e], nan if there was no sample so late.
    max_command
        Largest |u| [unit of u].
    total_variation
        Sum of |u_k - u_{k-1}| [unit of u].
    saturated_fraction
        Share of ``duration`` during which the command was at one of its limits.
    samples
        Number of samples used.
    skipped
        Number of samples left out.
    duration
        Sum of the periods of the samples used [s].

    """

    itae: float = _figure()
    isu: float = _figure()
    iae: float = _figure()
    ise: float = _figure()
    itse: float = _figure()
    rmse: float = _figure()
    max_error: float = _figure()
    peak_error: float = _figure()
    max_command: float = _figure()
    total_variation: float = _figure()
    saturated_fraction: float = _figure()
    samples: int
    skipped: int
    duration: float

    def as_dict(self) -> dict[str, float | None]:
        """Return the figures by name, in order; None for one that there is not."""
        # Sums of nothing are 0, the best that a figure can be; nan alone is not equal to itself.
        return {
            name: value if (self.samples or name in _COUNTS) and value == value else None
            for name, value in attrs.asdict(self).items()
        }


def accumulate(
    acc: MutableVector,
    t: float,
    h: float,
    error: float,
    command: float,
    saturated: bool,
) -> None:
    """
    Add the sample of the period [t, t + h] to ``acc``, the sums of a :class:`Metrics`.

    Parameters
    ----------
    acc
        ``SIZE`` entries, addressed by the index constants of this module.
    t, h
        Start, at least 0, and length, at least 0, of the period [s].
    error, command
        e at ``t``, and u over the period.
    saturated
        Whether the command was at one of its limits.

    """
    size = abs(error)
    itae = acc[ITAE] + h * t * size
    isu = acc[ISU] + h * (command * command)
    iae = acc[IAE] + h * size
    ise = acc[ISE] + h * (size * size)
    itse = acc[ITSE] + h * t * (size * size)
    variation = acc[TOTAL_VARIATION]
    if acc[SAMPLES] > 0.0:
        variation = variation + abs(command - acc[LAST_COMMAND])
    duration = acc[DURATION] + h
    good = t >= 0.0 and h >= 0.0 and isfinite(t) and isfinite(size) and isfinite(command)
    good = good and isfinite(itae) and isfinite(isu) and isfinite(iae) and isfinite(ise)
    if not (good and isfinite(itse) and isfinite(variation) and isfinite(duration)):
        acc[SKIPPED] = acc[SKIPPED] + 1.0
        return
    acc[ITAE] = itae
    acc[ISU] = isu
    acc[IAE] = iae
    acc[ISE] = ise
    acc[ITSE] = itse
    acc[TOTAL_VARIATION] = variation
    acc[DURATION] = duration
    acc[LAST_COMMAND] = command
    acc[SAMPLES] = acc[SAMPLES] + 1.0
    if saturated:
        acc[SATURATED] = acc[SATURATED] + h
    if size > acc[MAX_ERROR]:
        acc[MAX_ERROR] = size
    if t >= acc[SETTLED] and not size <= acc[PEAK_ERROR]:  # nan before the first
        acc[PEAK_ERROR] = size
    if abs(command) > acc[MAX_COMMAND]:
        acc[MAX_COMMAND] = abs(command)


def accumulate_remainders(
    left: float, estimates: MutableVector, levels: int, t: float, h: float, sums: MutableVector
) -> None:
    """
    Add the period [t, t + h] to the ITAE of what is left after each level, one sum per level.

    ``sums[k]`` grows by h t |L - d_1 - ... - d_{k+1}|, with ``left`` the L at ``t`` that there is
    to estimate and d_k the ``estimates`` after the sample of ``t``: the errors e_3 (inner level)
    and zeta_3 (both) of the paper. What is not finite, or would make a sum overflow, is left out.
    """
    for k in range(levels):
        left -= estimates[k]
        total = sums[k] + h * t * abs(left)
        if isfinite(total):
            sums[k] = total


class Metrics:
    """
    The streaming accumulator that the simulation and the recorder share.

    Parameters
    ----------
    settle_time
        From when on ``peak_error`` counts [s].

    Attributes
    ----------
    sums
        What :func:`accumulate` adds to.

    """

    def __init__(self, settle_time: float) -> None:
        self.sums = [0.0] * SIZE
        self.sums[SETTLED] = settle_time
        self.sums[PEAK_ERROR] = nan

    def settle_from(self, settle_time: float) -> None:
        """Let ``peak_error`` count from another time on [s]."""
        self.sums[SETTLED] = settle_time

    def add(
        self, t: float, h: float, error: float, command: float, saturated: bool = False
    ) -> None:
        """Add the sample of the period [t, t + h] [s]."""
        accumulate(self.sums, t, h, error, command, saturated)

    def values(self) -> MetricValues:
        """Return the figures of merit so far."""
        acc = self.sums
        duration = acc[DURATION]
        held = duration > 0.0
        return MetricValues(
            itae=acc[ITAE],
            isu=acc[ISU],
            iae=acc[IAE],
            ise=acc[ISE],
            itse=acc[ITSE],
            rmse=sqrt(acc[ISE] / duration) if held else 0.0,
            max_error=acc[MAX_ERROR],
            peak_error=acc[PEAK_ERROR],
            max_command=acc[MAX_COMMAND],
            total_variation=acc[TOTAL_VARIATION],
            saturated_fraction=acc[SATURATED] / duration if held else 0.0,
            samples=int(acc[SAMPLES]),
            skipped=int(acc[SKIPPED]),
            duration=duration,
        )
