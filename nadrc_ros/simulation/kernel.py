"""The compiled loop of one experiment: what it is given, and what it gives back."""

from __future__ import annotations

from array import array
from collections import namedtuple
from collections.abc import Callable
from contextlib import nullcontext
from functools import cache, lru_cache
from hashlib import sha256
from math import nan
import pickle
from typing import Any

import attrs
from nadrc_ros.adrc.cascade import CascadeSettings
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.reference import ESTIMATED
from nadrc_ros.adrc.settings import ControllerSettings, REFERENCE_DERIVATIVES
from nadrc_ros.adrc.status import Status
from nadrc_ros.adrc.supervisor import PolicyState, Stall
from nadrc_ros.simulation import period
from nadrc_ros.simulation.compiled import announced, compiled_loop, same_alone
from nadrc_ros.simulation.compiled_law import compiled_law
from nadrc_ros.simulation.experiment import Experiment
from nadrc_ros.simulation.faults import Faults
from nadrc_ros.simulation.flat import flat, unflat
from nadrc_ros.simulation.integrate import make_work
from nadrc_ros.simulation.loop import Array, Loop, row_width
from nadrc_ros.simulation.protocols import probe_states
import numpy as np

_TRIED_PERIODS = 5
_TRIED_TIMES = 200
_SHORTEST_RUN = 1e-3  # of an experiment [s]
# Sets of numbers of a user's classes that are remembered as tried: a sweep may have any number.
_VERDICTS_KEPT = 256


class Kernel:
    """The compiled loop of one experiment, with its plant and signals as named tuples."""

    def __init__(self, experiment: Experiment) -> None:
        plant, *signals = experiment.plant, experiment.reference, experiment.disturbance
        self.fields = tuple(map(fields_of, (plant, *signals)))
        self.methods = (
            type(plant).derivative,
            type(plant).output,
            *(type(signal).derivatives for signal in signals),
        )
        self.states = plant.states
        self.late = experiment.input_delay > 0.0
        self.compiled = compiled_loop(*self.methods, plant.states, self.late)

    def __call__(self, loop: Loop, stop: int, rows: Array) -> bool:
        """Advance ``loop`` as :data:`~nadrc_ros.simulation.loop.Kernel` says."""
        experiment, plant_run, running = loop.experiment, loop.plant_run, loop.controller
        *around, _ = loop.cascade.loops
        if len(around) > 1 or (around and not self._cascade_believed(experiment)):
            return False
        acc, remainders = np.array(loop.metrics.sums), np.array(loop.remainders)
        facing = around[0] if around else running
        own = Running(running)
        its = Running(facing) if around else own
        xs = np.array([plant_run.state] * 3, dtype=np.float64)
        dead_time = plant_run.dead_time
        sent = np.array(dead_time.sent)
        r, w = np.zeros(REFERENCE_DERIVATIVES + 1), np.zeros(1)
        known, estimates = 1 + facing.settings.received_derivatives, 0
        if experiment.reference_alone:
            if facing.settings.reference_derivatives == 'auto':
                estimates = min(facing.settings.plant_order, ESTIMATED)
            known = 1
        memory, before = np.array(facing.intake.memory), np.array(facing.intake.memory)
        law = compiled_law(running.design)
        estimate = None
        if estimates:
            estimate = compiled_law(facing.design)['estimate_derivatives']
        outer = None
        if around:
            outer = (
                *(compiled_law(facing.design)['period'], law['realise']),
                (*its.parts, loop.inner_noise[0], own.reference, its.counts),
                its.limits[2:5],
                loop.derivatives[0],
            )
        design = running.design
        shares = _fields('Fields(order damping)')(
            design.order if design.known else 0, np.array(design.damping)
        )
        sensor = experiment.sensor
        try:
            k, last = self._variant(estimates > 0, bool(around))(
                self.fields,
                law['regular_period'],
                estimate,
                (*own.parts, shares),
                (
                    *(loop.noise, loop.fed, r, its.reference, memory, before),
                    *(*xs, w, np.array(make_work(xs.shape[1])), sent),
                ),
                (
                    *(experiment.rate, experiment.reference_rate, plant_run.substeps),
                    *(float(plant_run.plant.b0), known, estimates, experiment.error == 'tracking'),
                    *(sensor.wrap_min, sensor.wrap_max),
                ),
                own.limits,
                (dead_time.whole, dead_time.rest) if self.late else None,
                (plant_run.k, stop, loop.noise_start),
                (acc, remainders, own.counts),
                rows,
                outer,
            )
        except Exception:  # what is wrong with a plant is told by running it in plain Python
            return False
        if k > plant_run.k:
            plant_run.k = k
            plant_run.state = xs[last].tolist()
            facing.intake.memory[:] = memory.tolist()
            dead_time.sent = sent.tolist()
            loop.metrics.sums, loop.remainders = acc.tolist(), remainders.tolist()
            if around:
                its.give_back(last)
            own.give_back(last)
        return True

    def _variant(self, estimating: bool, cascade: bool) -> Any:
        """Return the loop for what else there is: numba would take each for a type of one."""
        if not (estimating or cascade):
            return self.compiled
        return compiled_loop(*self.methods, self.states, self.late, estimating, cascade)

    def _cascade_believed(self, experiment: Experiment) -> bool:
        """Compare the first periods of a cascade with plain Python, once for these methods."""
        verdict = _verdict((*self.methods, CascadeSettings), b'')
        if not verdict:
            verdict.append(True)  # while it is compared
            plant = experiment.plant
            inner = ControllerSettings(plant_order=plant.order - 1, b0=plant.b0)
            settings = CascadeSettings(plant_order=1, inner=inner)
            verdict[0] = _agrees(self, experiment, [0.0] * plant.states, settings)
        return verdict[0]


class Running:
    """A controller as the compiled loop takes it."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        design, state = controller.design, flat(controller.state)
        self.states = state, state.copy()
        self.told = np.zeros(period.SIZE), np.zeros(period.SIZE)
        policy = controller.policy
        for told in self.told:
            told[period.MODE : period.AT_LIMIT] = policy[:-1]
            told[period.AT_LIMIT : period.COMMAND] = policy.stall
            told[period.COMMAND] = controller.command
            told[period.GAIN_VARIABLE] = told[period.DOWNSTREAM] = nan
            told[period.REFERENCED] = told[period.ENABLED] = 1.0
        self.reference = np.array(controller.reference)
        self.counts = np.zeros(len(Status), dtype=np.int64)
        self.parts = flat(design), *self.states, *self.told
        self.limits = (
            *(design.command_min, design.command_max),
            *(design.reference_min, design.reference_max),
            *(design.measurement_period, design.levels),
        )

    def give_back(self, last: int) -> None:
        """Let the controller go on from where the compiled loop left it."""
        controller, told = self.controller, self.told[last].tolist()
        unflat(self.states[last], controller.state)
        controller.reference[:] = self.reference.tolist()
        numbers: list[Any] = told[period.MODE : period.AT_LIMIT]
        for i in (period.MODE, period.CAUSE, period.GOOD):
            numbers[i - period.MODE] = int(told[i])
        stall = Stall(*told[period.AT_LIMIT : period.COMMAND])
        controller.policy = PolicyState._make([*numbers, stall])
        controller.command = told[period.COMMAND]
        controller.status = Status(int(told[period.STATUS]))
        controller.commands.unfed = 0.0
        for each in Status:
            controller.counts[each] += int(self.counts[each])


def kernel_for(experiment: Experiment, say: Callable[[str], None] | None = None) -> Kernel | None:
    """
    Return the compiled loop of ``experiment``, None if its plant or a signal does not compile.

    A loop is believed only after a few periods of it, done here, gave the bits of plain Python.
    For classes from outside this package these are done with all their numbers and from several
    states, and each method is compared alone at times of the whole run. ``say`` is called with one
    line before numba compiles, which takes some seconds.
    """
    try:
        kernel = Kernel(experiment)
    except Exception:  # numba has many ways to say that it cannot
        return None
    foreign = not all(m.__module__.startswith('nadrc_ros.') for m in kernel.methods)
    # As bytes, which tell 1 from 1.0, as numba does, and are few for a long table too.
    numbers = sha256(pickle.dumps(kernel.fields)).digest() if foreign else b''
    verdict = _verdict((*kernel.methods, kernel.late), numbers)
    if not verdict:
        verdict.append(_believed(kernel, experiment, foreign, say))
    return kernel if verdict[0] else None


@lru_cache(_VERDICTS_KEPT)
def _verdict(methods: tuple[Any, ...], numbers: bytes) -> list[bool]:
    """Return the list that takes the one verdict on these methods with these numbers."""
    return []


def _believed(
    kernel: Kernel, experiment: Experiment, foreign: bool, say: Callable[[str], None] | None
) -> bool:
    try:
        things = experiment.plant, experiment.reference, experiment.disturbance
        times = [experiment.duration * i / _TRIED_TIMES for i in range(_TRIED_TIMES)]
        if foreign and not same_alone(kernel.methods, kernel.fields, things, times):
            return False
        with announced(kernel.compiled, say) if say is not None else nullcontext():
            states = probe_states(experiment.plant.states)
            settings = ControllerSettings(
                plant_order=experiment.plant.order, b0=experiment.plant.b0
            )
            states = states[: None if foreign else 1]
            return all(_agrees(kernel, experiment, x, settings) for x in states)
    except Exception:
        return False


def _agrees(
    kernel: Kernel, experiment: Experiment, x: list[float], settings: ControllerSettings
) -> bool:
    """Compare the first periods from a state with plain Python."""
    short = attrs.evolve(
        experiment,
        initial_state=tuple(x),
        duration=max(_TRIED_PERIODS * experiment.period, _SHORTEST_RUN),
        retunes=(),
        faults=Faults(),
        settle_time=0.0,
    )
    plain, fast = Loop(short, settings), Loop(short, settings)
    rows = np.full((2, short.steps, row_width(settings)), np.nan)
    went: list[bool] = []

    def watched(*now: Any) -> bool:
        went.append(kernel(*now))
        return went[-1]

    plain.run(rows[0])
    fast.run(rows[1], watched)
    same_state = plain.plant_run.state == fast.plant_run.state
    return all(went) and same_state and np.array_equal(rows[0], rows[1], equal_nan=True)


def fields_of(thing: Any) -> Any:
    """Return the numbers, and the lists of numbers, that ``thing`` has, as a named tuple."""
    names = [name for name in dir(thing) if name[0] != '_']
    found = {name: _constant(getattr(thing, name, None)) for name in names}
    found = {name: value for name, value in found.items() if value is not None}
    return _fields('Fields(' + ' '.join(found) + ')')(**found)


def __getattr__(name: str) -> Any:
    """Find the named tuple called ``name``, as numba does for a loop that it reads from disk."""
    if name.startswith('Fields('):
        return _fields(name)
    raise AttributeError(name)


@cache
def _fields(name: str) -> Any:
    cls = namedtuple('Fields', name[len('Fields(') : -1].split())  # type: ignore[misc]
    cls.__name__ = cls.__qualname__ = name
    cls.__module__ = __name__
    return cls


def _constant(value: Any) -> Any:
    """Return a number as one of Python's, a list as a tuple, a table as an array; None else."""
    if isinstance(value, array):
        return np.array(value, dtype=np.float64)
    if isinstance(value, (bool, int)):
        return value
    if isinstance(value, (float, np.floating)):
        return float(value)
    if isinstance(value, (list, tuple)):
        entries = tuple(map(_constant, value))
        return None if None in entries or not entries else entries
    return None
