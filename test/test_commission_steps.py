"""The five steps on machines of which they know nothing: some of those of bench.commission."""

from __future__ import annotations

import attrs
from bench.commission import commission, figures, Result
from bench.commission_plants import random_case, RandomPlant
from nadrc_ros.tuning.commission import steps
from nadrc_ros.tuning.commission.machine import Simulated
from nadrc_ros.tuning.commission.model import Model, ModelPlant
import numpy as np
import pytest

# Friction, gravity, stops, dead time, coarse sensors; both orders, both signs of b0.
SEEDS = (0, 3, 5, 12, 18, 22, 34, 50)


@pytest.fixture(scope='module')
def results() -> list[Result]:
    """Commission them once for all tests."""
    return [commission(random_case(seed)) for seed in SEEDS]


def test_p23_no_bound_is_exceeded_and_no_sign_is_wrong(results: list[Result]) -> None:
    found = figures(results)
    assert found['bounds_exceeded'] == found['wrong_sign'] == 0


def test_most_are_accepted_and_what_is_said_of_them_is_true(results: list[Result]) -> None:
    found = figures(results)
    assert found['accepted'] >= 0.8 * len(SEEDS)
    assert found['held'] == found['stable'] == found['accepted']
    assert all(each.refusal for each in results if not each.accepted)


def test_a_machine_that_drifts_through_its_travel_is_not_nudged() -> None:
    case = attrs.evolve(random_case(22), load=0.3, b0=1.0, travel=0.5, damping=0.0)
    machine = Simulated(RandomPlant(case), case.rate, case.present)
    base = steps.bounds(machine, max_command=1.0, travel=0.5, speed=2.0)
    nudged = steps.nudge(machine, base, steps.look(machine))
    assert 'drifts' in nudged.refusal and nudged.sign == 0


def test_a_machine_that_does_not_move_is_refused_and_says_what_to_allow() -> None:
    model = Model(order=2, b0=1.0, friction=5.0)
    machine = Simulated(ModelPlant(model, 0.01, 0.0, 1e-3, 1), 100.0, random_case(1).present)
    base = steps.bounds(machine, max_command=2.0, travel=0.5, speed=2.0)
    nudged = steps.nudge(machine, base, steps.look(machine))
    assert nudged.fitted is None and '--max-command' in nudged.refusal
    assert nudged.samples.outcome == 'still'


def test_the_model_stops_where_friction_holds_it_and_not_without() -> None:
    commands = [0.0, *[2.0] * 50, *[0.0] * 200]
    slides, v = Model(order=2, b0=1.0).response(commands, 0.01)
    stops, rest = Model(order=2, b0=1.0, friction=0.5).response(commands, 0.01)
    assert v == pytest.approx(2.0 * 0.5)
    assert rest == 0.0 and stops[-1] == stops[-50]
    # 1/2 a t^2 with a = 1.5, and then v^2 / (2 d) with d = 0.5
    assert stops[-1] == pytest.approx(0.5 * 1.5 * 0.25 + 0.75**2, rel=0.02)
    assert np.all(np.diff(slides) >= 0.0)


def test_the_trial_goes_back_when_the_machine_is_not_the_one_that_was_found() -> None:
    case = random_case(3)
    machine = Simulated(RandomPlant(case), case.rate, case.present)
    base = steps.bounds(
        machine, max_command=case.max_command, travel=case.travel, speed=case.speed
    )
    seen = steps.look(machine)
    finding = steps.say(
        machine, base, seen, steps.excite(machine, base, seen, steps.nudge(machine, base, seen))
    )
    assert finding.settings is not None
    other = RandomPlant(attrs.evolve(case, b0=0.4 * case.b0))
    trial = steps.attempt(Simulated(other, case.rate, case.present), base, seen, finding)
    assert not trial.accepted and 'not as predicted' in trial.refusal
    assert trial.samples.outcome == 'worse'
