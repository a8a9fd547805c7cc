"""A reference that comes alone: its derivatives are those that its own samples show."""

from __future__ import annotations

from itertools import pairwise
from math import cos, pi, sin
from random import Random
from typing import Any

import attrs
from bench.reference import (
    arm,
    arm_settings,
    H,
    noise,
    NOISY,
    Sender,
    sender,
    SENDERS,
    setpoints,
    SWING,
    WAYS,
)
from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least, Chain, INF, NAN
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.reference import blank_memory, estimated, follow
from nadrc_ros.adrc.settings import ControllerSettings, HIGHEST, LOWEST
from nadrc_ros.simulation.signals import Ramp, Step
import pytest


@pytest.mark.parametrize('n', (1, 2, 3))
@pytest.mark.parametrize('name', SENDERS)
def test_it_is_followed_as_with_true_derivatives(name: str, n: int) -> None:
    signal, how = SENDERS[name]
    true, alone = (
        arm(arm_settings(n, reference_derivatives=source), signal, sender(signal, **how))[0]
        for source in ('topics', 'auto')
    )
    assert alone < 2.0 * true


@pytest.mark.parametrize(
    ('n', 'name', 'starts'),
    (
        (2, 'trapezoid, 12 bit', (0.5375, 0.5338, 0.5527, 0.5888)),
        (3, 'trapezoid at 20 Hz', (0.5292, 0.5312, 0.5336)),
        (3, 'joystick at 20 Hz', (0.5, 0.5458)),
    ),
)
def test_wherever_the_samples_fall_on_it(n: int, name: str, starts: tuple[float, ...]) -> None:
    """Starts of which some took up to 3.5 times the error with true derivatives."""
    signal: Any
    signal, how = SENDERS[name]
    for start in starts:
        moved = attrs.evolve(signal, start_time=start)
        true, alone = (
            arm(arm_settings(n, reference_derivatives=source), moved, sender(moved, **how))
            for source in ('topics', 'auto')
        )
        assert alone[0] < 1.97 * true[0]
        # Rounding is no acceleration: no sample makes the command jump.
        assert max(map(abs, alone[1])) < 4.0 * max(map(abs, true[1]))


def test_motion_out_of_rest_is_seen_at_its_third_change() -> None:
    """Whenever it began between two samples; constant acceleration takes it there."""
    design = make_design(ControllerSettings(plant_order=3, controller_bandwidth=5.0))
    for begins in (0.1, 0.4, 0.7, 0.9):
        memory = blank_memory()
        for k in range(24):
            r = max(k - 20 - begins, 0.0) ** 2
            follow(design, memory, r, True, 0.05, 0.0)
        assert estimated(memory, 2) == pytest.approx(2.0 / 0.05**2, rel=0.6)


def loop(source: str, send: Sender, n: int, ticks: int) -> tuple[list[float], list[float]]:
    """Return outputs and commands of a chain of integrators."""
    settings = ControllerSettings(
        plant_order=n, controller_bandwidth=6.0, reference_derivatives=source, command_min=-1e4
    )
    controller = Controller(attrs.evolve(settings, command_max=1e4), checked=True)
    chain, outputs, commands = Chain(n), [], []
    for k in range(ticks):
        sent = send(k)
        commands.append(controller.tick(chain.y, H, reference=sent and sent[:1]))
        outputs.append(chain.y)
        chain.advance(commands[-1], H)
    return outputs, commands


@pytest.mark.parametrize('n', (1, 2, 3))
@pytest.mark.parametrize('how', ({}, {'every': 10}, {'every': 10, 'held': True}, {'noise': 1e-3}))
def test_a_step_has_no_derivative(n: int, how: dict[str, Any]) -> None:
    step = Step(start_time=0.5)
    runs = {source: loop(source, sender(step, **how), n, 600)[0] for source in ('none', 'auto')}
    assert max(runs['auto']) < max(runs['none']) + 1e-3
    if not how.get('noise'):
        assert runs['auto'] == runs['none']


@pytest.mark.parametrize('n', (1, 2, 3))
@pytest.mark.parametrize('name', NOISY)
def test_noise_of_a_reference_reaches_the_command_as_without_derivatives(
    name: str, n: int
) -> None:
    none, auto = (noise(WAYS[way], n, NOISY[name], 1200) for way in ('none', 'auto'))
    assert auto < 1.1 * none


def test_to_observe_the_error_costs_much_more_noise() -> None:
    none, error = (
        noise(WAYS[way], 2, NOISY['noise of a ramp']) for way in ('none', 'error_based')
    )
    assert error > 10.0 * none


def test_a_clean_reference_has_its_derivatives_after_a_few_samples() -> None:
    """The rate is that of halfway to the next sample, as it stands until then."""
    design, memory = make_design(ControllerSettings()), blank_memory()
    for _ in range(40):
        follow(design, memory, 3.0, True, H, 0.0)
    for k in range(1, 8):
        t = (k - 0.6) * H
        follow(design, memory, 3.0 + t * t, True, H, 0.0)
        assert (estimated(memory, 1) > 0.0) == (k > 3)
    assert estimated(memory, 1) == pytest.approx(2.0 * (t + 0.5 * H), rel=1e-3)
    assert estimated(memory, 2) == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize('n', (2, 3))
def test_a_jump_of_the_rate_is_no_acceleration(n: int) -> None:
    ramp = Ramp(slope=0.5, start_time=0.5)
    commands = {source: loop(source, sender(ramp), n, 300)[1] for source in ('none', 'auto')}
    design = make_design(ControllerSettings(plant_order=n, controller_bandwidth=6.0))
    rate = design.feedback_gains[1] * 0.5  # what the rate adds
    assert max(commands['auto']) < max(commands['none']) + 1.3 * rate


def test_one_that_stops_or_ceases_has_none() -> None:
    """Said by the next sample, or told by the silence of two and a half of them."""
    for came, ticks in ((True, 1), (False, 3)):
        design, memory = make_design(ControllerSettings()), blank_memory()
        for k in range(20):
            follow(design, memory, 0.5 * k * H, True, H, 0.0)
        assert estimated(memory, 1) == pytest.approx(0.5, rel=1e-3)
        for _ in range(ticks + came):
            follow(design, memory, 0.5 * 19 * H, came, H, 0.0)
        assert estimated(memory, 1) == pytest.approx(0.0, abs=1e-3)


def test_a_step_of_one_that_moves_leaves_the_rate() -> None:
    design, memory = make_design(ControllerSettings()), blank_memory()
    for k in range(100):
        follow(design, memory, 0.5 * k * H + (k > 60), True, H, 0.0)
        if k > 10:
            assert estimated(memory, 1) == pytest.approx(0.5, rel=0.03)


def test_setpoints_further_apart_than_the_loop_settles_are_steps() -> None:
    design, memory = make_design(ControllerSettings(controller_bandwidth=10.0)), blank_memory()
    for k in range(2000):
        follow(design, memory, float(k // 50), k % 50 == 0, H, 0.0)
        assert estimated(memory, 1) == estimated(memory, 2) == 0.0


@pytest.mark.parametrize('n', (1, 2, 3))
def test_setpoints_in_a_sequence_make_no_motion(n: int) -> None:
    """The figures of docs/reference.md."""
    auto, none = (setpoints(n, WAYS[way]) for way in ('auto', 'none'))
    slider = 'slider at 20 Hz, 0.4 s: '
    for name, value in none.items():
        if not name.startswith(slider):
            assert auto[name] == pytest.approx(value, rel=0.1, abs=1e-3), name
    assert auto[f'{slider}largest y'] < 1.15


@pytest.mark.parametrize('every', (1, 2, 5, 10, 20))
@pytest.mark.parametrize('steps', (0, 10, 4, 1))
def test_setpoints_that_are_drawn_are_hardly_ever_taken_for_motion(steps: int, every: int) -> None:
    """Any number from 0 to 1, tenths, quarters, on and off; sent on at 100 Hz."""
    design = make_design(ControllerSettings(controller_bandwidth=4.0))
    rng, memory, moved, r = Random(7), blank_memory(), 0, 0.0
    for k in range(300 * every):
        if k % every == 0:
            r = rng.randint(0, steps) / steps if steps else rng.random()
        follow(design, memory, r, True, 0.01, 0.0)
        moved += estimated(memory, 1) != 0.0
    assert moved <= every


def test_derivatives_that_come_are_taken_and_those_that_cease_are_estimated() -> None:
    """Per derivative; from one to the other the command has no bump."""
    settings = ControllerSettings(max_dt=0.1, reference_derivatives='auto')
    controller, chain, commands = Controller(settings), Chain(2), []
    r = [0.0, 0.0, 0.0]
    for k in range(400):
        SWING.derivatives(k * H, r)
        u = controller.tick(chain.y, H, reference=r[: 3 if k < 200 else 2 if k < 300 else 1])
        if k < 200 or k > 230:
            assert controller.reference[2] == (r[2] if k < 200 else pytest.approx(r[2], abs=0.4))
        if k < 300 or k > 330:
            assert controller.reference[1] == (r[1] if k < 300 else pytest.approx(r[1], abs=0.02))
        commands.append(u)
        chain.advance(u, H)
    assert max(abs(b - a) for a, b in pairwise(commands[150:])) < 0.5


@given(
    st.integers(1, 5),
    st.sampled_from((1e-9, 0.1, 4.0, 300.0, 1e6)),
    st.lists(
        st.tuples(
            st.one_of(
                st.none(), st.floats(LOWEST, HIGHEST), st.sampled_from((0.0, 1.0, 1.0 + 1e-9))
            ),
            st.sampled_from((0.0, 1e-9, H, H, H, 0.3, 1e300, INF)),
            st.sampled_from((0.0, 0.0, -H, H, 1e-12, 1e300, INF, NAN)),
        ),
        max_size=40,
    ),
)
@at_least(100)
def test_p02_whatever_comes_the_derivatives_are_numbers(
    n: int, bandwidth: float, samples: list[tuple[float | None, float, float]]
) -> None:
    design = make_design(ControllerSettings(plant_order=n, controller_bandwidth=bandwidth))
    memory = blank_memory()
    for r, elapsed, span in samples:
        follow(design, memory, NAN if r is None else r, r is not None, elapsed, span)
        for i in (1, 2):
            assert LOWEST <= estimated(memory, i) <= HIGHEST
    for _ in range(400):  # and it finds back
        follow(design, memory, 2.0, True, H, 0.0)
    assert estimated(memory, 1) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize('period', (2.0 * pi, 360.0))
def test_an_angle_that_wraps_has_the_derivatives_of_one_that_turns(period: float) -> None:
    wrapped = make_design(ControllerSettings(measurement_period=period))
    memories = blank_memory(), blank_memory()
    for k in range(3000):
        turned = period * (0.3 * sin(0.01 * k) + 0.002 * k)
        follow(wrapped, memories[0], (turned + 0.5 * period) % period - 0.5 * period, True, H, 0.0)
        follow(make_design(ControllerSettings()), memories[1], turned, True, H, 0.0)
        for i in (1, 2):
            found, wanted = (estimated(memory, i) for memory in memories)
            assert found == pytest.approx(wanted, abs=period * 10.0 ** (3 * i - 6))


@pytest.mark.parametrize('rate', (199.0, 250.0, 120.0))
def test_where_it_is_told_when_samples_were_sent_the_ticks_do_not_matter(rate: float) -> None:
    """A publisher of another rate sends two between two ticks, or none."""
    design, memory, sent = make_design(ControllerSettings()), blank_memory(), 0
    for k in range(1000):
        last, sent = sent, int(k * H * rate)
        t = sent / rate
        follow(design, memory, sin(t), sent > last, H, (sent - last) / rate)
        if k > 200:
            assert estimated(memory, 1) == pytest.approx(cos(t), abs=0.01)
            assert estimated(memory, 2) == pytest.approx(-sin(t), abs=0.1)


def test_a_timer_of_the_publisher_that_jitters_is_no_noise() -> None:
    """The values are those of its period, the stamps those of when it got to send them."""
    design, memory, rng = make_design(ControllerSettings()), blank_memory(), Random(3)
    before, off = 0.0, [0.0, 0.0]
    for k in range(1200):
        stamp = k * H + abs(rng.gauss(0.0, 2e-4))
        follow(design, memory, sin(k * H), True, H, stamp - before)
        before = stamp
        if k >= 200:
            off[0] += (estimated(memory, 1) - cos(k * H)) ** 2
            off[1] += (estimated(memory, 2) + sin(k * H)) ** 2
    assert off[0] < 1000 * 0.03**2
    assert off[1] < 1000 * 0.7**2
