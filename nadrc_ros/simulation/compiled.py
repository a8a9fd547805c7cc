"""
The loop of a run compiled by numba, from the functions of the law, the plant and the metrics.

This is the one file that imports numba. Every function of the loop is registered with numba, which
then compiles the source that runs in plain Python: same bits, 50 times the speed. One loop serves
one combination of plant, reference and disturbance class; their numbers and the controller's
are arguments. The law is compiled once for all loops, which takes longer than the rest of one.
What was compiled is kept on disk, in ``__pycache__`` beside its source or else in the user's cache
folder, under a name made of the source files of all of it: numba by itself would not notice that
another file than this one changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache, lru_cache
from hashlib import sha256
from importlib import import_module
from inspect import getmembers, getmodule, getsource, isfunction
from math import isfinite, isnan, nan
from types import FunctionType, ModuleType
from typing import Any

from nadrc_ros.adrc import angle, law, observer, state
from nadrc_ros.adrc import tick as ticks
from nadrc_ros.adrc.angle import counted, short
from nadrc_ros.adrc.realised import realised_reference
from nadrc_ros.adrc.reference import estimated, follow
from nadrc_ros.adrc.sample import regular, Sample
from nadrc_ros.adrc.settings import HIGHEST, LOWEST, REFERENCE_DERIVATIVES
from nadrc_ros.adrc.state import (
    copy_vector,
    damping,
    disturbance_estimate,
    output_estimate,
)
from nadrc_ros.adrc.status import MODE_OK
from nadrc_ros.adrc.tick import tick
from nadrc_ros.simulation.dead_time import reach
from nadrc_ros.simulation.integrate import integrate
from nadrc_ros.simulation.loop import FIRST_LEVEL, ROW_WIDTH
from nadrc_ros.simulation.metrics import accumulate, accumulate_remainders
from nadrc_ros.simulation.protocols import probe_states, sample_time, total_disturbance
from nadrc_ros.simulation.sensor import shown
import numba
from numba import types
from numba.core.event import Event, install_listener, Listener
from numba.extending import intrinsic, overload, register_jitable
import numpy as np


def _modules(*names: str) -> tuple[ModuleType, ...]:
    return tuple(import_module(f'nadrc_ros.adrc.{name}') for name in names)


# What a usual period calls is inlined, which makes the loop six times as fast. The rest, which
# only some settings or the ends of a fault need, would multiply the time to compile for nothing.
_RARE = _modules(
    *('delay_line', 'transition', 'internal_model', 'gain', 'deadband'),
    *('transfer', 'realised', 'reference'),
)
_LAW = (
    *(angle, law, observer, state, ticks, *_RARE),
    *_modules('limiter', 'feedback', 'differentiator', 'supervisor'),
    *_modules('sample', 'settings', 'status'),
)
_SIMULATION = (
    *(integrate, sample_time, reach, total_disturbance, shown),
    *(accumulate, accumulate_remainders),
)
# So many combinations of classes are kept ready; a further one is read from disk again.
_LOOPS_KEPT = 64
# Of a reference: itself and the derivatives that have a topic.
_REFERENCE_ENTRIES = 1 + REFERENCE_DERIVATIVES
_NOT_INLINED = (
    *(law._refuse, law._restart, ticks._take_over, ticks._without_sample),
    *(state.start, state.rest, state.copy_state, state.match_command, state.calm),
    *(state.reference_share, observer.place, observer.softened),
    *(angle.receive, angle.recentre, angle.unwrapped),
)
# Compiled once for all loops, which takes longer than the rest of one.
_SHARED = (tick, follow)


@intrinsic
def unowned(context: Any, value: Any) -> Any:
    """
    Return ``value`` with arrays that are not counted: the caller keeps them alive.

    The law hands rows of arrays to functions and swaps states each period. Counted, each of these
    takes and gives back a reference, and the loop is three times as slow.
    """

    def strip(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, value)
            array.meminfo = array.meminfo.type(None)
            return array._getvalue()
        if isinstance(kind, types.BaseTuple):
            for i, part in enumerate(kind):
                stripped = strip(context, builder, part, builder.extract_value(value, i))
                value = builder.insert_value(value, stripped, i)
        return value

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return strip(context, builder, signature.args[0], args[0])

    return value(value), codegen


@register_jitable(forceinline=False)
def advance(*arguments: Any) -> None:
    """Integrate, not inlined; were this local to a loop, numba would not find it on disk."""
    integrate(*arguments)


@lru_cache(_LOOPS_KEPT)
def compiled_loop(
    derivative: Any, output: Any, references: Any, disturbances: Any
) -> Callable[..., Any]:
    """
    Return the loop for these methods; it is compiled, or read from disk, at its first call.

    With an ``outer`` that is not None it is a cascade of two loops, which is compiled apart.
    """
    methods = derivative, output, references, disturbances
    share_law()
    for function in (*methods, *_SIMULATION):
        _register(function)

    def loop(
        things: Any,
        law: Any,
        buffers: Any,
        constants: Any,
        dead_time: Any,
        begin: Any,
        sums: Any,
        rows: Any,
        outer: Any,
    ) -> Any:
        plant, reference_signal, disturbance = unowned(things)
        design, state, spare = unowned(law)
        parts = unowned(buffers)
        noise, fed, r, reference, memory, memory_before = parts[:6]
        x, x_next, x_middle, w, work, sent = parts[6:]
        rate, own_rate, substeps, b0, known, estimates, tracking, wrap_min, wrap_max = constants
        whole, rest = dead_time
        late = sent.shape[1] > 0
        k, stop, noise_start, command, policy = begin
        acc, remainders, counts = unowned(sums)
        rows = unowned(rows)
        facing, around, asked, asked_status, below = design, policy, 0.0, 0, 0
        if outer is not None:
            facing, outer_state, outer_spare, rate_noise, inner_reference, outer_counts = unowned(
                outer[0]
            )
            controlled, asked, around = outer[1]
            below = controlled
        h = 1.0 / rate
        first = k
        lost = isnan(x[0])
        status = 0
        while k < stop:
            t = k / rate
            if estimates > 0:
                copy_vector(memory, memory_before)
            for i in range(len(r)):
                r[i] = 0.0
            references(reference_signal, sample_time(k, rate, own_rate), r)
            # What is out of the ordinary ends this before the period is done, with all as it was
            # at its begin. Plain Python does the period then: there a plant of a user's raises,
            # with its line, what compiled is a silent nan.
            usable = facing.reference_min <= r[0] <= facing.reference_max
            for i in range(len(r)):
                usable = usable and LOWEST <= r[i] <= HIGHEST
            if not (usable and LOWEST <= fed[k - noise_start] <= HIGHEST):
                break
            for i in range(known + estimates, len(reference)):
                reference[i] = 0.0
            for i in range(known):
                reference[i] = r[i]
            if estimates > 0 and follow(facing, memory, r[0], True, h, 0.0):
                for i in range(1, 1 + estimates):
                    reference[i] = estimated(memory, i)
            y = output(plant, x)
            measurement = shown(y + noise[k - noise_start], wrap_min, wrap_max)
            if outer is None:
                sample = regular(measurement, h, command, fed[k - noise_start])
                u, now, decided = tick(design, state, policy, sample, reference, True, True, spare)
            else:
                acted = realised_reference(design, state, policy, command, asked)
                if not LOWEST <= acted <= HIGHEST:
                    break
                follows = policy.mode == MODE_OK
                sample = Sample(measurement, h, h, 0.0, acted, follows, nan, 0.0, asked, 0.0)
                asking, asked_now, asked_decided = tick(
                    facing, outer_state, around, sample, reference, True, True, outer_spare
                )
                if not design.reference_min <= asking <= design.reference_max:
                    break
                inner_reference[0] = asking
                measured_rate = x[controlled] + rate_noise[k - noise_start]
                sample = regular(measured_rate, h, command, fed[k - noise_start])
                u, now, decided = tick(
                    design, state, policy, sample, inner_reference, True, True, spare
                )
            disturbances(disturbance, t, w)
            reached = acting = later = u
            if late:
                reached, acting, later = reach(sent, whole, rest, k, u, u)
            truth = total_disturbance(derivative, plant, b0, t, x, acting, w[0], work[0])
            if acting != reached:
                truth += b0 * (acting - reached)
            truth += (b0 - spare.gain[0]) * reached
            if design.known:
                truth += damping(design, x, below)
            if late:
                since, span, source = t, h, x
                if rest > 0.0:
                    parts = t, x, acting, rest, substeps, work, w, x_middle
                    advance(derivative, plant, disturbances, disturbance, *parts)
                    since, span, source = t + rest, h - rest, x_middle
                    disturbances(disturbance, since, w)
                    derivative(plant, since, source, later, w[0], work[0])
                parts = since, source, later, span, substeps, work, w, x_next
                advance(derivative, plant, disturbances, disturbance, *parts)
            else:
                parts = t, x, u, h, substeps, work, w, x_next
                integrate(derivative, plant, disturbances, disturbance, *parts)
            if not lost:  # a plant that was lost before stays so
                fine = isfinite(truth)
                for i in range(len(x)):
                    fine = fine and isfinite(x_next[i])
                if not fine:
                    break
            command, status, policy = u, now, decided
            if outer is None:
                tracked = counted(design, spare, spare.profile[0])
                estimate = counted(design, spare, output_estimate(design, spare))
            else:
                tracked = counted(facing, outer_spare, outer_spare.profile[0])
                estimate = counted(facing, outer_spare, output_estimate(facing, outer_spare))
            followed = tracked if tracking else r[0]
            error = short(followed - y, facing.measurement_period)
            saturated = u <= design.command_min or u >= design.command_max
            accumulate(acc, t, h, error, u, saturated)
            accumulate_remainders(design, spare, truth, t, h, remainders)
            counts[status] += 1
            if k < len(rows):
                row = rows[k]
                row[0] = t
                row[1] = r[0]
                row[2] = tracked
                row[3] = y
                row[4] = measurement
                row[5] = u
                row[6] = estimate
                row[7] = disturbance_estimate(design, spare)
                row[8] = truth
                for level in range(design.levels):
                    row[FIRST_LEVEL + level] = spare.levels[level][design.order]
                if outer is not None:
                    row[ROW_WIDTH] = asking
                    row[ROW_WIDTH + 1] = x[controlled]
                    row[ROW_WIDTH + 2] = measured_rate
            state, spare = spare, state
            if outer is not None:
                outer_state, outer_spare = outer_spare, outer_state
                asked, asked_status, around = asking, asked_now, asked_decided
                outer_counts[asked_now] += 1
            x, x_next = x_next, x
            k += 1
        if k < stop and estimates > 0:  # plain Python takes the sample of this period anew
            copy_vector(memory_before, memory)
        return k, status, command, policy, (k - first) % 2, (asked_status, asked, around)

    known = _named_by_source(loop, (*methods, *_SIMULATION))
    fast: Callable[..., Any] = numba.njit(nogil=True, cache=known)(loop)
    return fast


def same_alone(
    methods: tuple[Any, ...],
    fields: tuple[Any, ...],
    things: tuple[Any, ...],
    times: Iterable[float],
) -> bool:
    """
    Tell whether plant and signals, ``things``, give the bits of plain Python at all ``times``.

    Raises if a method does not compile: to see that takes no second, the whole loop many.
    """
    derivative, output, *sampled = map(_alone, methods)
    plant, *signals = things
    probes = probe_states(plant.states)[1:]
    for i, t in enumerate(times):
        x = [(1.0 + 0.01 * i) * part for part in probes[i % len(probes)]]
        calls: list[Any] = [
            (derivative, fields[0], plant, type(plant).derivative, (t, x, 0.1 * i, 1.0))
        ]
        for fast, own, signal in zip(sampled, fields[1:], signals):
            calls.append((fast, own, signal, type(signal).derivatives, (t,)))
        if output(fields[0], np.array(x)) != x[0] or not all(_same(*call) for call in calls):
            return False
    return True


def _same(fast: Any, own: Any, thing: Any, plain: Any, arguments: tuple[Any, ...]) -> bool:
    entries = _REFERENCE_ENTRIES if len(arguments) == 1 else thing.states
    out, expected = np.zeros(entries), [0.0] * entries
    try:
        plain(thing, *arguments, expected)
    except Exception:  # it will be said by the run that comes there
        return True
    fast(own, *(np.array(a) if isinstance(a, list) else a for a in arguments), out)
    return np.array_equal(expected, out, equal_nan=True)


@lru_cache(_LOOPS_KEPT)
def _alone(method: Any) -> Any:
    """Return a method compiled by itself, once for each type of its numbers."""
    return numba.njit(method)


@cache
def share_law() -> None:
    """Have ``_SHARED``, wherever they are called, compiled once and kept on disk by themselves."""
    for function in _law():
        if function not in _SHARED:
            _register(function)
    for function in _SHARED:
        _share(function)


def _share(function: Any) -> None:
    shared = FunctionType(function.__code__, function.__globals__)
    options = {'forceinline': _is_inlined(function), 'cache': _named_by_source(shared, ())}
    overload(function, jit_options=options, strict=False)(lambda *arguments: shared)


@cache
def _register(function: Callable[..., Any]) -> None:
    register_jitable(forceinline=_is_inlined(function))(function)


def _is_inlined(function: Callable[..., Any]) -> bool:
    return function not in _NOT_INLINED and getmodule(function) not in _RARE


@cache
def _law() -> tuple[Callable[..., Any], ...]:
    return tuple(
        function
        for module in _LAW
        for _, function in getmembers(module, isfunction)
        if function.__module__ == module.__name__
    )


def _named_by_source(function: Any, parts: Iterable[Callable[..., Any]]) -> bool:
    """
    Give a function the name of its file on disk: one hash of the law's source and of its parts'.

    The parts are named in it too, as no two loops may share a file: numba numbers what is in one,
    and of two processes that add to it at once one would read what the other wrote. Return False
    without source, as for what is typed into an interpreter: then nothing would tell one state of
    it from another.
    """
    parts = (function, *parts)
    digest = sha256(repr([(part.__module__, part.__qualname__) for part in parts]).encode())
    try:
        for module in dict.fromkeys((*_LAW, *map(getmodule, parts))):
            digest.update(getsource(module).encode())  # type: ignore[arg-type]
    except (OSError, TypeError):
        return False
    function.__qualname__ = f'{function.__name__}_{digest.hexdigest()[:16]}'
    return True


class _Announcer(Listener):  # type: ignore[misc]
    """Says so when numba compiles the loop."""

    def __init__(self, compiled: Any, say: Callable[[str], None]) -> None:
        self.compiled = compiled
        self.say = say

    def on_start(self, event: Event) -> None:
        if event.data['dispatcher'] is self.compiled:
            self.say('compiling the simulation for this plant and these signals, once')

    def on_end(self, event: Event) -> None:
        pass


def announced(compiled: Any, say: Callable[[str], None]) -> Any:
    """Return a context that has ``say`` called should numba compile that loop inside it."""
    return install_listener('numba:compile', _Announcer(compiled, say))
