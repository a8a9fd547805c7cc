"""Feed-forward: what is known of the load is added, and the observers do the rest."""

from __future__ import annotations

from copy import deepcopy
from math import cos, sin
from pathlib import Path
from typing import Any

import attrs
from law_helpers import bits, Chain, INF, NAMES, NAN, noise, state_bits, varied_settings
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.limiter import clamp, limit
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import raw_command
from nadrc_ros.adrc.status import Mode
from nadrc_ros.scenario.files import load, loads
from nadrc_ros.simulation.signals import Step
from nadrc_ros.simulation.simulate import simulate
import numpy as np
import pytest

H = 0.01
CASES = varied_settings()
EXAMPLES = Path(__file__).parents[1] / 'examples' / 'loops'
SIZE = 5.0
CHANGES: tuple[dict[str, Any], ...] = (
    {'b0': 3.0},
    {'structure': 'conventional'},
    {'structure': 'generalized'},
    {'controller_bandwidth': 9.0},
    {'error_based': True},
    {'inner_bandwidth': 77.0, 'levels': 1},
)


def push(k: int) -> float:
    """Return a load that is far too fast for the observers."""
    return SIZE * cos(12.0 * k * H)


def worst(share: float, structure: str = 'nested') -> float:
    """Return the largest error in the last second, with this share of the load fed forward."""
    settings = ControllerSettings(
        structure=structure, inner_bandwidth=10.0, outer_bandwidth=10.0, b0=2.0
    )
    controller, chain, errors = Controller(settings, checked=True), Chain(2), [0.0]
    for k in range(600):
        u = controller.tick(chain.y, H, reference=[0.0], feed_forward=-share * push(k) / 2.0)
        chain.advance(2.0 * u + push(k), H)
        errors.append(abs(chain.y))
    return max(errors[-100:])


@pytest.mark.parametrize('structure', NAMES)
def test_a_known_load_that_is_fed_forward_leaves_no_error(structure: str) -> None:
    without = worst(0.0, structure)
    assert without > 0.02
    assert worst(1.0, structure) < 1e-5 * without
    tolerance = 0.2 if structure == 'nonlinear' else 1e-3
    for wrong in (0.8, 1.3):  # what is left is to the load as the part that is not known
        assert worst(wrong, structure) == pytest.approx(abs(1.0 - wrong) * without, rel=tolerance)


@pytest.mark.parametrize('case', CASES)
def test_no_feed_forward_and_one_of_zero_are_the_same_to_the_bit(case: str) -> None:
    settings = ControllerSettings(**CASES[case])
    runs = []
    for fed in (None, 0.0):
        controller, y = Controller(settings, checked=True), noise(1, 200, 0.1)
        u = [controller.tick(value, H, reference=[0.3], feed_forward=fed) for value in y]
        runs.append((bits(u), state_bits(controller.state)))
    assert runs[0] == runs[1]


@pytest.mark.parametrize('case', CASES)
def test_the_estimate_of_the_total_disturbance_is_whole(case: str) -> None:
    """Level 1 has what is left of it, and the sum with what is fed forward is the truth."""
    settings = ControllerSettings(**CASES[case] | {'plant_poles': (0.0,)})  # a chain is the plant
    if settings.command_max - settings.command_min < 10.0 or settings.command_rate_limit > 0.0:
        settings = attrs.evolve(
            settings, command_min=-50.0, command_max=50.0, command_rate_limit=0.0
        )
    b0, controller = settings.b0, Controller(settings, checked=True)
    chain = Chain(settings.plant_order)
    for _ in range(1500):
        u = controller.tick(chain.y, H, reference=[0.0], feed_forward=1.0 / b0)
        chain.advance(b0 * u - 1.2, H)
    share = controller.state.gain[0] / b0  # a table takes another b0 for the right one
    assert controller.total_disturbance == pytest.approx(-1.2 * share, abs=1e-4)
    assert sum(controller.disturbances) == pytest.approx(-0.2 * share, abs=1e-4)


@pytest.mark.parametrize('case', CASES)
def test_p11_enabling_under_feed_forward_is_bumpless(case: str) -> None:
    """At the first start, after it was off, and where the load changed at that moment."""
    settings = ControllerSettings(**CASES[case])
    for checked in (True, False):
        controller = Controller(settings, checked=checked, enabled=checked)
        safe = settings.safe_command
        first = controller.tick(0.2, H, reference=[0.5], feed_forward=4.0)
        assert first == pytest.approx(safe, abs=1e-9)
        for _ in range(50):
            held = controller.tick(0.2, H, feed_forward=4.0)
        controller.enabled = False
        for _ in range(200):
            held = controller.tick(0.2, H, feed_forward=4.0)
        assert held == pytest.approx(safe, abs=1e-9) and controller.quiet
        controller.enabled = True
        assert controller.tick(0.2, H, feed_forward=-7.0) == pytest.approx(held, abs=1e-9)
        assert controller.mode == Mode.OK


@pytest.mark.parametrize('case', CASES)
def test_p12_a_change_under_feed_forward_is_bumpless(case: str) -> None:
    settings = ControllerSettings(**CASES[case])
    controller, chain = Controller(settings, checked=True), Chain(settings.plant_order)
    for k in range(119):
        u = controller.tick(chain.y, H, reference=[0.1], feed_forward=2.0 * sin(0.05 * k))
        chain.advance(settings.b0 * u - 1.0, H)
    commands = []
    for change in ({}, *CHANGES):
        wanted = {**change, 'b0': change.get('b0', 1.0) * settings.b0}
        changed = deepcopy(controller)
        changed.retune(attrs.evolve(settings, **wanted))
        u = changed.tick(chain.y, H, reference=[0.1], feed_forward=2.0 * sin(0.05 * 119))
        raw = raw_command(changed.design, changed.state)
        assert limit(changed.design, raw, changed.sample.sent, H)[0] == pytest.approx(u, abs=1e-9)
        commands.append(u)
    assert commands[1:] == pytest.approx([commands[0]] * len(CHANGES), abs=1e-9)


@pytest.mark.parametrize('structure', NAMES)
def test_under_a_constant_one_nothing_moves_after_a_change_or_a_fault(structure: str) -> None:
    """What the observers have is re-solved without it, and so is what the law usually asks for."""
    settings = ControllerSettings(structure=structure, measurement_timeout=0.05, hold_time=10.0)
    controller, chain = Controller(settings, checked=True), Chain(2)
    for k in range(900):
        if k == 500:
            controller.retune(attrs.evolve(settings, b0=1.5))
        y = NAN if 700 < k < 720 else chain.y
        u = controller.tick(y, H, reference=[0.0], feed_forward=5.0)
        if k >= 400:
            assert u == pytest.approx(5.5, abs=1e-3)
        if k == 719:
            assert controller.mode == Mode.HOLDING
        chain.advance(u - 5.5, H)


@pytest.mark.parametrize('lost', (None, NAN, INF, -1e16))
@pytest.mark.parametrize('rate', (20.0, 0.0))
def test_silence_or_what_is_no_number_ramps_it_out(lost: float | None, rate: float) -> None:
    settings = ControllerSettings(
        feed_forward_timeout=0.05, command_rate_limit=rate, inner_bandwidth=1.0, levels=1
    )
    controller = Controller(settings, checked=True)
    for k in range(100):
        u = controller.tick(0.0, H, reference=[0.0], feed_forward=min(0.1 * k, 6.0))
    fed = []
    for _ in range(60):
        before, u = u, controller.tick(0.0, H, feed_forward=lost)
        fed.append(controller.sample.feed_forward)
        assert not rate or abs(u - before) <= rate * H * (1.0 + 1e-9)
    assert fed[:5] == [6.0] * 5
    if rate:
        assert fed[5:35] == pytest.approx([6.0 - 0.2 * (i + 1) for i in range(30)], abs=1e-9)
    assert fed[35:] == [0.0] * 25 and (rate or fed[5] == 0.0)
    controller.tick(0.0, H, feed_forward=3.0)
    assert controller.sample.feed_forward == 3.0


def test_a_tick_without_a_sample_follows_it() -> None:
    """Also where nothing else moves the command between two samples of a slow sensor."""
    for rate in (0.0, 50.0):
        settings = ControllerSettings(command_rate_limit=rate)
        controller, chain = Controller(settings, checked=True), Chain(2)
        for k in range(400):
            sampled = k % 4 == 0
            fed = sin(5.0 * k * H)
            before = controller.state.offset[2], controller.command
            u = controller.tick(
                chain.y if sampled else NAN,
                4.0 * H if sampled else 0.0,
                elapsed=H,
                reference=[0.0],
                feed_forward=fed,
            )
            if not sampled:
                assert u - before[1] == pytest.approx(fed - before[0], abs=1e-9)
            chain.advance(u - fed, H)
            assert abs(chain.y) < 1e-6  # the gap is one step under the mean of what is not fed
    held = controller.tick(NAN, 0.0, elapsed=H, feed_forward=fed)
    assert held == controller.tick(NAN, 0.0, elapsed=H, feed_forward=fed)


def test_there_is_none_in_safe_mode_and_a_hold_does_not_follow_it() -> None:
    settings = ControllerSettings(
        measurement_timeout=0.05, hold_time=0.1, command_rate_limit=40.0, safe_command=0.5
    )
    controller, chain = Controller(settings, checked=True), Chain(2)
    for _ in range(200):
        u = controller.tick(chain.y, H, reference=[0.0], feed_forward=3.0)
        chain.advance(u - 3.0, H)
    modes = []
    for k in range(100):
        before, u = u, controller.tick(NAN, 0.0, elapsed=H, feed_forward=3.0 + sin(k))
        modes.append(controller.mode)
        if controller.mode == Mode.HOLDING and modes[-2] == Mode.HOLDING:
            assert u == before
    assert set(modes) == set(Mode) and u == 0.5


def test_p06_what_the_limits_take_of_it_winds_nothing_up() -> None:
    """Asked to push three times as hard as it can, the loop comes back as one at rest."""
    settings = ControllerSettings(command_min=-5.0, command_max=5.0)
    ends = []
    for fed in (0.0, 15.0):
        controller, chain, highest = Controller(settings, checked=True), Chain(2), 0.0
        for k in range(1200):
            pushed = fed if k < 500 else 0.0
            u = controller.tick(chain.y, H, reference=[1.0], feed_forward=pushed)
            assert u == clamp(controller.design, u)
            chain.advance(u, H)
            if k < 500 and chain.y > 0.0:
                chain.x = [0.0, 0.0]  # a stop holds it meanwhile
            highest = max(highest, chain.y)
        ends.append((highest, chain.y))
    assert ends[1][1] == pytest.approx(1.0, abs=1e-6)
    assert ends[1][0] < ends[0][0] + 0.02


def test_a_scenario_feeds_those_who_listen_compiled_and_plain_alike() -> None:
    """A load that is known to 20 % leaves 20 % of the error."""
    scenario = load(EXAMPLES / 'feed_forward.yaml')
    # The load compiled is one that is compiled for other tests too.
    step = attrs.evolve(scenario.experiment, disturbance=Step(amplitude=10.0, start_time=1.0))
    errors = {}
    for name, settings in scenario.controllers.items():
        runs = [simulate(step, settings, compiled=c) for c in (True, False)]
        assert np.array_equal(runs[0].command, runs[1].command)
        assert np.array_equal(runs[0].disturbance_estimate, runs[1].disturbance_estimate)
        run = scenario.run(name)
        errors[name] = np.abs(run.output[-400:]).max()
        unexplained = np.abs(run.disturbance_estimate - run.total_disturbance)[-400:]
        errors[name + ' estimate'] = unexplained.max()
    assert errors['with_feed_forward'] < 0.25 * errors['without']
    assert errors['with_feed_forward estimate'] < 0.25 * errors['without estimate']


def test_a_signal_that_ceases_is_ramped_out_compiled_and_plain_alike(tmp_path: Path) -> None:
    """In the periods in which it is no number, plain Python goes on, and gives the same."""
    (tmp_path / 'load.csv').write_text('t,f\n0,1\n0.5,1\n0.51,nan\n1.5,nan\n1.51,2\n3,2\n')
    text = """
    plant: {name: chain, order: 1}
    reference: {signal: step, amplitude: 0.0}
    disturbance: {signal: step, amplitude: 0.0}
    feed_forward: {csv: load.csv, column: f}
    rate: 100
    duration: 2
    limits: {command_rate_limit: 5.0}
    controllers: {own: {feed_forward_timeout: 0.1}}
    """
    scenario = loads(text, tmp_path)
    settings = scenario.controllers['own']
    runs = [simulate(scenario.experiment, settings, compiled=c) for c in (True, False)]
    assert np.array_equal(runs[0].command, runs[1].command)
    assert np.abs(np.diff(runs[0].command)).max() <= 5.0 * H * (1.0 + 1e-9)
