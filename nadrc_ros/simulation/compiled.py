"""
The loop of a run compiled by numba, from the functions of the law, the plant and the metrics.

Every function of the loop is registered with numba, which
then compiles the source that runs in plain Python: same bits, 50 times the speed. One loop serves
one combination of plant, reference and disturbance class; their numbers are arguments, and so is
the law (see ``compiled_law``). What was compiled is kept on
disk, in ``__pycache__`` beside its source or else in the user's cache folder, under a name made of
the source files of all of it: numba by itself would not notice that another file than this one
changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from hashlib import sha256
from inspect import getmodule, getsource
from math import isfinite, isnan
from typing import Any

from nadrc_ros.adrc import angle
from nadrc_ros.adrc.angle import short
from nadrc_ros.adrc.sample import same
from nadrc_ros.adrc.settings import HIGHEST, LOWEST, REFERENCE_DERIVATIVES
from nadrc_ros.adrc.state import copy_vector, damping
from nadrc_ros.adrc.status import MODE_OK
from nadrc_ros.simulation import period
from nadrc_ros.simulation.compiled_law import address, unowned
from nadrc_ros.simulation.dead_time import reach
from nadrc_ros.simulation.integrate import integrate
from nadrc_ros.simulation.loop import FIRST_LEVEL, ROW_WIDTH
from nadrc_ros.simulation.metrics import accumulate, accumulate_remainders
from nadrc_ros.simulation.protocols import probe_states, sample_time, total_disturbance
from nadrc_ros.simulation.sensor import shown
import numba
from numba.core.event import Event, install_listener, Listener
from numba.extending import register_jitable
import numpy as np

# What a loop calls beside its plant, its signals and the law.
_CALLED = (
    *(integrate, sample_time, reach, total_disturbance, shown, short, angle.whole, copy_vector),
    *(accumulate, accumulate_remainders, damping, same),
)
# So many combinations of classes are kept ready; a further one is read from disk again.
_LOOPS_KEPT = 64
# Of a reference: itself and the derivatives that have a topic.
_REFERENCE_ENTRIES = 1 + REFERENCE_DERIVATIVES


@register_jitable(forceinline=False)
def advance(*arguments: Any) -> None:
    """Integrate, not inlined; were this local to a loop, numba would not find it on disk."""
    integrate(*arguments)


@lru_cache(_LOOPS_KEPT)
def compiled_loop(
    derivative: Any,
    output: Any,
    references: Any,
    disturbances: Any,
    states: int,
    late: bool = False,
    estimating: bool = False,
    cascade: bool = False,
) -> Callable[..., Any]:
    """
    Return the loop for these methods; it is compiled, or read from disk, at its first call.

    With an ``outer`` that is not None it is a cascade of two loops, with a ``dead_time`` the plant
    gets its command late: both are compiled apart, as is what estimates derivatives.
    """
    methods = derivative, output, references, disturbances
    for function in (*methods, *_CALLED):
        register_jitable(function)

    def loop(
        things: Any,
        regular: Any,
        estimate: Any,
        law: Any,
        buffers: Any,
        constants: Any,
        limits: Any,
        dead_time: Any,
        begin: Any,
        sums: Any,
        rows: Any,
        outer: Any,
    ) -> Any:
        plant, reference_signal, disturbance = unowned(things)
        design, state, spare, told, gives, shares = unowned(law)
        parts = unowned(buffers)
        noise, fed, r, reference, memory, memory_before = parts[:6]
        x, x_next, x_middle, w, work, sent = parts[6:]
        rate, own_rate, substeps, b0, known, estimates, tracking, wrap_min, wrap_max = constants
        command_min, command_max, reference_min, reference_max, wrap, levels = limits
        lowest, highest = reference_min, reference_max
        k, stop, noise_start = begin
        acc, remainders, counts = unowned(sums)
        rows = unowned(rows)
        asking = measured_rate = 0.0
        below = 0
        facing, asked, asks = design, told, gives
        if outer is not None:
            around, realise, outer_parts, outer_limits, below = outer
            facing, outer_state, outer_spare, asked, asks, rate_noise, follows, outer_counts = (
                unowned(outer_parts)
            )
            lowest, highest, wrap = outer_limits
        h = 1.0 / rate
        first = k
        lost = isnan(x[0])
        while k < stop:
            t = k / rate
            if estimate is not None:
                copy_vector(memory, memory_before)
            for i in range(len(r)):
                r[i] = 0.0
            references(reference_signal, sample_time(k, rate, own_rate), r)
            # What is out of the ordinary ends this before the period is done, with all as it was
            # at its begin. Plain Python does the period then: there a plant of a user's raises,
            # with its line, what compiled is a silent nan.
            usable = lowest <= r[0] <= highest
            for i in range(len(r)):
                usable = usable and LOWEST <= r[i] <= HIGHEST
            load = fed[k - noise_start]
            if not (usable and LOWEST <= load <= HIGHEST):
                break
            for i in range(known + estimates, len(reference)):
                reference[i] = 0.0
            for i in range(known):
                reference[i] = r[i]
            if estimate is not None:
                estimate(address(facing), address(memory), address(asked), r[0], h)
                if asked[period.CHANGED] > 0.0:
                    for i in range(1, 1 + estimates):
                        reference[i] = asked[period.CHANGED + i]
            y = output(plant, x)
            measurement = shown(y + noise[k - noise_start], wrap_min, wrap_max)
            told[period.SPAN], told[period.FEED_FORWARD] = h, load
            told[period.MEASUREMENT] = measurement
            if outer is None:
                regular(
                    *(address(design), address(state), address(reference)),
                    *(address(told), address(spare), address(gives)),
                )
            else:
                realise(address(design), address(state), address(told), asked[period.COMMAND])
                acted = told[period.REALISED]
                if not LOWEST <= acted <= HIGHEST:
                    break
                asked[period.MEASUREMENT], asked[period.APPLIED] = measurement, acted
                asked[period.SPAN] = asked[period.ELAPSED] = h
                asked[period.FOLLOWED] = 1.0 if told[period.MODE] == MODE_OK else 0.0
                asked[period.SENT], asked[period.DOWNSTREAM] = asked[period.COMMAND], acted
                asked[period.FOREIGN] = 0.0 if same(asked[period.COMMAND], acted) else 1.0
                around(
                    *(address(facing), address(outer_state), address(reference)),
                    *(address(asked), address(outer_spare), address(asks)),
                )
                if asks[period.LEFT] > 0.0:
                    break
                asking = asks[period.COMMAND]
                if not reference_min <= asking <= reference_max:
                    break
                follows[0] = asking
                measured_rate = x[below] + rate_noise[k - noise_start]
                told[period.MEASUREMENT] = measured_rate
                regular(
                    *(address(design), address(state), address(follows)),
                    *(address(told), address(spare), address(gives)),
                )
            if gives[period.LEFT] > 0.0:
                break
            u = gives[period.COMMAND]
            disturbances(disturbance, t, w)
            reached = acting = later = u
            if dead_time is not None:
                whole, rest = dead_time
                reached, acting, later = reach(sent, whole, rest, k, u, u)
            truth = total_disturbance(derivative, plant, b0, t, x, acting, w[0], work[0])
            if acting != reached:
                truth += b0 * (acting - reached)
            truth += (b0 - gives[period.B0]) * reached
            if shares.order > 0:
                truth += damping(shares, x, below)
            if dead_time is not None:
                since, span, source = t, h, x
                if rest > 0.0:
                    parts = t, x, acting, rest, substeps, work, w, x_middle, states
                    advance(derivative, plant, disturbances, disturbance, *parts)
                    since, span, source = t + rest, h - rest, x_middle
                    disturbances(disturbance, since, w)
                    derivative(plant, since, source, later, w[0], work[0])
                parts = since, source, later, span, substeps, work, w, x_next, states
                advance(derivative, plant, disturbances, disturbance, *parts)
            else:
                parts = t, x, u, h, substeps, work, w, x_next, states
                integrate(derivative, plant, disturbances, disturbance, *parts)
            if not lost:  # a plant that was lost before stays so
                fine = isfinite(truth)
                for i in range(len(x)):
                    fine = fine and isfinite(x_next[i])
                if not fine:
                    break
            facts = asks if outer is not None else gives
            tracked = facts[period.TRACKED]
            followed = tracked if tracking else r[0]
            error = short(followed - y, wrap)
            saturated = u <= command_min or u >= command_max
            accumulate(acc, t, h, error, u, saturated)
            estimated = gives[period.FIRST_LEVEL :]
            left = truth - gives[period.KNOWN]
            accumulate_remainders(left, estimated, levels, t, h, remainders)
            counts[int(gives[period.STATUS])] += 1
            if k < len(rows):
                row = rows[k]
                row[0] = t
                row[1] = r[0]
                row[2] = tracked
                row[3] = y
                row[4] = measurement
                row[5] = u
                row[6] = facts[period.ESTIMATE]
                row[7] = gives[period.DISTURBANCE]
                row[8] = truth
                for level in range(levels):
                    row[FIRST_LEVEL + level] = estimated[level]
                if outer is not None:
                    row[ROW_WIDTH] = asking
                    row[ROW_WIDTH + 1] = x[below]
                    row[ROW_WIDTH + 2] = measured_rate
            for i in (period.MODE, period.CAUSE):
                if gives[i] != told[i]:
                    stop = k + 1
            state, spare = spare, state
            told, gives = gives, told
            if outer is not None:
                outer_state, outer_spare = outer_spare, outer_state
                asked, asks = asks, asked
                outer_counts[int(asked[period.STATUS])] += 1
            else:
                asked = told
            x, x_next = x_next, x
            k += 1
        if k < stop and estimate is not None:  # plain Python takes this sample anew
            copy_vector(memory_before, memory)
        return k, (k - first) % 2

    variant = f'{states}_{late}_{estimating}_{cascade}'
    known = _named_by_source(loop, (*methods, *_CALLED, period.period), variant)
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


def _named_by_source(
    function: Any, parts: Iterable[Callable[..., Any]], variant: str = ''
) -> bool:
    """
    Give a function the name of its file on disk: one hash of its source and of its parts'.

    The parts and the variant are named in it too, as no two loops may share a file: numba numbers
    what is in one, and of two processes that add to it at once one would read what the other
    wrote. Return False without source, as for what is typed into an interpreter: then nothing
    would tell one state of it from another.
    """
    parts = (function, *parts)
    names = [(part.__module__, part.__qualname__) for part in parts]
    digest = sha256(repr((variant, names)).encode())
    try:
        for module in dict.fromkeys(map(getmodule, parts)):
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
