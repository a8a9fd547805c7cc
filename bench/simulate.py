"""
One closed loop of 10 s at 1 kHz on the plant of the paper, in this package, in C and elsewhere.

    python -m bench.simulate

nadrc            the whole ``simulate(...)``: noise, loop, signals and figures of merit, compiled
nadrc_loop       its compiled loop alone, noise given
nadrc_plain      ``simulate(...)`` in plain Python
c                the same loop by hand (loop.c), ``cc -O2``, noise given; must agree to 1e-9
pyadrc           pyadrc's StateSpace and the plant in a Python loop, the same Runge-Kutta
python_control   plant and law as interconnected sampled systems, ``input_output_response``
solve_ivp        the continuous loop as one right-hand side, scipy's default method and tolerance

The law is the nested one with two levels; pyadrc has only its own with one, which costs less.
python-control takes Euler's observers, and solve_ivp no noise, which would force it to tiny steps.
Figures of merit are computed by the first four only. Time to compile is left out. The contestants
take turns, and it is the processor time that counts: to be interrupted is no fault of theirs.

Keys: ``simulate.<name>.ns_per_step`` [ns], the median. Samples [ns per step], one for each run.
"""

from __future__ import annotations

from collections.abc import Callable
import ctypes
from math import cos, exp, sin
from pathlib import Path
import shutil
import subprocess
from tempfile import TemporaryDirectory
from time import thread_time_ns
from typing import Any

import attrs
from bench.results import over, save, show
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.observer import place
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.simulation import metrics
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.integrate import Integrator, substeps_for
from nadrc_ros.simulation.kernel import kernel_for
from nadrc_ros.simulation.loop import Loop, ROW_WIDTH
from nadrc_ros.simulation.noise import Noise, NoiseSource
from nadrc_ros.simulation.plants import PaperPlant
from nadrc_ros.simulation.signals import Cosine, DecayingCosine
from nadrc_ros.simulation.simulate import simulate
import numpy as np
import numpy.typing as npt

ROUNDS = 5
REPEATS = 8
SEED = 1
LIMIT = 50.0
FREQUENCY = 0.5
INNER, OUTER, BANDWIDTH = 40.0, 8.0, 4.0
PLANT = PaperPlant()
DISTURBANCE = DecayingCosine()
EXPERIMENT = Experiment(
    plant=PLANT,
    reference=Cosine(frequency=FREQUENCY),
    disturbance=DISTURBANCE,
    noise=Noise(variance=1e-4, seed=SEED),
    initial_state=(0.0, 0.0),
    rate=1000.0,
    duration=10.0,
)
SETTINGS = ControllerSettings(
    structure='nested',
    inner_bandwidth=INNER,
    outer_bandwidth=OUTER,
    controller_bandwidth=BANDWIDTH,
    command_min=-LIMIT,
    command_max=LIMIT,
)
SOURCE = Path(__file__).with_name('loop.c')
AGREE = 1e-9
# In the order of the enumeration in loop.c.
SUMS = (
    metrics.ITAE,
    metrics.ISU,
    metrics.IAE,
    metrics.ISE,
    metrics.ITSE,
    metrics.MAX_ERROR,
    metrics.PEAK_ERROR,
    metrics.TOTAL_VARIATION,
    metrics.SATURATED,
    metrics.DURATION,
)

Array = npt.NDArray[np.float64]


@attrs.frozen
class Outcome:
    """What a run took [ns], and the outputs (N,) it came to."""

    time: int
    output: Array


Run = Callable[[], Outcome]


# ---- this package ----


def ours(experiment: Experiment, compiled: bool) -> Run:
    def run() -> Outcome:
        start = thread_time_ns()
        result = simulate(experiment, SETTINGS, compiled=compiled)
        return Outcome(thread_time_ns() - start, result.output)

    return run


def ours_loop(experiment: Experiment) -> tuple[Run, Loop, Array]:
    """Return a run of the compiled loop alone, with where it leaves its results."""
    kernel = kernel_for(experiment)
    if kernel is None:
        raise RuntimeError('the loop does not compile: is numba installed?')
    loop, rows = Loop(experiment, SETTINGS), np.empty((experiment.steps, ROW_WIDTH))
    noise = NoiseSource(experiment.noise, experiment.period).block(0, experiment.steps)
    no_feed_forward = np.zeros_like(noise)

    def run() -> Outcome:
        loop.__init__(experiment, SETTINGS)  # type: ignore[misc]
        loop.noise, loop.fed = noise, no_feed_forward
        start = thread_time_ns()
        while loop.plant_run.k < experiment.steps:
            kernel(loop, experiment.steps, rows)
            if loop.plant_run.k < experiment.steps:  # the start is left to plain Python
                loop._period(rows)
        return Outcome(thread_time_ns() - start, rows[:, 3])

    return run, loop, rows


# ---- the same in C ----


class Constants(ctypes.Structure):
    """The struct of loop.c."""

    _fields_ = [
        *((name, ctypes.c_double) for name in ('rate', 'settle_time', 'a1', 'a2', 'a3', 'b0')),
        *((name, ctypes.c_double) for name in ('frequency', 'decay', 'pulsation')),
        *((name, ctypes.c_double) for name in ('k0', 'k1', 'fading', 'low', 'high')),
        ('gains', ctypes.c_double * 6),
    ]


def constants(experiment: Experiment) -> Constants:
    design, h = make_design(SETTINGS), experiment.period
    scratch = blank_state(design).scratch
    place(design, h, 1.0, scratch)
    return Constants(
        experiment.rate,
        experiment.settled,
        PLANT.a1,
        PLANT.a2,
        PLANT.a3,
        design.b0,
        FREQUENCY,
        DISTURBANCE.decay,
        DISTURBANCE.frequency,
        *design.feedback_gains,
        exp(-BANDWIDTH * h),
        -LIMIT,
        LIMIT,
        (ctypes.c_double * 6)(*scratch[0], *scratch[1]),
    )


def c_loop(experiment: Experiment) -> tuple[Run, Loop, Array] | None:
    """Return a run of loop.c, with where it leaves its results; None without a compiler."""
    compiler = shutil.which('cc') or shutil.which('gcc') or shutil.which('clang')
    if compiler is None:
        return None
    with TemporaryDirectory() as folder:
        library = str(Path(folder) / 'loop.so')
        options = ('-O2', '-shared', '-fPIC', '-o', library, str(SOURCE), '-lm')
        subprocess.run([compiler, *options], check=True)
        function = ctypes.CDLL(library).run
    steps = experiment.steps
    substeps = substeps_for(PLANT, experiment.period)
    given = constants(experiment)
    noise = NoiseSource(experiment.noise, experiment.period).block(0, steps)
    loop, rows = Loop(experiment, SETTINGS), np.empty((steps, 9 + 2))
    state, sums, left = np.empty(2), np.empty(len(SUMS)), np.empty(2)

    def run() -> Outcome:
        state[:], sums[:], left[:] = experiment.initial_state, 0.0, 0.0
        addresses = [ctypes.c_void_p(a.ctypes.data) for a in (noise, state, sums, left, rows)]
        start = thread_time_ns()
        function(ctypes.byref(given), steps, substeps, *addresses)
        took = thread_time_ns() - start
        for where, value in zip(SUMS, sums):
            loop.metrics.sums[where] = float(value)
        loop.remainders[:2] = left.tolist()
        loop.plant_run.state = state.tolist()
        return Outcome(took, rows[:, 3])

    return run, loop, rows


def check_agreement(ours: tuple[Run, Loop, Array], by_hand: tuple[Run, Loop, Array]) -> None:
    """Raise if the loop in C came to anything else: then it is no measure of ours."""
    for run, _, _ in (ours, by_hand):
        run()
    (_, loop, rows), (_, their_loop, their_rows) = ours, by_hand
    columns = their_rows.shape[1]
    np.testing.assert_allclose(their_rows, rows[:, :columns], rtol=AGREE, atol=AGREE)
    theirs, own = (np.array(each.metrics.sums)[list(SUMS)] for each in (their_loop, loop))
    np.testing.assert_allclose(theirs, own, rtol=AGREE, atol=AGREE)
    np.testing.assert_allclose(their_loop.remainders, loop.remainders, rtol=AGREE, atol=AGREE)
    np.testing.assert_allclose(their_loop.plant_run.state, loop.plant_run.state, atol=AGREE)


# ---- the others ----


def pyadrc_loop(experiment: Experiment) -> Run:
    from pyadrc import StateSpace

    h, steps = experiment.period, experiment.steps
    substeps = substeps_for(PLANT, h)
    noise = NoiseSource(experiment.noise, h).block(0, steps).tolist()

    def run() -> Outcome:
        law = StateSpace(
            order=2,
            delta=h,
            b0=1.0,
            w_cl=BANDWIDTH,
            k_eso=INNER / BANDWIDTH,
            m_lim=(-LIMIT, LIMIT),
        )
        integrator = Integrator(PLANT, experiment.disturbance, substeps)
        x, following, u, output = list(experiment.initial_state), [0.0, 0.0], 0.0, []
        start = thread_time_ns()
        for k in range(steps):
            t = k * h
            output.append(x[0])
            u = law(x[0] + noise[k], u, cos(FREQUENCY * t))
            integrator.advance(t, x, u, h, following)
            x, following = following, x
        return Outcome(thread_time_ns() - start, np.array(output))

    return run


def law_rates(z: Any, y: float, r: float, rate: float, acceleration: float) -> tuple[Any, float]:
    """Return dz/dt of two nested observers, z = (y, y', d) of both, and the command."""
    v = acceleration + BANDWIDTH * BANDWIDTH * (r - z[0]) + 2.0 * BANDWIDTH * (rate - z[1])
    u = min(max(v - z[2] - z[5], -LIMIT), LIMIT)
    rates = []
    for w, level, received in ((INNER, 0, u), (OUTER, 3, u + z[2])):
        e = y - z[level]
        rates += [
            z[level + 1] + 3.0 * w * e,
            z[level + 2] + received + 3.0 * w * w * e,
            w * w * w * e,
        ]
    return rates, u


def python_control(experiment: Experiment) -> Run:
    import control

    h, steps = experiment.period, experiment.steps
    times = np.arange(steps) * h
    angle = FREQUENCY * times
    noise = NoiseSource(experiment.noise, h).block(0, steps)
    reference = [np.cos(angle), -FREQUENCY * np.sin(angle), -(FREQUENCY**2) * np.cos(angle)]
    integrator = Integrator(PLANT, experiment.disturbance, substeps_for(PLANT, h))
    following = [0.0, 0.0]

    def move(t: float, x: Array, u: Array, params: Any) -> list[float]:
        integrator.advance(t, x.tolist(), float(u[0]), h, following)
        return following

    def observe(t: float, z: Array, u: Array, params: Any) -> list[float]:
        before = z.tolist()
        rates, _ = law_rates(before, *u.tolist())
        return [state + h * rate for state, rate in zip(before, rates)]

    def command(t: float, z: Array, u: Array, params: Any) -> float:
        return law_rates(z.tolist(), *u.tolist())[1]

    plant = control.NonlinearIOSystem(
        move,
        lambda t, x, u, params: x[0],
        inputs=['u'],
        outputs=['x'],
        states=2,
        dt=h,
        name='plant',
    )
    law = control.NonlinearIOSystem(
        observe, command, inputs=['y', 'r', 'r1', 'r2'], outputs=['u'], states=6, dt=h, name='law'
    )
    sensor = control.summing_junction(['x', 'noise'], 'y', name='sensor')
    loop = control.interconnect(
        [plant, law, sensor], inputs=['r', 'r1', 'r2', 'noise'], outputs=['x']
    )

    def run() -> Outcome:
        start = thread_time_ns()
        response = control.input_output_response(loop, times, [*reference, noise], np.zeros(8))
        return Outcome(thread_time_ns() - start, np.asarray(response.outputs)[0])

    return run


def solve_ivp_loop(experiment: Experiment) -> Run:
    from scipy.integrate import solve_ivp

    times = np.arange(experiment.steps) * experiment.period

    def rates(t: float, x: Array) -> list[float]:
        y, moved, *z = x.tolist()
        r, turned = cos(FREQUENCY * t), -FREQUENCY * sin(FREQUENCY * t)
        z_rates, u = law_rates(z, y, r, turned, -FREQUENCY * FREQUENCY * r)
        gain = 1.0 + PLANT.a3 * sin(t)
        push = PLANT.a1 * y + PLANT.a2 * sin(moved) + exp(-t) * cos(t)
        return [moved, push + gain * u, *z_rates]

    def run() -> Outcome:
        start = thread_time_ns()
        solution = solve_ivp(rates, (0.0, experiment.duration), np.zeros(8), t_eval=times)
        return Outcome(thread_time_ns() - start, solution.y[0])

    return run


# ---- the comparison ----


def measure(experiment: Experiment, rounds: int, repeats: int) -> dict[str, list[Outcome]]:
    """Return all runs by contestant; the fast ones run ``repeats`` times in each round."""
    compiled, by_hand = ours_loop(experiment), c_loop(experiment)
    fast = {'nadrc': ours(experiment, True), 'nadrc_loop': compiled[0]}
    if by_hand is not None:
        check_agreement(compiled, by_hand)
        fast['c'] = by_hand[0]
    slow = {
        'nadrc_plain': ours(experiment, False),
        'pyadrc': pyadrc_loop(experiment),
        'python_control': python_control(experiment),
        'solve_ivp': solve_ivp_loop(experiment),
    }
    fast['nadrc']()  # what is compiled, or read from disk, is so now
    runs: dict[str, list[Outcome]] = {name: [] for name in fast | slow}
    for _ in range(rounds):
        for name in [*(list(fast) * repeats), *slow]:
            runs[name].append((fast | slow)[name]())
    return runs


def main(
    experiment: Experiment = EXPERIMENT, rounds: int = ROUNDS, repeats: int = REPEATS, **where: Any
) -> None:
    runs = measure(experiment, rounds, repeats)
    samples = {
        name: np.array([run.time for run in own]) / experiment.steps for name, own in runs.items()
    }
    found = {name: {'ns_per_step': float(np.median(own))} for name, own in samples.items()}
    save('simulate', found, samples, **where)
    note = '' if 'c' in found else '; the loop in C is missing: there is no C compiler here'
    show('simulate', over('nadrc', found, 'ns_per_step'), FOOTNOTE + note)


FOOTNOTE = '10 s of closed loop at 1 kHz; nadrc_loop and c without making the noise'

if __name__ == '__main__':
    main()
