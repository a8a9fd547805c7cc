"""
Plants that the estimator of `nadrc identify` was not built on, each with its experiment.

They have what real loops have: dead time, lags, dry friction, backlash, quantised sensors, limits
that are reached, open loops, a history before the first row, references that arrive at odd times.
Those of one kind are written by what they differ in.
"""

from __future__ import annotations

from typing import Any

from attrs import evolve
from bench.logs import Case, chirp, moves, multisine, Pid, random_steps, square
import numpy as np


def settling(gain: float, time: float, ambient: float = 0.0, **experiment: Any) -> Case:
    """Return an experiment with a plant of order 1 that settles: time y' = gain u - y + ..."""
    return Case(
        b0={1: gain / time},
        slope=lambda x, u, d: [(gain * u - x[0] + ambient + d) / time],
        **experiment,
    )


def axis(gain: float, damping: float, friction: float = 0.0, **experiment: Any) -> Case:
    """Return an experiment with a mass: y'' = gain u - damping y' - friction sign(y') + d."""
    usual: dict[str, Any] = {
        'h': 0.01,
        'seconds': 30.0,
        'start': (0.0, 0.0),
        'noise': 0.001,
        'disturbance': 0.3,
    }
    return Case(
        b0={2: gain},
        slope=lambda x, u, d: [
            x[1],
            gain * u - damping * x[1] - friction * np.tanh(200.0 * x[1]) + d,
        ],
        **usual | experiment,
    )


def lagged(order: int, b0: float, damping: float, lag: float) -> dict[int, float]:
    """
    Return the b0 of (lag s + 1) (s^n + damping s^(n-1) + ...) y = b0 u, with the lag and without.

    Of y^(m) + c y^(m-1) + ... = B u that of order m is B, and that of order m - 1 is B / c: the
    rule by which the b0 of a motor is K / (J R).
    """
    return {order: b0 / (1.0 + damping * lag), order + 1: b0 / lag}


def oven(lag: float, **experiment: Any) -> Case:
    """Return an experiment with an oven whose heating lags."""
    return Case(
        b0=lagged(1, 0.01, 1.0 / 200.0, lag),
        slope=lambda x, u, d: [
            0.01 * x[1] - (x[0] - 20.0) / 200.0 + 0.002 * d,
            (u - x[1]) / lag,
        ],
        start=(60.0, 20.0),
        controller=OVEN,
        noise=0.05,
        disturbance=1.0,
        **experiment,
    )


OVEN = Pid(p=3.0, i=0.01, low=0.0, high=100.0, offset=20.0)
HEATER = settling(
    2.0,
    300.0,
    20.0,
    h=1.0,
    seconds=3600.0,
    late=3,
    start=(60.0,),
    reference=square(60.0, 90.0, 600.0),
    controller=Pid(p=4.5, i=0.015, low=0.0, high=100.0, offset=20.0),
    noise=0.05,
    disturbance=1.0,
)
ARM = axis(
    20.0,
    2.0,
    reference=square(-0.5, 0.5, 1.5),
    controller=Pid(p=2.0, d=0.4, filter=0.02),
    play=0.004,
)
SLIDE = axis(
    2.0,
    0.8,
    seconds=15.0,
    reference=square(0.0, 1.0, 1.5),
    controller=Pid(p=8.0, d=4.0, filter=0.03),
)
AXIS = axis(
    12.0,
    3.0,
    reference=chirp(1.0, 0.5, 8.0, 30.0),
    controller=Pid(p=5.0, d=1.0, i=3.0, filter=0.02),
    disturbance=0.5,
    repeated=0.3,
)
WHEEL = Case(
    b0={1: 40.0},
    slope=lambda x, u, d: [40.0 * u - 2.0 * x[0] + d],
    h=0.005,
    seconds=15.0,
    reference=square(-12.0, 15.0, 1.0),
    controller=Pid(p=0.3, i=1.0, low=-1.0, high=1.0),
    noise=0.05,
    disturbance=2.0,
)
CASES = {
    'heater, dead time': HEATER,
    'heater, dead time, open loop': evolve(
        HEATER,
        late=20,
        start=(80.0,),
        reference=random_steps(30.0, 45.0, 500.0),
        controller=None,
        disturbance=0.3,
        recorded=False,
    ),
    'pump, no history': settling(
        3.0,
        0.8,
        h=0.01,
        seconds=20.0,
        late=17,
        start=(0.5,),
        reference=square(1.0, 2.0, 2.0),
        controller=Pid(p=0.5, i=0.6),
        noise=0.005,
        disturbance=0.05,
    ),
    'stage, dead time': axis(
        8.0,
        1.0,
        late=6,
        start=(0.4, 0.0),
        reference=square(-0.5, 0.5, 3.0),
        controller=Pid(p=1.0, d=0.6, i=0.1, filter=0.05),
        noise=0.002,
        disturbance=0.2,
    ),
    'heater, one step from cold': evolve(
        HEATER,
        seconds=1800.0,
        late=8,
        start=(20.0,),
        reference=lambda t: np.full_like(t, 60.0),
        controller=Pid(p=3.0, i=0.01, low=0.0, high=100.0),
        disturbance=0.5,
    ),
    'oven, lag and dead time': oven(
        10.0, h=1.0, seconds=3600.0, late=5, reference=square(60.0, 90.0, 450.0)
    ),
    'conveyor, 300 periods late': settling(
        2.0,
        20.0,
        h=0.2,
        seconds=1500.0,
        late=300,
        reference=square(0.0, 10.0, 250.0),
        controller=Pid(p=0.1, i=0.004),
        noise=0.05,
        disturbance=0.1,
    ),
    'oven, lag': oven(6.0, h=0.5, seconds=2400.0, reference=square(60.0, 90.0, 300.0)),
    'arm, backlash': ARM,
    'arm, wide backlash': evolve(ARM, play=0.02),
    'arm, dry friction': axis(
        30.0,
        1.5,
        8.0,
        reference=chirp(1.0, 1.0, 6.0, 30.0),
        controller=Pid(p=3.0, d=0.5, i=2.0, filter=0.02),
        steps=20,
        repeated=0.02,
    ),
    'cart, dry friction, moves': axis(
        4.0,
        1.0,
        0.8,
        h=0.02,
        seconds=60.0,
        reference=moves(1.0, 0.8, 3.0),
        controller=Pid(p=4.0, d=2.0, i=1.0, filter=0.04),
        noise=0.0005,
        disturbance=0.05,
        steps=20,
        repeated=0.02,
    ),
    'slide, dry friction, square': axis(
        2.0,
        0.2,
        0.6,
        seconds=SLIDE.seconds,
        reference=SLIDE.reference,
        controller=SLIDE.controller,
        noise=0.003,
        steps=20,
    ),
    'slide, small backlash': evolve(SLIDE, play=0.01),
    'slide, coloured noise': evolve(SLIDE, noise=0.002, colour=0.9),
    'servo, encoder': axis(
        50.0,
        4.0,
        h=0.005,
        seconds=15.0,
        reference=moves(2.0, 4.0, 1.5),
        controller=Pid(p=2.0, d=0.2, i=1.0, filter=0.02),
        noise=0.0,
        step=2.0 * np.pi / 1000.0,
        disturbance=0.5,
    ),
    'oven, coarse sensor': Case(
        b0={1: 0.01},
        slope=lambda x, u, d: [0.01 * u - (x[0] - 20.0) / 200.0 + 0.002 * d],
        h=1.0,
        seconds=3600.0,
        start=(60.0,),
        reference=square(60.0, 70.0, 450.0),
        controller=OVEN,
        step=0.25,
        disturbance=1.0,
    ),
    'wheel, saturated': WHEEL,
    'tank, open loop': Case(
        b0={1: 0.5},
        slope=lambda x, u, d: [0.5 * u - 0.3 * np.sqrt(max(x[0], 0.0)) + d],
        h=0.2,
        seconds=300.0,
        start=(2.0,),
        reference=random_steps(0.5, 1.3, 10.0),
        noise=0.01,
        disturbance=0.01,
        recorded=False,
    ),
    'yaw, in mid-move': Case(
        b0=lagged(2, 4.0, 0.5, 0.05),
        slope=lambda x, u, d: [x[1], 4.0 * x[2] - 0.5 * x[1] + d, (u - x[2]) / 0.05],
        h=0.02,
        seconds=40.0,
        start=(0.0, 0.0, 0.0),
        reference=square(-1.0, 1.0, 4.0),
        controller=Pid(p=1.5, d=0.8, i=0.2, filter=0.05),
        noise=0.002,
        disturbance=0.1,
        cut=250,
    ),
    'pendulum arm, solve_ivp': Case(
        b0={2: 6.0},
        slope=lambda x, u, d: [x[1], 6.0 * u - 11.0 * np.sin(x[0]) - 0.4 * x[1] + d],
        h=0.02,
        seconds=30.0,
        start=(0.0, 0.0),
        reference=chirp(0.6, 0.5, 6.0, 30.0),
        controller=Pid(p=8.0, d=2.0, i=6.0, filter=0.04),
        noise=0.001,
        disturbance=0.3,
        outside=True,
    ),
    'height, rotor lag, solve_ivp': Case(
        b0=lagged(2, 0.75, 0.2, 0.06),
        slope=lambda x, u, d: [x[1], 0.75 * x[2] - 9.81 - 0.2 * x[1] + d, (u - x[2]) / 0.06],
        h=0.02,
        seconds=40.0,
        start=(1.0, 0.0, 9.81 / 0.75),
        reference=moves(1.0, 1.0, 3.0),
        controller=Pid(p=8.0, d=6.0, i=2.0, filter=0.05, offset=13.08, low=0.0, high=25.0),
        noise=0.005,
        disturbance=0.2,
        outside=True,
    ),
    'axis, 30 % of reference late': AXIS,
    'unstable, square': Case(
        b0={2: 1.0},
        slope=lambda x, u, d: [x[1], 4.0 * x[0] + u + d],
        h=0.01,
        seconds=30.0,
        start=(0.0, 0.0),
        reference=square(-0.2, 0.2, 2.0),
        controller=Pid(p=20.0, d=6.0, i=10.0, filter=0.02),
        noise=0.0005,
        disturbance=0.1,
    ),
    'oscillator, open loop': Case(
        b0={2: 100.0},
        slope=lambda x, u, d: [x[1], 100.0 * u - x[1] - 90.0 * x[0] - 60.0 * x[0] ** 3 + d],
        h=0.03,
        seconds=60.0,
        start=(0.0, 0.0),
        reference=multisine(0.6, 1.0, 25.0),
        noise=0.002,
        disturbance=0.5,
        steps=4,
    ),
    'exchanger, open loop': Case(
        b0={1: -0.05},
        slope=lambda x, u, d: [-0.05 * u - 0.08 * (x[0] - 90.0) + 0.02 * d],
        h=1.0,
        seconds=3000.0,
        late=9,
        start=(75.0,),
        reference=random_steps(15.0, 35.0, 60.0),
        noise=0.1,
        disturbance=1.0,
        recorded=False,
    ),
    'block and shell': Case(
        b0={1: 0.05},
        slope=lambda x, u, d: [
            0.05 * u - 0.02 * (x[0] - x[1]),
            0.005 * (x[0] - x[1]) - 0.002 * (x[1] - 20.0) + 0.002 * d,
        ],
        h=1.0,
        seconds=3600.0,
        start=(40.0, 35.0),
        reference=square(40.0, 60.0, 400.0),
        controller=Pid(p=5.0, i=0.02, low=0.0, high=100.0, offset=5.0),
        noise=0.05,
        disturbance=1.0,
    ),
    'chain of order 3': Case(
        b0={3: 30.0},
        slope=lambda x, u, d: [x[1], x[2], 30.0 * u - 6.0 * x[2] - 5.0 * x[1] + d],
        h=0.01,
        seconds=40.0,
        start=(0.0, 0.0, 0.0),
        reference=square(-1.0, 1.0, 4.0),
        controller=Pid(p=0.4, d=0.4, filter=0.05),
        noise=0.001,
        disturbance=0.3,
    ),
    'standing reference': evolve(
        AXIS,
        start=(0.5, 0.0),
        reference=lambda t: np.full_like(t, 0.5),
        disturbance=3.0,
        repeated=0.0,
    ),
    'speed hold, reference stands': evolve(
        WHEEL,
        start=(10.0,),
        reference=lambda t: np.full_like(t, 10.0),
        controller=Pid(p=0.3, i=1.0, low=-1.0, high=1.0, offset=0.5),
        disturbance=5.0,
    ),
}
