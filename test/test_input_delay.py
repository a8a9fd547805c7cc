"""Dead time: the observers are driven by the command that acts, whatever ticks and samples do."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate, pairwise
from math import nan
import random
from typing import Any

import attrs
from hypothesis import given, settings
from hypothesis import strategies as st
from law_helpers import Chain, design_of, noise
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.delay_line import acting, blank_line, pass_through
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.adrc.status import Status
from nadrc_ros.adrc.transfer import retune
from nadrc_ros.scenario import loads, SignalSpec
from nadrc_ros.simulation.kernel import kernel_for
from nadrc_ros.simulation.simulate import simulate
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.system import zero_order_hold
import numpy as np
import pytest

WIDE: dict[str, Any] = {'command_min': -1e9, 'command_max': 1e9, 'structure': 'conventional'}
BEFORE = 3.0  # the command before the first piece

lengths = st.floats(1e-4, 0.3)
pieces = st.lists(st.tuples(st.floats(-9.0, 9.0), lengths), min_size=1, max_size=40)


class Sent:
    """Commands with the times from which they were sent, and exact integrals over them."""

    def __init__(self, pieces: Sequence[tuple[float, float]], before: float) -> None:
        self.commands = [before, *(u for u, _ in pieces)]
        self.times = [0.0, *accumulate(length for _, length in pieces)]

    def parts(self, begin: float, end: float) -> list[tuple[float, float]]:
        """Return the commands from ``begin`` to ``end`` with how long each was sent [s]."""
        cuts = [begin, *(t for t in self.times if begin < t < end), end]
        return [
            (self.commands[bisect_right(self.times, 0.5 * (a + b))], b - a)
            for a, b in pairwise(cuts)
        ]

    def mean(self, begin: float, end: float) -> float:
        return sum(u * length for u, length in self.parts(begin, end)) / (end - begin)


@settings(max_examples=200)
@given(pieces=pieces, delay=st.floats(1e-3, 4e-3) | st.floats(4e-3, 3.0), copies=st.booleans())
def test_what_leaves_is_what_entered_a_delay_before(
    pieces: list[tuple[float, float]], delay: float, copies: bool
) -> None:
    """Exactly; where a piece is shorter than a hundredth of the delay, to its share of it."""
    sent, line = Sent(pieces, BEFORE), blank_line(delay)
    pass_through(delay, line, BEFORE, delay, line)
    for (u, length), end in zip(pieces, sent.times[1:]):
        out = blank_line(delay) if copies else line
        mean = pass_through(delay, line, u, length, out)
        line = out
        shortest = min(length for _, length in pieces)
        blur = 0.0 if shortest >= delay / 100 else 18.0 * (delay / 50) / length
        assert mean == pytest.approx(sent.mean(end - length - delay, end - delay), abs=1e-9 + blur)
        count = int(line[0])
        assert sum(line[2 : 2 + 2 * count : 2]) == pytest.approx(delay, rel=1e-12)
        assert acting(line, nan) in sent.commands or shortest < delay / 100


def test_a_delay_in_milliseconds_is_refused_with_the_unit() -> None:
    """As long as a line is, and no longer: beyond, a slower loop is as good."""
    ControllerSettings(input_delay=1.0).check_rate(100.0)
    with pytest.raises(SettingError, match=r'at most 1 s, 100 periods at 100 Hz; it is in second'):
        ControllerSettings(input_delay=20.0).check_rate(100.0)


def test_a_line_keeps_a_constant_to_the_bit_and_never_overflows() -> None:
    """Neither at 100 kHz nor for lengths that are no time."""
    line, rng = blank_line(0.5), random.Random(1)
    size = len(line)
    for length in (
        nan,
        -1.0,
        0.0,
        float('inf'),
        *(10.0 ** rng.uniform(-9, 0) for _ in range(999)),
    ):
        assert pass_through(0.5, line, 0.1, length, line) == 0.1
    integral, begin = 0.0, 0.1
    for k in range(100_000):  # a ramp
        u = begin + k * 1e-5
        integral += 1e-5 * pass_through(0.5, line, u, 1e-5, line)
    assert len(line) == size and line[0] <= 102
    assert integral == pytest.approx(0.5 * 0.1 + 0.5 * (0.1 + 0.25), abs=1e-3 * 0.5)
    assert blank_state(design_of()).delay_line == []


def stream(seed: int, ticks: int) -> list[tuple[float, bool]]:
    """Return how long each tick is and whether a sample comes with it; jitter, losses, gaps."""
    rng = random.Random(seed)
    found = []
    for k in range(ticks):
        long = 8.0 if k % 37 == 20 else 1.0
        found.append((0.01 * long * (1.0 + 0.3 * rng.uniform(-1.0, 1.0)), rng.random() > 0.2))
    return found


def run_open(
    order: int, delay: float, input_delay: float, seed: int = 1, fed: float = 0.0
) -> tuple[list[float], list[float]]:
    """
    Let an observer watch a plant behind ``delay`` [s] that is sent noise.

    Return all |y - estimate|, and all |L - total disturbance|. The load L is 0, or just what a
    ``fed`` share of the noise cancels when it acts.
    """
    settings = ControllerSettings(
        plant_order=order,
        b0=2.0,
        inner_bandwidth=20.0,
        input_delay=input_delay,
        feed_forward_timeout=1.0,
        **WIDE,
    )
    controller = Controller(settings, enabled=False)
    ticks = stream(seed, 400)
    commands = [*[0.0] * 5, *noise(seed, len(ticks))]  # at rest until it is believed
    sent, plant = Sent([(u, length) for u, (length, _) in zip(commands, ticks)], 0.0), Chain(order)
    load = 0.0
    now = since = 0.0
    errors, disturbances = [], []
    for k, (length, sampled) in enumerate(ticks):
        for u, part in sent.parts(now - delay, now + length - delay):
            load = -2.0 * fed * u
            plant.advance(2.0 * u + load, part)
        now += length
        since += length
        lost = k > 4 and not sampled
        bad = k % 50 == 30  # one that is refused
        y = 1e20 if bad else plant.y
        told: dict[str, Any] = {'elapsed': length, 'applied': commands[k]}
        if fed:  # for the next command, and with a live change on the way
            told['feed_forward'] = fed * commands[k + 1]
            if k == len(ticks) // 2:
                controller.retune(attrs.evolve(settings, hold_time=1.0))
        if lost:
            controller.tick(**told)
        else:
            controller.tick(y, since, **told)
            since = 0.0
        if not lost and not bad:
            errors.append(abs(controller.output_estimate - plant.y))
            disturbances.append(abs(load - controller.total_disturbance))
    assert controller.counts[Status.RESTARTED] == 0
    return errors, disturbances


@pytest.mark.parametrize('delay', (0.01, 0.0237, 0.05, 0.4, 0.69))
def test_p06_the_estimates_of_a_late_integrator_are_those_of_one_that_is_not(delay: float) -> None:
    """Fractional delay, measured jittered steps, ticks without and with refused samples, gaps."""
    errors, disturbances = run_open(1, delay, delay)
    assert max(errors) < 1e-9 and max(disturbances) < 1e-9
    assert max(run_open(1, delay, 0.0)[1]) > 0.3  # not so without


@pytest.mark.parametrize('delay', (0.01, 0.0237, 0.05, 0.4))
def test_p06_what_is_fed_forward_counts_from_when_it_acts(delay: float) -> None:
    errors, disturbances = run_open(1, delay, delay, fed=0.7)
    assert max(errors) < 1e-9 and max(disturbances) < 1e-9


@pytest.mark.parametrize('order', (2, 3))
def test_p06_of_higher_order_what_is_left_is_of_commands_that_change_within_a_step(
    order: int,
) -> None:
    errors, disturbances = run_open(order, 0.0237, 0.0237)
    without = run_open(order, 0.0237, 0.0)
    # The mean keeps y^(n-1); y is off by less than 2 b0 |u| dt^n / 8 for n = 2.
    assert max(errors) < 2.0 * 2.0 * 4.0 * 0.12**order / 8.0
    assert sum(disturbances) < 0.5 * sum(without[1])


def test_a_restart_keeps_what_is_on_its_way_and_the_command() -> None:
    controller = Controller(
        ControllerSettings(plant_order=1, input_delay=0.05, max_dt=0.1, **WIDE), checked=True
    )
    for k in range(20):
        controller.tick(0.01 * k, 0.01, reference=[1.0])
    before = controller.command
    sent = list(controller.state.delay_line)
    controller.reset()
    u = controller.tick(0.3, 0.01, reference=[1.0])
    assert controller.status == Status.RESTARTED and u == pytest.approx(before, abs=1e-9)
    assert controller.state.delay_line[:11] == pytest.approx(sent[:11], rel=1e-12)
    assert controller.disturbances == [-acting(sent, nan)]
    controller.tick(0.3, 5.0, reference=[1.0])  # longer than the delay: all of it is that command
    assert controller.state.delay_line[:3] == [1.0, u, pytest.approx(0.05)]


def loop(input_delay: float, delay: int, changed: Sequence[tuple[int, float]] = ()) -> list[float]:
    """Return the output of a loop of order 2 with a load, ``delay`` periods late, at 100 Hz."""
    controller = Controller(
        ControllerSettings(
            plant_order=2,
            inner_bandwidth=60.0,
            controller_bandwidth=5.0,
            input_delay=input_delay,
            **WIDE,
        ),
        checked=True,
    )
    plant, late, found = Chain(2), [0.0] * delay, []
    changes = dict(changed)
    for k in range(1000):
        if k in changes:
            controller.retune(
                ControllerSettings(
                    plant_order=2,
                    inner_bandwidth=60.0,
                    controller_bandwidth=5.0,
                    input_delay=changes[k],
                    **WIDE,
                )
            )
        late.append(controller.tick(plant.y, 0.01, reference=[1.0]))
        plant.advance(late.pop(0) + (5.0 if k > 500 else 0.0), 0.01)
        found.append(plant.y)
    return found


def test_p12_a_loop_that_is_told_its_delay_on_the_way_is_as_good_as_one_that_knew_it() -> None:
    knew = loop(0.05, 5)
    assert abs(knew[499] - 1.0) < 1e-3 and abs(knew[-1] - 1.0) < 0.02
    told = loop(0.03, 5, [(50, 0.0), (60, 0.05)])
    assert told[520:] == pytest.approx(knew[520:], abs=1e-3)
    assert max(map(abs, loop(0.0, 5))) > 1e3  # unstable without


@pytest.mark.parametrize(
    ('dt', 'before', 'delay'),
    ((1e-3, 0.1, 0.3), (1e-3, 0.09, 0.1), (1e-2, 1.0, 1.5), (1e-2, 0.05, 5.0), (1e-3, 1.0, 0.1)),
)
def test_a_delay_that_changes_live_keeps_each_command_to_a_hundredth_of_it(
    dt: float, before: float, delay: float
) -> None:
    """Of those on their way and of those that are sent then: a sine that never stops."""
    old = design_of(plant_order=1, input_delay=before, **WIDE)
    new = attrs.evolve(old, input_delay=delay)
    state, omega, share = blank_state(old), 2.0 / delay, max(before, delay) / 100 + dt
    start, end = round(2.0 * before / dt), round((2.0 * before + 3.0 * delay) / dt)
    for k in range(end):
        if k == start:
            state = retune(old, new, state, [0.0], 0.0, dt, 0.0, nan)
        told = old.input_delay if k < start else delay
        line = state.delay_line
        left = pass_through(told, line, np.sin(omega * k * dt), dt, line)
        assert max(line[4 : 2 * int(line[0]) + 1 : 2], default=0.0) <= 2.0 * share
        sent = k - round(delay / dt)
        if k >= start and sent >= start - round(min(before, delay) / dt):
            assert left == pytest.approx(np.sin(omega * sent * dt), abs=omega * 2.0 * share)
        if k >= start + round(delay / dt):
            assert sum(line[2 : 2 * int(line[0]) + 1 : 2]) == pytest.approx(delay, rel=1e-9)


LATE = """
plant: {{name: chain, order: 2, gain: 2, input_delay: {delay}}}
reference: {{signal: cosine, frequency: 2}}
disturbance: {{signal: sine, frequency: 3}}
rate: 100
duration: 3
controllers:
  it: {{inner_bandwidth: 20, outer_bandwidth: 20, input_delay: {known}, safe_command: 0.7}}
"""
FAILING = """
noise: {variance: 1e-6}
faults: {command: [{kind: gain, size: 0.5, start: 0.7, duration: 0.6}]}
"""


@pytest.mark.parametrize('delay', (0.004, 0.05, 0.0637))
def test_a_simulated_plant_with_dead_time_is_exact_and_its_disturbance_what_disturbs(
    delay: float,
) -> None:
    scenario = loads(LATE.format(delay=delay, known=delay))
    found = scenario.run('it')
    sampled = zero_order_hold(chain(2, 2.0), 0.01, delay)
    free = attrs.evolve(scenario, disturbance=SignalSpec()).run('it')
    x = np.zeros(len(sampled.a))
    x[2:] = 0.7  # what acts before the first command
    for k in range(300):
        assert free.output[k] == pytest.approx(float(sampled.c[0] @ x), abs=1e-12)
        x = sampled.a @ x + sampled.b[:, 0] * free.command[k]
    assert found.total_disturbance == pytest.approx(np.sin(3.0 * found.time), abs=1e-9)
    knows = np.abs(found.disturbance_estimate - found.total_disturbance)[100:].mean()
    without = loads(LATE.format(delay=delay, known=0.0)).run('it')
    does_not = np.abs(without.disturbance_estimate - without.total_disturbance)[100:].mean()
    assert knows < does_not


@pytest.mark.parametrize('delay', (0.004, 0.05, 0.0637))
def test_p18_a_plant_with_dead_time_gives_the_same_bits_compiled(delay: float) -> None:
    """Also where an actuator failed, of which the commands on their way still tell."""
    text = LATE.format(delay=delay, known=delay) + FAILING
    text = text.replace('signal: sine', 'signal: decaying_cosine')  # compiled for other tests too
    experiment = loads(text).experiment
    assert kernel_for(experiment) is not None
    settings = attrs.evolve(loads(text).controllers['it'], b0=1.7)
    plain, fast = (simulate(experiment, settings, compiled=way) for way in (False, True))
    for field in attrs.fields(type(plain)):
        one, other = getattr(plain, field.name), getattr(fast, field.name)
        assert np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other
