"""What theory expects of one design on its nominal plant, sampled as it will run."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.theory.delayed import (
    closed_response,
    COMMAND,
    LOAD,
    Loop,
    loop_grid,
    NOISE,
    open_response,
    OUTPUT,
    REFERENCE,
    step_responses,
)
from nadrc_ros.theory.margins import Margins
from nadrc_ros.theory.norms import peak
from nadrc_ros.theory.system import Array, Complex
from nadrc_ros.tuning import WRONG_POLES
from nadrc_ros.tuning.design.bandwidths import BAND
from nadrc_ros.tuning.design.limits import (
    loop_margins,
    noise_gain,
    nominal_loop,
    pole_overshoot,
)
from nadrc_ros.tuning.design.requirements import FOLLOWED, Requirements
import numpy as np
from numpy.typing import ArrayLike

_BAND_POINTS = 100


class Prediction(NamedTuple):
    """
    Figures of a loop with the right b0, with the delay that is known.

    ``command_noise``: standard deviation of the command [command unit]. ``error``: what the
    disturbance leaves; of sines up to its frequency the largest amplitude [output unit], of a
    step the integral of |y| [output unit s]. ``settling_time`` [s], within 2 %. ``margins`` of the
    loop opened at the plant, whose gains are the admissible b / b0. ``input_gain_margin``: share
    of b0 by which the input gain may be wrong in any way over time, 1 / ||T||inf of the loop from
    load to command (small-gain theorem: H. Khalil, Nonlinear Systems, 3rd ed., 5.4).
    ``pole_overshoot``: share by which a step overshoots if known poles are wrong by a factor of
    two, the worse way; inf for an unstable loop.
    """

    command_noise: float
    error: float
    settling_time: float
    margins: Margins
    input_gain_margin: float
    pole_overshoot: float


class Curves(NamedTuple):
    """Frequency responses at ``omega`` [rad/s], below pi / h; ``loop`` is -1 when critical."""

    omega: Array
    disturbance_to_output: Array
    noise_to_command: Array
    loop: Complex


def predict(settings: ControllerSettings, wanted: Requirements) -> Prediction:
    """Return the figures of a stable loop with these settings."""
    design = make_design(settings)
    loop = nominal_loop(design, wanted)
    at = closed_response(loop)
    lasting = FOLLOWED * wanted.settling_time
    (load, reference), step = step_responses(loop, [LOAD, REFERENCE], lasting)
    if wanted.disturbance_frequency > 0.0:
        band = wanted.disturbance_frequency * np.geomspace(0.01, 1.0, _BAND_POINTS)
        left = float(rejection(loop, wanted, band).max())
    else:
        left = float(np.abs(load / wanted.b0).sum()) * step
    return Prediction(
        command_noise=noise_gain(design, wanted) * wanted.noise_std,
        error=wanted.load * left,
        settling_time=settling_time(reference, step, BAND),
        margins=loop_margins(design, wanted, wanted.delay),
        input_gain_margin=1.0
        / peak(
            lambda omega: at(omega)[..., [COMMAND], :][..., [LOAD]],
            loop_grid(loop),
        ),
        pole_overshoot=max(pole_overshoot(settings, wanted, v) for v in WRONG_POLES),
    )


def settling_time(response: Array, h: float, band: float) -> float:
    """
    Return when a response last enters its final value 1 +- ``band`` [s], inf if it never stays.

    Between two samples ``h`` apart the error is taken as a straight line.
    """
    error = np.abs(response - 1.0)
    outside = np.flatnonzero(error > band)
    if not outside.size:
        return 0.0
    last = int(outside[-1])
    if last + 1 == len(error):
        return inf
    share = (error[last] - band) / (error[last] - error[last + 1])
    return float((last + share) * h)


def rejection(loop: Loop, wanted: Requirements, omega: ArrayLike) -> Array:
    """Return |y / disturbance| [output unit / unit of y^(n)] at ``omega`` [rad/s]."""
    return np.abs(closed_response(loop)(omega)[..., OUTPUT, LOAD] / wanted.b0)


def curves(settings: ControllerSettings, wanted: Requirements, omega: Array) -> Curves:
    """Return the frequency responses of the loop."""
    loop = nominal_loop(make_design(settings), wanted)
    return Curves(
        omega=omega,
        disturbance_to_output=rejection(loop, wanted, omega),
        noise_to_command=np.abs(closed_response(loop)(omega)[:, COMMAND, NOISE]),
        loop=open_response(loop)(omega),
    )
