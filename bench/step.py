"""
One step of the law in plain Python, as the node takes it, against pyadrc and simple-pid.

    python -m bench.step

All are of order 2 (``n4``: 4) with the same range and rate limit, but for simple-pid, which has no
rate limit. Blocks of calls take turns, and each call is timed by itself, which adds the same time
of about 0.05 us to all. With ``jitter`` the time step is another one in each call, so that the
observer gains are too; the others keep theirs, which pyadrc must.

Keys: ``step.<name>.median_us`` and ``.p99_us`` [us]. Samples [ns], in the order taken.
"""

from __future__ import annotations

from collections.abc import Callable
import gc
from time import perf_counter_ns
from typing import Any

from bench.results import over, save, show
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.law import step as law_step
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.specialise.python import specialised
from nadrc_ros.adrc.state import blank_state, start
import numpy as np
import numpy.typing as npt

CALLS = 1000
BLOCKS = 60
SEED = 1
PERIOD = 0.005
JITTER = 0.3
LIMIT = 10.0
RATE_LIMIT = 1e4
BANDWIDTH = 4.0
OBSERVER = 40.0

Samples = npt.NDArray[np.int64]
# Takes measurements and time steps, and returns how long each call took [ns].
Block = Callable[[list[float], list[float]], list[int]]


def ours(levels: int, order: int) -> Block:
    settings = ControllerSettings(
        plant_order=order,
        structure='nested' if levels > 1 else 'conventional',
        levels=max(levels, 2),
        inner_bandwidth=OBSERVER,
        outer_bandwidth=0.75 * OBSERVER,
        controller_bandwidth=BANDWIDTH,
        command_min=-LIMIT,
        command_max=LIMIT,
        command_rate_limit=RATE_LIMIT,
    )
    design = make_design(settings)
    step = specialised(law_step, design)
    state, spare, u = blank_state(design), blank_state(design), 0.0
    start(design, 0.0, u, 1.0, state)
    reference = [1.0] + [0.0] * order

    def block(measurements: list[float], periods: list[float]) -> list[int]:
        nonlocal state, spare, u
        times = []
        for y, h in zip(measurements, periods):
            start = perf_counter_ns()
            u, _ = step(design, state, reference, y, u, h, spare)
            times.append(perf_counter_ns() - start)
            state, spare = spare, state
        return times

    return block


def pyadrc_law(form: str) -> Any:
    """Return one of pyadrc's forms of the law of ``ours(1, 2)``."""
    import pyadrc

    change = RATE_LIMIT * PERIOD
    return getattr(pyadrc, form)(
        order=2,
        delta=PERIOD,
        b0=1.0,
        w_cl=BANDWIDTH,
        k_eso=OBSERVER / BANDWIDTH,
        m_lim=(-LIMIT, LIMIT),
        r_lim=(-change, change),
    )


def statespace() -> Block:
    law, u = pyadrc_law('StateSpace'), 0.0

    def block(measurements: list[float], periods: list[float]) -> list[int]:
        nonlocal u
        times = []
        for y in measurements:
            start = perf_counter_ns()
            u = law(y, u, 1.0)
            times.append(perf_counter_ns() - start)
        return times

    return block


def feedback_tf() -> Block:
    law = pyadrc_law('FeedbackTF')

    def block(measurements: list[float], periods: list[float]) -> list[int]:
        times = []
        for y in measurements:
            start = perf_counter_ns()
            law(y, 1.0)
            times.append(perf_counter_ns() - start)
        return times

    return block


def simple_pid() -> Block:
    from simple_pid import PID

    law = PID(16.0, 1.0, 8.0, setpoint=1.0, sample_time=None, output_limits=(-LIMIT, LIMIT))

    def block(measurements: list[float], periods: list[float]) -> list[int]:
        times = []
        for y, h in zip(measurements, periods):
            start = perf_counter_ns()
            law(y, dt=h)
            times.append(perf_counter_ns() - start)
        return times

    return block


MAKERS: dict[str, Callable[[], Block]] = {
    'nadrc_n2_k2': lambda: ours(2, 2),
    'nadrc_n2_k1': lambda: ours(1, 2),
    'nadrc_n2_k4': lambda: ours(4, 2),
    'nadrc_n4_k2': lambda: ours(2, 4),
    'nadrc_n2_k2_jitter': lambda: ours(2, 2),
    'pyadrc_statespace': statespace,
    'pyadrc_feedbacktf': feedback_tf,
    'simple_pid': simple_pid,
}


def measure(blocks: int, calls: int, seed: int) -> dict[str, Samples]:
    """Return the times of all calls [ns], by contestant."""
    rng = np.random.default_rng(seed)
    measurements = rng.uniform(-0.1, 0.1, calls).tolist()
    even = [PERIOD] * calls
    uneven = (PERIOD * rng.uniform(1.0 - JITTER, 1.0 + JITTER, calls)).tolist()
    contestants = {name: make() for name, make in MAKERS.items()}
    times: dict[str, list[int]] = {name: [] for name in contestants}
    gc.collect()
    gc.disable()  # as good as in the node, where it is frozen
    try:
        for _ in range(blocks):
            for name, block in contestants.items():
                times[name] += block(measurements, uneven if 'jitter' in name else even)
    finally:
        gc.enable()
    return {name: np.array(values) for name, values in times.items()}


def figures(times: dict[str, Samples]) -> dict[str, dict[str, float]]:
    return {
        name: {
            'median_us': float(np.median(values)) / 1e3,
            'p99_us': float(np.percentile(values, 99)) / 1e3,
        }
        for name, values in times.items()
    }


def main(blocks: int = BLOCKS, calls: int = CALLS, **where: Any) -> None:
    times = measure(blocks, calls, SEED)
    found = figures(times)
    save('step', found, times, **where)
    show('step', over('pyadrc_statespace', found, 'median_us'), FOOTNOTE)


FOOTNOTE = 'One call in plain Python. jitter: another time step, hence other gains, in each call.'

if __name__ == '__main__':
    main()
