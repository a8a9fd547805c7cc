"""What theory expects of one design on its nominal plant, sampled as it will run."""

from __future__ import annotations

from typing import NamedTuple

from nadrc_ros.adrc.design import Design, make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.theory.loop import chain, closed_loop, open_loop
from nadrc_ros.adrc.theory.margins import Margins, margins
from nadrc_ros.adrc.theory.norms import h_infinity_norm
from nadrc_ros.adrc.theory.system import Array, Complex, pick, response, StateSpace
from nadrc_ros.tuning.design.bandwidths import BAND
from nadrc_ros.tuning.design.limits import noise_gain
from nadrc_ros.tuning.design.requirements import Requirements
from nadrc_ros.tuning.design.responses import settling_time, step_response, thinned
import numpy as np
from numpy.typing import ArrayLike

NOISE, LOAD, REFERENCE = 0, 1, 2  # inputs of the closed loop
OUTPUT, COMMAND = 0, 1
BAND_POINTS = 100


class Prediction(NamedTuple):
    """
    Figures of a loop with the right b0, with the delay that is known.

    ``command_noise``: standard deviation of the command [command unit]. ``error``: what the
    disturbance leaves; of sines up to its frequency the largest amplitude [output unit], of a
    step the integral of |y| [output unit s]. ``settling_time`` [s], within 2 %. ``margins`` of the
    loop opened at the plant, whose gains are the admissible b / b0. ``input_gain_margin``: share
    of b0 by which the input gain may be wrong in any way over time, 1 / ||T||inf of the loop from
    load to command (small-gain theorem: H. Khalil, Nonlinear Systems, 3rd ed., 5.4).
    """

    command_noise: float
    error: float
    settling_time: float
    margins: Margins
    input_gain_margin: float


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
    reference = thinned(pick(loop, [REFERENCE], [OUTPUT]))
    return Prediction(
        command_noise=noise_gain(design, wanted) * wanted.noise_std,
        error=disturbance_error(loop, wanted),
        settling_time=settling_time(step_response(reference), reference.h, BAND),
        margins=margins(design, _plant(wanted), wanted.period, wanted.delay),
        input_gain_margin=1.0 / h_infinity_norm(pick(loop, [LOAD], [COMMAND])),
    )


def nominal_loop(design: Design, wanted: Requirements) -> StateSpace:
    """Return (noise, disturbance / b0, r, r', ...) -> (output, command) with the known delay."""
    return closed_loop(design, _plant(wanted), wanted.period, wanted.delay)


def disturbance_error(loop: StateSpace, wanted: Requirements) -> float:
    """Return what the disturbance leaves of the output: see :class:`Prediction`."""
    if wanted.disturbance_frequency > 0.0:
        band = wanted.disturbance_frequency * np.geomspace(0.01, 1.0, BAND_POINTS)
        return wanted.disturbance * float(rejection(loop, wanted, band).max())
    load = thinned(pick(loop, [LOAD], [OUTPUT]))
    left = step_response(load) / wanted.b0
    return wanted.disturbance * float(np.abs(left).sum()) * load.h


def rejection(loop: StateSpace, wanted: Requirements, omega: ArrayLike) -> Array:
    """Return |y / disturbance| [output unit / unit of y^(n)] at ``omega`` [rad/s]."""
    part = response(pick(loop, [LOAD], [OUTPUT]), omega)[..., 0, 0]
    return np.abs(part / wanted.b0)


def curves(settings: ControllerSettings, wanted: Requirements, omega: Array) -> Curves:
    """Return the frequency responses of the loop."""
    design = make_design(settings)
    loop = nominal_loop(design, wanted)
    p, k = open_loop(design, _plant(wanted), wanted.period, wanted.delay)
    return Curves(
        omega=omega,
        disturbance_to_output=rejection(loop, wanted, omega),
        noise_to_command=np.abs(response(pick(loop, [NOISE], [COMMAND]), omega)[:, 0, 0]),
        loop=-response(p, omega)[:, 0, 0] * response(k, omega)[:, 0, 0],
    )


def _plant(wanted: Requirements) -> StateSpace:
    return chain(wanted.order, wanted.b0)
