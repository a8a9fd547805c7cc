"""A b0 that varies: looked up, rate limited, never through 0, and without a bump."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from math import nextafter
from statistics import mean, stdev
from typing import Any

import attrs
from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least, Chain, INF, NAMES, noise
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.gain import gain_at
from nadrc_ros.adrc.settings import ControllerSettings, GAIN_SOURCES
from nadrc_ros.adrc.status import Status
from nadrc_ros.records.recorded_run import scheduled
from nadrc_ros.scenario.mapping import from_mapping
import numpy as np
import pytest

H = 0.01
WC = 3.0
# b(y) = 1 + 0.3 y
RIGHT = [0.0, 1.0, 10.0, 4.0]


def test_the_table_is_linear_between_its_points_and_constant_beyond() -> None:
    table = [0.0, 2.0, 1.0, 4.0, 3.0, 1.0]
    given = (-1e15, 0.0, 0.25, 1.0, 2.0, 2.5, 3.0, 1e15)
    assert [gain_at(table, x) for x in given] == [2.0, 2.0, 2.5, 4.0, 2.5, 1.75, 1.0, 1.0]


def test_rounding_leads_no_further_than_its_ends() -> None:
    assert gain_at([0.0, 1e15, 1.0, 1e-15], nextafter(1.0, 0.0)) >= 1e-15
    assert gain_at([0.0, 0.1, 3.0, 0.1], 1.0) == 0.1


def tables() -> st.SearchStrategy[list[float]]:
    sizes = st.floats(-15.0, 15.0).map(lambda x: float(10.0**x))
    x = st.one_of(st.floats(-1e15, 1e15), st.floats(-2.0, 2.0))
    pairs = st.lists(st.tuples(x, sizes), min_size=2, max_size=6, unique_by=lambda pair: pair[0])
    return pairs.map(lambda them: [v for pair in sorted(them) for v in pair])


@at_least(100)
@given(
    tables(),
    st.sampled_from((1.0, -1.0)),
    st.sampled_from(GAIN_SOURCES),
    st.lists(
        st.tuples(
            st.one_of(st.floats(-2.0, 2.0), st.floats()),
            st.one_of(st.floats(-2.0, 2.0), st.floats()),
            st.one_of(st.floats(-2.0, 2.0), st.floats()),
        ),
        max_size=20,
    ),
)
def test_b0_never_passes_through_0_nor_leaves_its_table_nor_jumps(
    table: list[float], sign: float, source: str, told: list[tuple[float, float, float]]
) -> None:
    table = [sign * v if i % 2 else v for i, v in enumerate(table)]
    controller = Controller(
        ControllerSettings(b0=sign, b0_table=tuple(table), b0_source=source), checked=True
    )
    gains = sorted(table[1::2])
    before, since = 0.0, 0.0
    for y, r, x in told:
        since += H
        u = controller.tick(y, H, reference=[r], gain_variable=x)
        assert -100.0 <= u <= 100.0
        b0, known = controller.b0, controller.state.gain[2] > 0.0
        assert b0 * sign > 0.0
        if known:
            assert gains[0] <= b0 <= gains[-1]
            if before and controller.status != Status.RESTARTED:
                most = (1.0 + 1e-12) * (1.0 + controller.design.controller_bandwidth * since)
                assert max(b0 / before, before / b0) <= most
            # Until the sensor has proved itself each sample starts anew.
            before = b0 if controller.policy.measurement_age < INF else 0.0
        else:
            assert b0 == sign
        if controller.status < Status.NO_MEASUREMENT:
            since = 0.0


@pytest.mark.parametrize('source', GAIN_SOURCES)
@pytest.mark.parametrize('name', NAMES)
def test_a_constant_table_gives_the_commands_of_a_constant_b0(name: str, source: str) -> None:
    """Through a start, a gap, an enable and a live change of both."""
    common: dict[str, Any] = {'structure': name, 'max_dt': 0.1, 'b0_source': source, 'b0': 2.0}
    constant = ControllerSettings(**common)
    table = attrs.evolve(constant, b0_table=(-1.0, 2.0, 1.0, 2.0))
    runs = [
        Controller(constant, checked=True),
        Controller(table, checked=True),
    ]
    changed = attrs.evolve(constant, b0=3.0)
    changes = [changed, attrs.evolve(table, b0_table=(0.0, 3.0, 1e-3, 3.0, 5.0, 3.0))]
    chain = Chain(2)
    for k, error in enumerate(noise(1, 300, 0.01)):
        if k == 100:
            for controller, change in zip(runs, changes):
                controller.retune(change)
        for controller in runs:
            controller.enabled = not 150 < k < 200
        dt = 0.2 if k == 250 else H
        y, r = chain.y + error, [1.0 + 0.1 * k * H, 0.1]
        told = [c.tick(y, dt, reference=r, gain_variable=0.3) for c in runs]
        assert told[1] == pytest.approx(told[0], rel=1e-12, abs=1e-12)
        chain.advance(2.0 * told[0] + 0.7, dt)
    assert runs[1].b0 == 3.0


def follow(
    settings: ControllerSettings, gain: Callable[[float], float], reference: Sequence[float]
) -> list[float]:
    """Return r - y of the loop around y'' = b(y) u, held over a tenth of a period."""
    controller, chain = Controller(settings, checked=True), Chain(2)
    chain.x[0] = reference[0]
    errors = []
    for r in reference:
        errors.append(r - chain.y)
        u = controller.tick(chain.y, H, reference=[r])
        for _ in range(10):
            chain.advance(gain(chain.y) * u, H / 10)
    return errors


def about(level: float) -> list[float]:
    """Return a reference that steps by 0.1 from there, once it is settled."""
    return [level] * 50 + [level + 0.1] * 350


def varying(y: float) -> float:
    return gain_at(RIGHT, y)


def test_over_a_plant_whose_gain_varies_the_loop_is_everywhere_that_of_a_constant_gain() -> None:
    """To 0.5 % of the step; with the constant b0 of one end it is another one at the other."""
    base = ControllerSettings(
        structure='conventional', inner_bandwidth=15.0, controller_bandwidth=WC
    )
    table = attrs.evolve(base, b0_table=tuple(RIGHT))
    wanted = follow(base, lambda _: 1.0, about(0.0))
    off, worst = {}, 0.0
    for level in (0.0, 3.0, 6.0, 9.0):
        errors = follow(table, varying, about(level))
        worst = max(worst, *(abs(a - b) for a, b in zip(errors, wanted)))
        errors = follow(attrs.evolve(base, b0=4.0), varying, about(level))
        off[level] = max(abs(a - b) for a, b in zip(errors, wanted))
    assert worst < 5e-4
    assert off[0.0] > 5e-3 > off[9.0]


def test_what_b0_is_over_may_move_and_be_noisy_without_moving_the_command() -> None:
    """With a quarter of noise in b0 the command under a load has 5 % more of it at most."""
    settings = ControllerSettings(b0=2.0, b0_table=(0.0, 1.0, 4.0, 5.0), b0_source='topic')
    still = []
    for deviation in (0.0, 1.0):
        controller, chain, told = Controller(settings, checked=True), Chain(2), noise(3, 1500)
        commands = []
        for k, error in enumerate(noise(4, 1500, 1e-4)):
            x = 1.0 + deviation * told[k]
            u = controller.tick(chain.y + error, H, reference=[0.0], gain_variable=x)
            chain.advance(2.0 * u + 20.0, H)
            commands.append(u)
        still.append(stdev(commands[500:]))
        assert mean(commands[500:]) == pytest.approx(-10.0, abs=0.01)
    assert still[0] < still[1] < 1.05 * still[0]


def test_p12_a_live_change_of_the_table_is_no_bump() -> None:
    """From constant to a table, to another, and back: the same command in the tick of it."""
    base = ControllerSettings(b0=2.0)
    tables = ((0.0, 0.5, 2.0, 4.0), (0.0, 9.0, 2.0, 1.0), (0.0,))
    controller, chain = Controller(base, checked=True), Chain(2)
    for k, error in enumerate(noise(2, 400, 0.003)):
        y = chain.y + error
        kept = deepcopy(controller)
        if k % 100 == 99 and k < 300:
            controller.retune(attrs.evolve(base, b0_table=tables[k // 100]))
        old, new = (c.tick(y, H, reference=[1.0]) for c in (kept, controller))
        assert new == pytest.approx(old, abs=1e-9)
        chain.advance(2.0 * new + 0.7, H)
    assert controller.b0 == 2.0 and abs(chain.y - 1.0) < 0.02


def test_a_scenario_refuses_a_topic_that_it_has_not() -> None:
    values = {
        'plant': 'chain',
        'reference': 'step',
        'rate': 100,
        'duration': 1.0,
        'controllers': {'one': {'b0_table': RIGHT, 'b0_source': 'topic'}},
    }
    with pytest.raises(SettingError, match='b0_source'):
        from_mapping(values, '.')


def test_the_truth_of_a_record_is_for_the_b0_that_was_looked_up() -> None:
    settings = ControllerSettings(b0=2.0, b0_table=tuple(RIGHT))
    time = np.array([0.0, 1.0, 2.0, 3.0])
    columns = {'time': time, 'output_estimate': np.array([0.0, 5.0, 20.0, 5.0])}
    command, truth = np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(4)
    steps = [(0.0, settings), (2.5, attrs.evolve(settings, b0_table=(0.0,)))]
    found = scheduled(columns, command, truth, steps)
    assert found.tolist() == [1.0, -1.0, -6.0, 0.0]
    unknown = attrs.evolve(settings, b0_source='topic')
    assert np.isnan(scheduled(columns, command, truth, [(0.0, unknown)])).all()


def test_a_table_of_another_sign_waits_until_the_loop_is_open() -> None:
    settings = ControllerSettings(b0=2.0, b0_table=(0.0, 1.0, 4.0, 5.0))
    reversed_table = attrs.evolve(settings, b0=-2.0, b0_table=(0.0, -1.0, 4.0, -5.0))
    controller, chain = Controller(settings, checked=True), Chain(2)
    for k in range(600):
        if k == 200:
            with pytest.raises(SettingError, match='b0'):
                controller.retune(reversed_table)
            controller.enabled = False
        if k == 210:
            controller.retune(reversed_table)
        if k == 220:
            applied, controller.enabled = controller.command, True
        u = controller.tick(chain.y, H, reference=[1.0])
        assert controller.b0 * (1.0 if k < 210 else -1.0) >= 1.0
        if k == 220:
            assert u == pytest.approx(applied, abs=1e-9)
        # The actuator is turned round with it.
        chain.advance((2.0 if k < 210 else -2.0) * u, H)
    assert abs(chain.y - 1.0) < 1e-3
