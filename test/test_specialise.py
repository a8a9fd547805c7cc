"""The law as straight-line code for one shape: the bits of the law as it is written."""

from __future__ import annotations

import random
from typing import Any

import attrs
from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least, bits, NAMES, NAN, state_bits, varied_settings
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.design import make_design, Vector
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.specialise.evaluator import Evaluator
from nadrc_ros.adrc.specialise.program import shape_of
from nadrc_ros.adrc.specialise.python import defined, SCOPE, source_of, text
from nadrc_ros.adrc.specialise.tidy import joined, tidied
from nadrc_ros.adrc.specialise.values import Code, load, Memory, Refused
from nadrc_ros.adrc.state import disturbance_estimate
from nadrc_ros.adrc.tick import tick
import pytest
from test_all_features import everything, World

TICKS = 120
CASES = varied_settings()


def same_run(settings: ControllerSettings, seed: int) -> None:
    """Run the law as it is written and its specialised form side by side."""
    plain, fast = Controller(settings), Controller(settings)
    fast.specialise()
    assert fast._law is not tick
    world, rng = World(settings, seed), random.Random(seed)
    for k in range(TICKS):
        if rng.random() < 0.02:
            plain.enabled = fast.enabled = not plain.enabled
        if rng.random() < 0.01:
            plain.reset()
            fast.reset()
        told = world.next(plain.command)
        u, v = plain.tick(**told), fast.tick(**told)
        assert bits([u]) == bits([v]), k
        assert repr(plain.policy) == repr(fast.policy), k
        assert plain.status == fast.status, k
        assert all_bits(plain) == all_bits(fast), k


def all_bits(controller: Controller) -> list[list[str]]:
    """Return the whole of a state, with what only a later change or the display reads."""
    estimate = disturbance_estimate(controller.design, controller.state)
    return [*map(bits, controller.state.rows), bits([estimate])]


@pytest.mark.parametrize('name', CASES)
def test_every_branch_of_the_law_has_its_bits(name: str) -> None:
    same_run(ControllerSettings(**CASES[name]), 1)


@at_least(10)
@given(
    st.sampled_from(NAMES),
    st.integers(1, 5),
    st.integers(1, 6),
    st.integers(1, 3),
    st.sampled_from(('linear', 'fal')),
    st.sampled_from((0.0, 5.0)),
    st.booleans(),
    st.integers(0, 2**30),
)
def test_every_shape_has_its_bits(
    structure: str,
    order: int,
    levels: int,
    extended: int,
    feedback: str,
    acceleration: float,
    error_based: bool,
    seed: int,
) -> None:
    settings = ControllerSettings(
        structure=structure,
        plant_order=order,
        levels=levels,
        extended_states=extended,
        feedback=feedback,
        tracking_acceleration=acceleration,
        error_based=error_based,
    )
    same_run(settings, seed)


@at_least(15)
@given(everything(), st.integers(0, 2**30))
def test_all_features_have_their_bits(settings: ControllerSettings, seed: int) -> None:
    same_run(settings, seed)


def test_a_fed_line_goes_on_though_nothing_reads_the_call_that_writes_it() -> None:
    same_run(ControllerSettings(input_delay=0.05, feed_forward_timeout=1.0), 1)


def test_a_live_change_goes_on_with_its_bits_also_to_a_shape_that_was_not_made() -> None:
    plain, fast = Controller(ControllerSettings()), Controller(ControllerSettings())
    fast.specialise()
    laws = [fast._law]
    changes: list[dict[str, Any]] = [
        {'inner_bandwidth': 55.0, 'command_max': 8.0},
        {'structure': 'generalized', 'extended_states': 3, 'pole_ratios': (1.0, 1.1, 1.2)},
        {'structure': 'nested', 'extended_states': 1, 'pole_ratios': (1.0,)},
    ]
    for change in changes:
        wanted = attrs.evolve(plain.settings, **change)
        for each in (plain, fast):
            each.retune(wanted)
        for k in range(50):
            y = 0.01 * k * k
            assert bits([plain.tick(y, 0.01)]) == bits([fast.tick(y, 0.01)])
        assert state_bits(plain.state) == state_bits(fast.state)
        laws.append(fast._law)
    assert laws[0] is laws[1] is laws[3] and laws[2] is tick


def test_the_code_names_its_source_and_no_feature_that_is_off() -> None:
    source, _ = source_of(tick, make_design(ControllerSettings()))
    assert '# law.py:' in source and '# supervisor.py:' in source
    for off in ('delay_line', 'fhan', 'ripple', 'gain_at', 'resting[1]', 'while', 'for '):
        assert off not in source.replace('for i in', ''), off


def test_numbers_are_no_part_of_a_shape_but_features_are() -> None:
    def shape(**values: Any) -> Any:
        return shape_of(make_design(ControllerSettings(**values)))

    assert shape() == shape(inner_bandwidth=50.0, b0=-2.0, good_samples=7, command_max=3.0)
    others = [
        shape(plant_order=3),
        shape(levels=3),
        shape(command_rate_limit=5.0),
        shape(tracking_acceleration=2.0),
        shape(measurement_period=6.0),
        shape(feedback='fal'),
    ]
    assert len({shape(), *others}) == 1 + len(others)


def comprehension(x: float) -> float:
    return sum([x for _ in range(3)])


def guarded(x: float) -> float:
    try:
        return x
    finally:
        pass


def either_number(x: float) -> float:
    return x or 3.0


def returns_from_a_loop(x: float) -> float:
    return _found(x)


def _found(x: float) -> float:
    while x > 1.0:
        if x < 2.0:
            return x
        x = 0.5 * x
    return 0.0


@pytest.mark.parametrize('function', [comprehension, guarded, either_number])
def test_what_is_not_known_is_refused_by_its_line(function: Any) -> None:
    line = function.__code__.co_firstlineno + 1
    with pytest.raises(Refused, match=rf'test_specialise\.py:{line}: cannot be specialized'):
        Evaluator(['x']).run(function, [Code(load('x'))])


def test_a_return_in_a_loop_of_a_call_is_refused_and_not_lost() -> None:
    with pytest.raises(Refused, match='a return in a loop'):
        Evaluator(['x']).run(returns_from_a_loop, [Code(load('x'))])


def _bump(v: Vector) -> float:
    v[0] += 1.0
    return v[0]


def read_before_a_call(v: Vector, x: float) -> float:
    return v[0] - x * _bump(v)


def argument_before_a_call(v: Vector, x: float) -> float:
    return max(v[0] * x, _bump(v), x)


def compared_before_a_call(v: Vector, x: float) -> float:
    return 1.0 if v[0] < _bump(v) else x


def swapped(v: Vector, x: float) -> float:
    v[0], v[1] = v[1], v[0]
    return v[0] - x


def power_of_a_negative_number(v: Vector, x: float) -> float:
    base = -2.0
    return float(base ** float(int(x))) + v[0]


def a_call_for_what_it_writes(v: Vector, x: float) -> float:
    for i in range(3):
        _bump(v)
        _ = x * i
    return v[0]


def either_of_two_from_before(v: Vector, x: float) -> float:
    first = v[0] * x
    second = v[1] - x
    if x > 0.5:
        chosen = first
    else:
        chosen = second
    return chosen - x


def read_before_it_is_written(v: Vector, x: float) -> float:
    before = v[0]
    v[0] = x
    return before - v[0]


def fibonacci(v: Vector, x: float) -> float:
    one, next_one = v[0], x
    for _ in range(5):
        one, next_one = next_one, one + next_one
    return one - next_one * x


@pytest.mark.parametrize('rolled', [False, True])
@pytest.mark.parametrize(
    'function',
    [
        *(either_of_two_from_before, read_before_it_is_written, fibonacci),
        *(read_before_a_call, argument_before_a_call, compared_before_a_call, swapped),
        *(power_of_a_negative_number, a_call_for_what_it_writes),
    ],
)
def test_what_is_read_is_what_was_there_in_the_order_of_the_source(
    function: Any, rolled: bool
) -> None:
    evaluator = Evaluator(['v', 'x'], rolled=rolled)
    place = load('v')
    vector = Memory(place, 2) if rolled else evaluator.row('v', 2, place)
    body = joined(tidied(evaluator.run(function, [vector, Code(load('x'))])))
    source = '\n'.join(['def made(v, x):', *text(body, 1)])
    made = defined('made', source, dict(SCOPE), 'made')
    for x in (2.0, -3.0, NAN if function is not power_of_a_negative_number else 5.0):
        vectors = [0.5, -1.5], [0.5, -1.5]
        assert bits([function(vectors[0], x)]) == bits([made(vectors[1], x)]), source
        assert bits(vectors[0]) == bits(vectors[1]), source
