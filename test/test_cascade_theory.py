"""Cascades in theory and tuning: margins with all loops closed, what varies and is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import attrs
from law_helpers import Chain
from nadrc_ros.adrc.cascade import Cascade, CascadeSettings, loops_of
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import loads, Scenario
from nadrc_ros.scenario.parameter_files import node_parameters
from nadrc_ros.theory.cascade import cascade_loop, laws
from nadrc_ros.theory.loop import chain
from nadrc_ros.theory.margins import loop_margins, margins
from nadrc_ros.theory.system import growth
from nadrc_ros.tuning.search.score import Corner, Judge, with_gain
from nadrc_ros.tuning.search.settings import TuneSettings
from nadrc_ros.tuning.search.variables import designed, first_designs, values_of, variables
import numpy as np
import pytest
import yaml

H = 0.005
ROOT = Path(__file__).parents[1]


def loop(wc: float, structure: str) -> dict[str, Any]:
    return {
        'plant_order': 1,
        'structure': structure,
        'controller_bandwidth': wc,
        'inner_bandwidth': 4.0 * wc,
        'outer_bandwidth': 3.0 * wc,
        'command_min': -1e9,
        'command_max': 1e9,
    }


def cascade(ratio: float, structure: str, wc: float = 2.0) -> CascadeSettings:
    inner = ControllerSettings(**loop(ratio * wc, structure))
    return CascadeSettings(**loop(wc, structure), inner=inner)


def outputs(
    settings: CascadeSettings, seconds: float, start: float, r: float, begin: float = 0.0
) -> list[float]:
    """Return the output of a double integrator; the reference is where it starts until then."""
    laws, plant = Cascade(settings, checked=True), Chain(2)
    plant.x[0] = start
    found = []
    for k in range(round(seconds / H)):
        found.append(plant.y)
        aim = r if k * H >= begin else start
        plant.advance(laws.tick(plant.x, H, reference=[aim]), H)
    return found


def overshoot(settings: CascadeSettings) -> float:
    """Return that of a step of 1 while the loop is closed: closing it on the way is softer."""
    return max(outputs(settings, 8.0, 0.0, 1.0, begin=0.5)) - 1.0


@pytest.mark.parametrize('structure', ['conventional', 'nested'])
@pytest.mark.parametrize('ratio', [1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 9.0])
def test_a_cascade_is_stable_where_theory_says_so(ratio: float, structure: str) -> None:
    settings = cascade(ratio, structure)
    closed = cascade_loop([make_design(s) for s in loops_of(settings)], chain(2, 1.0), H).closed
    found = outputs(settings, 20.0, 1.0, 0.0)
    grew = max(map(abs, found[3000:])) / max(map(abs, found[1000:2000]))
    rate = growth(closed) ** 2000  # from the one window to the other; a mode may beat
    assert (grew < 1.0) == (rate < 1.0)
    if rate > 1e-6:  # what decays faster is the sum of several modes
        assert 0.1 * rate < grew < 10.0 * rate


@pytest.mark.parametrize('structure', ['conventional', 'nested', 'cascade'])
def test_the_laws_in_a_row_give_the_commands_of_the_cascade(structure: str) -> None:
    innermost = ControllerSettings(**loop(30.0, structure))
    middle = CascadeSettings(**loop(9.0, structure), inner=innermost)
    settings = CascadeSettings(**loop(3.0, structure), inner=middle)
    system = laws([make_design(each) for each in loops_of(settings)], H)
    real, state = Cascade(settings, checked=True), np.zeros(len(system.a))
    rng = np.random.default_rng(4)
    for k in range(300):
        seen = rng.normal(size=3) if k > 4 else np.zeros(3)  # until all are in control
        u = real.tick(seen.tolist(), H, reference=[0.0])
        expected = float(system.c[0] @ state + system.d[0] @ seen)
        state = system.a @ state + system.b @ seen
        assert u == pytest.approx(expected, rel=1e-8, abs=1e-6)


def test_the_margins_of_a_cascade_are_where_it_becomes_unstable() -> None:
    designs = [make_design(each) for each in loops_of(cascade(4.0, 'nested'))]
    found = loop_margins(cascade_loop(designs, chain(2, 1.0), H))
    for inside, outside in (
        (0.99 * found.gain_high, 1.01 * found.gain_high),
        (1.01 * found.gain_low, 0.99 * found.gain_low),
    ):
        grew = [growth(cascade_loop(designs, chain(2, g), H).closed) for g in (inside, outside)]
        assert grew[0] < 1.0 < grew[1]
    late = round(found.delay / H - 0.5) * H
    assert loop_margins(cascade_loop(designs, chain(2, 1.0), H, late)).modulus > 0.0
    assert loop_margins(cascade_loop(designs, chain(2, 1.0), H, late + 2 * H)).modulus == 0.0


def test_a_cascade_of_one_has_the_margins_of_its_loop() -> None:
    design, plant = make_design(ControllerSettings(plant_order=2)), chain(2, 1.0)
    alone = loop_margins(cascade_loop([design], plant, H, 0.3 * H))
    assert alone == pytest.approx(margins(design, plant, H, 0.3 * H), rel=1e-3)


@pytest.mark.parametrize(
    ('structure', 'ratio', 'most', 'modulus'),
    [
        ('conventional', 3.0, 0.012, 0.75),
        ('conventional', 5.0, 0.001, 0.75),
        ('nested', 4.0, 0.06, 0.65),
        ('nested', 5.0, 0.01, 0.65),
    ],
)
def test_an_inner_loop_three_to_five_times_as_fast_leaves_little_overshoot(
    structure: str, ratio: float, most: float, modulus: float
) -> None:
    """The rule of docs/cascade.md; twice as fast is too slow."""
    settings = cascade(ratio, structure)
    designs = [make_design(each) for each in loops_of(settings)]
    assert loop_margins(cascade_loop(designs, chain(2, 1.0), H)).modulus > modulus
    assert overshoot(settings) < most
    assert overshoot(cascade(2.0, structure)) > 0.09


@pytest.mark.parametrize('structure', ['conventional', 'nested'])
@pytest.mark.parametrize('ratio', [1.0, 1.5, 2.0])
def test_an_outer_loop_that_knows_the_lag_of_the_inner_one_does_not_overshoot(
    structure: str, ratio: float
) -> None:
    """As docs/cascade.md has it: without, twice as fast is too slow; a delay keeps it stable."""
    wc, without = 2.0 * ratio, cascade(ratio, structure)
    lagged = attrs.evolve(without, plant_order=2, b0=wc, plant_poles=(-wc,))
    assert overshoot(lagged) < 1e-4 < 0.09 < overshoot(without)
    late = overshoot(attrs.evolve(without, input_delay=1.0 / wc))
    assert late < {1.0: 0.4, 1.5: 0.2, 2.0: 0.12}[ratio]


def scenario() -> Scenario:
    own = {'controller_bandwidth': 2.0, 'inner_bandwidth': 8.0, 'structure': 'conventional'}
    inner = {'controller_bandwidth': 8.0, 'inner_bandwidth': 32.0}
    return loads(
        yaml.safe_dump(
            {
                'plant': {'name': 'chain', 'order': 2},
                'reference': 'step',
                'rate': 200,
                'duration': 3.0,
                'noise': {'derivative_variances': [1e-6]},
                'controllers': {'it': {**own, 'inner': inner}},
            }
        ),
        ROOT,
    )


def test_what_varies_has_the_dotted_names_of_its_loop() -> None:
    settings = scenario().controllers['it']
    varied = variables(settings, {}, 200.0, 3.0, 0.5)
    names = {v.name for v in varied}
    assert {'inner_bandwidth', 'inner.inner_bandwidth', 'inner.outer_share'} <= names
    assert 'outer_share' not in names  # of one level
    values = values_of(settings, varied)
    assert (values['controller_bandwidth'], values['inner.controller_bandwidth']) == (2.0, 8.0)
    changed = designed(settings, {**values, 'inner.controller_bandwidth': 9.0})
    expected = attrs.evolve(loops_of(settings)[1], controller_bandwidth=9.0, feedback_level='1')
    assert isinstance(settings, CascadeSettings)
    assert loops_of(changed) == [attrs.evolve(settings, inner=expected), expected]
    by_rule = first_designs(settings, varied, 4)[1]
    assert by_rule['inner.inner_bandwidth'] == min(100.0, 4.0 * by_rule['inner_bandwidth'])
    (one,) = variables(settings, {'inner.b0': (0.5, 2.0)}, 200.0, 3.0, 0.5)
    assert (one.name, one.low, one.high) == ('inner.b0', 0.5, 2.0)
    for name, complaint in {'inner.b1': 'did you mean inner.b0', 'outer_share': 'no such'}.items():
        with pytest.raises(UserError, match=complaint):
            variables(settings, {name: ()}, 200.0, 3.0, 0.5)
    with pytest.raises(UserError, match=r'vary\.inner\.b0 = .*without 0'):
        variables(settings, {'inner.b0': (-1.0, 2.0)}, 200.0, 3.0, 0.5)


def test_a_cascade_is_judged_as_one_loop() -> None:
    one = scenario()
    judge = Judge(one, 'it', TuneSettings(seeds=2), compiled=False)
    settings = judge.settings
    good = judge.score(values_of(settings, variables(settings, {}, 200.0, 3.0, 0.5)))
    assert good.figures is not None and not good.violations
    assert len(judge.seeds) == 2  # the noise of the speed alone
    assert judge.score({'inner.controller_bandwidth': 2.0}).violations.keys() == {'stability'}
    assert 'largest_wh' in judge.score({'inner.inner_bandwidth': 900.0}).violations
    quiet = Corner(one.experiment, 1.0).quiet.experiment.noise
    assert not quiet.random
    outer, inner = loops_of(with_gain(settings, 2.0))
    assert outer.b0 == 1.0 and inner.b0 == 0.5 * loops_of(settings)[1].b0
    assert inner.command_max == 200.0


def test_the_parameters_of_a_cascade_are_of_a_node_for_each_loop() -> None:
    one = scenario()
    nodes = node_parameters(one.controllers['it'], one.rate)
    assert list(nodes) == ['/**/loop_1/controller', '/**/loop_2/controller']
    outer, inner = nodes.values()
    assert 'reference_from' not in outer and inner['reference_from'] == 'loop_1'
    assert (outer['controller_bandwidth'], inner['controller_bandwidth']) == (2.0, 8.0)
    assert 'inner' not in outer
