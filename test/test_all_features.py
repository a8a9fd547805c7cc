"""All features of the law together, each on or off at random, and what is promised of them."""

from __future__ import annotations

from copy import deepcopy
from math import isfinite, sin
from pathlib import Path
import random
from tempfile import TemporaryDirectory
from typing import Any

import attrs
from hypothesis import assume, given
from hypothesis import strategies as st
from law_helpers import at_least, bits, Chain, INF, NAN
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.limiter import clamp, limit, present
from nadrc_ros.adrc.settings import ControllerSettings, GAIN_SOURCES
from nadrc_ros.adrc.state import raw_command
from nadrc_ros.adrc.status import Mode, Status
from nadrc_ros.records.step_trace import replay, TraceWriter
import pytest
from test_live_change import H, scaled, VALUES

TICKS = 200
# What is fixed at start; what is live is in VALUES.
FIXED: dict[str, st.SearchStrategy[Any]] = {
    'plant_order': st.integers(1, 3),
    'b0_source': st.sampled_from(GAIN_SOURCES),
    'reference_derivatives': st.sampled_from(('auto', 'auto', 'topics', 'differentiator', 'none')),
    'measurement_period': st.sampled_from((0.0, 6.283185307179586, 1.0)),
    'applied_timeout': st.sampled_from((0.0, 0.1)),
    'feed_forward_timeout': st.sampled_from((0.0, 0.1)),
}
BAD = (NAN, NAN, INF, -INF, 1e300)
LIMITS = {
    'command_min': st.just(-20.0),
    'command_max': st.just(30.0),
    'command_rate_limit': st.sampled_from((0.0, 100.0, 2000.0)),
    'measurement_timeout': st.sampled_from((0.0, 0.05, 0.25)),
    'good_samples': st.integers(1, 5),
}
Changes = list[tuple[str, Any]]


@st.composite
def everything(draw: st.DrawFn) -> ControllerSettings:
    values = {name: draw(strategy) for name, strategy in (VALUES | LIMITS | FIXED).items()}
    for name in ('plant_poles', 'disturbance_frequencies', 'b0_table', 'input_delay'):
        if draw(st.booleans()):
            del values[name]
    if values['tracking_acceleration'] > 0.0:
        values['reference_derivatives'] = draw(
            st.sampled_from(('auto', 'topics', 'differentiator'))
        )
    sign = draw(st.sampled_from((1.0, -1.0)))
    values['b0'] *= sign
    if 'b0_table' in values:
        values['b0_table'] = scaled(values['b0_table'], sign)
    try:
        return ControllerSettings(**values)
    except SettingError:
        assume(False)
        raise


CHANGES = st.lists(
    st.sampled_from(sorted(VALUES)).flatmap(lambda name: st.tuples(st.just(name), VALUES[name])),
    max_size=8,
)


def changed(settings: ControllerSettings, name: str, value: Any) -> ControllerSettings | None:
    sign = 1.0 if settings.b0 > 0.0 else -1.0
    if name == 'b0':
        value *= sign
    if name == 'b0_table':
        value = scaled(value, sign)
    try:
        return attrs.evolve(settings, **{name: value})
    except SettingError:
        return None


class World:
    """A plant, and what a controller is told of it and of others, right and wrong."""

    def __init__(self, settings: ControllerSettings, seed: int) -> None:
        self.settings = settings
        self.rng = random.Random(seed)
        self.chain = Chain(settings.plant_order)
        self.time = self.waited = 0.0
        self.spells: dict[str, int] = {}

    def happens(self, what: str, share: float, length: int) -> bool:
        """Tell whether a spell of it is on."""
        left = self.spells.get(what, 0)
        if left == 0 and self.rng.random() < share / length:
            left = self.rng.randint(1, 2 * length)
        self.spells[what] = max(left - 1, 0)
        return left > 0

    def next(self, u: float) -> dict[str, Any]:
        """Return the arguments of the next tick, u being the command of the last one."""
        rng, settings = self.rng, self.settings
        h = H * (1.0 + rng.uniform(-0.2, 0.2)) if self.happens('jitter', 0.5, 20) else H
        if rng.random() < 0.005:
            h = 0.3 + rng.random()
        self.time += h
        self.waited += h
        acting = max(-8.0, min(8.0, u)) if self.happens('limited', 0.3, 30) else u
        if self.happens('foreign', 0.1, 10):
            acting = 7.3
        load = 2.0 * sin(25.0 * self.time)
        self.chain.advance(settings.b0 * acting + load, h)
        if not abs(self.chain.y) < 1e4:
            self.chain = Chain(settings.plant_order)
        y, dt = self.chain.y + 0.001 * rng.gauss(0.0, 1.0), self.waited
        if settings.measurement_period:
            y %= settings.measurement_period
        if self.happens('silent', 0.3, 10):
            y, dt = NAN, 0.0
        elif rng.random() < 0.05:
            y = rng.choice((*BAD, 1e6))
        elif rng.random() < 0.03:
            dt = rng.choice((0.0, -H, NAN, INF, 1e-12))
        self.waited = 0.0 if dt else self.waited
        arguments: dict[str, Any] = {'measurement': y, 'dt': dt, 'elapsed': h}
        arguments['age'] = rng.choice((0.0, 0.5 * h))
        if not self.happens('no reference', 0.5, 40):
            arguments['reference'] = self.reference()
        if settings.applied_timeout and not self.happens('no report', 0.5, 20):
            arguments['applied'] = rng.choice(BAD) if rng.random() < 0.05 else acting
            arguments['applied_age'] = rng.choice((0.0, H, NAN))
        if settings.feed_forward_timeout and not self.happens('no feed-forward', 0.5, 20):
            arguments['feed_forward'] = rng.choice(BAD) if rng.random() < 0.05 else -load
        if not self.happens('no variable', 0.5, 20):
            arguments['gain_variable'] = rng.choice((*BAD, rng.uniform(-1.0, 2.0)))
        return arguments

    def reference(self) -> list[float | None]:
        rng, time = self.rng, self.time
        if self.happens('staircase', 0.3, 50):
            time -= time % 0.05
        r = 3.0 * sin(2.0 * time) if self.happens('moving', 0.5, 60) else 0.3
        if self.settings.measurement_period:
            r %= self.settings.measurement_period
        if rng.random() < 0.05:
            return [rng.choice(BAD), 0.0]
        if self.happens('derivatives', 0.3, 30):
            return [r, rng.choice((*BAD, None, 6.0)), None]
        return [r]


def levels_of(controller: Controller) -> list[list[str]]:
    return [bits(row) for row in (*controller.state.levels, controller.state.ripple)]


def numbers(controller: Controller) -> bool:
    state = controller.state
    rows = [*state.levels, state.profile, state.offset, state.smoothed, state.startup, state.gain]
    rows += [state.resting, state.since_sample, state.delay_line, state.angle[1:], state.ripple]
    return all(isfinite(x) for row in rows for x in row)


@at_least(80)
@given(everything(), CHANGES, st.integers(0, 2**30))
def test_p01_p02_p03_p04_p05_p11_p12_p18_whatever_comes_and_changes(
    settings: ControllerSettings, changes: Changes, seed: int
) -> None:
    world = World(settings, seed)
    controller, rng = Controller(settings), random.Random(seed + 1)
    when = {rng.randrange(20, TICKS): change for change in changes}
    with TemporaryDirectory() as folder:
        trace = TraceWriter(Path(folder) / 'trace', settings)
        for k in range(TICKS):
            if rng.random() < 0.01:
                controller.enabled = not controller.enabled
                if not controller.enabled:
                    trace.disabled()
            if rng.random() < 0.005:
                controller.reset()
                trace.reset()
            kept, wanted = None, None
            if k in when:
                wanted = changed(controller.settings, *when[k])
            if wanted is not None:
                kept = deepcopy(controller)
                controller.retune(wanted)
                trace.settings(wanted)
            told = world.next(controller.command)
            judge_tick(controller, told, kept, f'tick {k}')
            trace.tick(controller, told.get('reference'))
        trace.close()
        pairs = list(replay(Path(folder) / 'trace'))
    assert len(pairs) == TICKS
    for k, (recorded, again) in enumerate(pairs):
        assert recorded == again, k
    recovers(controller)


def judge_tick(
    controller: Controller, told: dict[str, Any], kept: Controller | None, label: str
) -> None:
    """Tick, and look at what is promised of it; ``kept`` is the controller without a change."""
    before, mode, levels = controller.command, controller.mode, levels_of(controller)
    gap = controller.policy.gap
    started = controller.policy.measurement_age < INF
    old, fed = controller.design, controller.state.offset[2]
    u = controller.tick(**told)
    new, sample = controller.design, controller.sample
    assert new.command_min <= u <= new.command_max, label
    assert numbers(controller), label
    acts = present(before, sample.downstream)
    if mode in (Mode.RAMPING, Mode.SAFE) and sample.foreign:  # somebody else is in control
        acts = sample.applied
    ends = [clamp(new, v) for v in (before, acts)]
    limits = [d.command_rate_limit for d in (old, new)]
    if min(limits) > 0.0:
        most = max(limits) * sample.elapsed * (1.0 + 1e-9) + 1e-12
        assert min(ends) - most <= u <= max(ends) + most, label
    used = controller.status < Status.NO_MEASUREMENT
    if kept is not None:
        expected = kept.tick(**told)
        assert u == pytest.approx(clamp(new, expected), rel=1e-12, abs=1e-9), label
        narrowed = limits[1] > 0.0 and not 0.0 < limits[0] <= limits[1]  # from the next tick on
        if controller.mode == Mode.OK and mode == Mode.OK and used and not narrowed:
            raw = raw_command(new, controller.state)
            scale = 1e-12 * max(map(abs, (v for row in controller.state.levels for v in row)))
            over = min(gap + sample.span, sample.elapsed)
            asked = limit(new, raw, before, over, sample.downstream)[0]
            assert asked == pytest.approx(u, abs=1e-9 + scale), label
    elif not used and started:  # else the observers begin at it
        assert levels_of(controller) == levels, label
        same = fed == controller.state.offset[2]
        if old.command_rate_limit == 0.0 and same:  # it is where it was
            assert u in (*ends, new.safe_command), label
    if used and mode != Mode.OK and controller.mode == Mode.OK:
        assert u == pytest.approx(ends[1], abs=1e-9), label


def recovers(controller: Controller) -> None:
    """After whatever it was, the law acts within the good samples and some odd ones."""
    controller.enabled = True
    for _ in range(controller.design.good_samples + 20):
        u = controller.tick(0.2, H, reference=[0.3], applied=controller.command)
        if controller.mode == Mode.OK:
            break
    assert controller.mode == Mode.OK, controller.cause
    assert controller.status < Status.NO_MEASUREMENT and isfinite(u)


def elsewhere(settings: ControllerSettings, push: float, size: float) -> ControllerSettings:
    """Return the settings for a command ``push`` times as large, and an output ``size`` times."""
    outputs: tuple[str, ...] = (
        'eso_delta',
        'tracking_acceleration',
        'error_deadband',
        'measurement_period',
    )
    outputs += tuple(
        f'{of}_{end}' for of in ('measurement', 'reference') for end in ('min', 'max')
    )
    values = {name: getattr(settings, name) * size for name in outputs}
    table, x = settings.b0_table, 1.0 if settings.b0_source == 'topic' else size
    if table != (0.0,):
        table = tuple(v * size / push if i % 2 else v * x for i, v in enumerate(table))
    low, high = sorted((settings.command_min * push, settings.command_max * push))
    return attrs.evolve(
        settings,
        **values,
        b0=settings.b0 * size / push,
        b0_table=table,
        command_min=low,
        command_max=high,
        command_rate_limit=settings.command_rate_limit * abs(push),
        safe_command=settings.safe_command * push,
    )


@at_least(30)
@given(
    everything(),
    CHANGES,
    st.integers(0, 2**30),
    st.sampled_from((-1.0, -0.25, 8.0)),
    st.sampled_from((1.0, 0.125, 16.0)),
)
def test_in_other_units_and_with_the_other_sign_of_b0_all_is_the_same_to_the_bit(
    settings: ControllerSettings, changes: Changes, seed: int, push: float, size: float
) -> None:
    """But with fal, whose exponents know a unit."""
    settings = attrs.evolve(settings, feedback='linear')
    world, rng = World(settings, seed), random.Random(seed + 1)
    when = {rng.randrange(20, TICKS): change for change in changes if change[0] != 'feedback'}
    here, there = Controller(settings), Controller(elsewhere(settings, push, size))
    for k in range(TICKS):
        if rng.random() < 0.01:
            here.enabled = there.enabled = not here.enabled
        wanted = changed(here.settings, *when[k]) if k in when else None
        if wanted is not None:
            here.retune(wanted)
            there.retune(elsewhere(wanted, push, size))
        told = world.next(here.command)
        scaled_told = dict(told)
        for name, scale in (('measurement', size), ('applied', push), ('feed_forward', push)):
            if name in told:
                scaled_told[name] = told[name] * scale
        if 'reference' in told:
            scaled_told['reference'] = [v if v is None else v * size for v in told['reference']]
        assert here.tick(**told) * push == there.tick(**scaled_told), k
        assert here.status == there.status and here.mode == there.mode, k


@at_least(30)
@given(everything(), everything(), CHANGES, st.integers(0, 2**30))
def test_p02_p12_p18_so_are_both_loops_of_a_cascade(
    outer: ControllerSettings, inner: ControllerSettings, changes: Changes, seed: int
) -> None:
    outer = attrs.evolve(outer, applied_timeout=0.0)
    inner = attrs.evolve(inner, measurement_period=0.0, reference_min=-1e3, reference_max=1e3)
    loops, rng = [Controller(outer), Controller(inner)], random.Random(seed)
    loops[0].join(loops[1])
    worlds = [World(loop.settings, seed + 1) for loop in loops]
    when = {rng.randrange(20, TICKS): change for change in changes}
    with TemporaryDirectory() as folder:
        traces = [TraceWriter(Path(folder) / str(i), loops[i].settings) for i in (0, 1)]
        for k in range(TICKS):
            turn = rng.randrange(2)
            for i, loop in enumerate(loops):
                if rng.random() < 0.01:
                    loop.enabled = not loop.enabled
                    if not loop.enabled:
                        traces[i].disabled()
                told, kept = worlds[i].next(loop.command), None
                if i == 1:
                    told['reference'] = [loops[0].command, 0.0, 0.0]
                wanted = changed(loop.settings, *when[k]) if i == turn and k in when else None
                if wanted is not None and not when[k][0].startswith(('command', 'reference')):
                    kept = deepcopy(loop)
                    loop.retune(wanted)
                    traces[i].settings(wanted)
                if i == 1:
                    judge_tick(loop, told, kept, f'tick {k}')
                else:
                    u = loop.tick(**told)
                    assert loop.design.command_min <= u <= loop.design.command_max
                    assert numbers(loop), k
                    if kept is not None:
                        assert u == pytest.approx(kept.tick(**told), rel=1e-12, abs=1e-9), k
                traces[i].tick(loop, told.get('reference'))
        for i, trace in enumerate(traces):
            trace.close()
            assert all(now == again for now, again in replay(Path(folder) / str(i)))
