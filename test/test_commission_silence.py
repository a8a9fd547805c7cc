"""Whether an actuator stops by itself is told from the motion after the last command."""

from __future__ import annotations

from math import inf, isnan

import attrs
from nadrc_ros.adrc.commission.settings import ExperimentSettings
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.tuning.commission import steps
from nadrc_ros.tuning.commission.look import Look
from nadrc_ros.tuning.commission.machine import Simulated
from nadrc_ros.tuning.commission.model import Model, ModelPlant
from nadrc_ros.tuning.commission.silence import judge_silence, planned, Silence
import pytest

H = 0.01
MODELS = (
    Model(order=1, b0=2.0),
    Model(order=1, b0=2.0, damping=5.0, delay=0.02),
    Model(order=1, b0=-2.0, damping=1.0, friction=0.5),
    Model(order=2, b0=-20.0, damping=0.5),
    Model(order=2, b0=20.0, damping=0.5, friction=0.5),
)


def prepared(
    model: Model, really: float, center: float = 0.0
) -> tuple[Simulated, ExperimentSettings, Look]:
    present = ControllerSettings(command_min=-10.0, command_max=10.0, safe_command=center)
    plant = ModelPlant(model, H, center, 0.005, 1)
    machine = Simulated(plant, 1.0 / H, present, actuator_timeout=really)
    base = steps.bounds(machine, max_command=4.0, travel=3.0, speed=8.0)
    return machine, base, steps.look(machine)


def judged(model: Model, given: float, really: float, center: float = 0.0) -> Silence:
    """Test it with a model of which b0 is 15 % too large."""
    machine, base, seen = prepared(model, really, center)
    guess = attrs.evolve(model, b0=1.15 * model.b0)
    settings = planned(base, seen, guess, given)
    assert settings is not None
    found = judge_silence(machine.run(settings), settings, guess, given)
    plant = machine.plant
    assert isinstance(plant, ModelPlant)
    assert 0.02 < max(map(abs, plant.outputs)) < 0.5 * base.travel
    return found


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('really', [0.15, 0.25, 0.4, inf])
def test_p23_an_actuator_that_goes_on_is_told_from_one_that_stops(
    model: Model, really: float
) -> None:
    found = judged(model, 0.3, really, center=1.5)
    assert found.stops == (really < 0.3)
    if really < inf:
        assert abs(found.timeout - really) < 0.05
        assert ('later than the 0.3 s that you gave' in found.lines[0]) == (really > 0.3)
    else:
        assert found.timeout == inf and 'does not stop' in found.lines[0]


def test_what_cannot_be_seen_inside_the_bounds_is_not_tried() -> None:
    _, base, seen = prepared(Model(order=2, b0=20.0), inf)
    assert planned(base, seen, Model(order=2, b0=20.0), 1.0) is not None
    assert planned(base, seen, Model(order=2, b0=20.0), 30.0) is None


def test_a_bound_ends_it_and_commands_come_again() -> None:
    model = Model(order=1, b0=2.0)
    machine, base, seen = prepared(model, inf)
    settings = planned(base, seen, model, 0.3)
    assert settings is not None
    narrow = attrs.evolve(settings, travel=0.6)
    samples = machine.run(narrow)
    assert samples.outcome == 'bound' and 'silent' in samples.stage
    assert samples.command[-1] == narrow.center
    found = judge_silence(samples, narrow, model, 0.3)
    assert isnan(found.timeout) and not found.stops and 'travel' in found.lines[0]
