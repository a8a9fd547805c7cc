"""Whatever a scenario holds, its file loads back to an equal one."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import attrs
from hypothesis import assume, given, HealthCheck, settings
from hypothesis import strategies as st
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import Declared, declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.scenario import dump, loads, PlantSpec, Scenario, SignalSpec
from nadrc_ros.simulation.experiment import Retune
from nadrc_ros.simulation.faults import CommandFault, Faults, MeasurementFault
from nadrc_ros.simulation.noise import Noise
from nadrc_ros.simulation.plants import PLANTS
from nadrc_ros.simulation.sensor import Sensor
from nadrc_ros.simulation.signals import SIGNALS
import numpy as np


def values_of(field: Declared) -> st.SearchStrategy[Any]:
    number = st.floats(field.low, field.high, allow_nan=False)
    if field.nonzero:
        number = number.filter(lambda value: abs(value) > 1e-3)
    if field.kind == 'number':
        return number
    if field.kind == 'numbers':
        return st.tuples(number)
    if field.kind == 'integer':
        assert field.low is not None and field.high is not None
        return st.integers(int(field.low), int(field.high))
    return st.sampled_from(field.choices) if field.kind == 'choice' else st.booleans()


def some_values(cls: type[Any], **fixed: Any) -> st.SearchStrategy[dict[str, Any]]:
    fields = {name: values_of(f) for name, f in declared(cls).items() if name not in fixed}
    return st.fixed_dictionaries({}, optional=fields).map(lambda values: values | fixed)


def some(cls: type[Any]) -> st.SearchStrategy[Any]:
    return some_values(cls).map(lambda values: cls(**values))


@st.composite
def signals(draw: st.DrawFn) -> SignalSpec:
    name = draw(st.sampled_from(list(SIGNALS)))
    return SignalSpec(name=name, values=draw(some_values(SIGNALS[name])))


def possible(values: dict[str, Any], order: int) -> ControllerSettings:
    """Return settings with those of the values that go together: few of all do."""
    settings = ControllerSettings(plant_order=order)
    for name, value in values.items():
        with suppress(SettingError):
            settings = attrs.evolve(settings, **{name: value})
    return settings


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    name = draw(st.sampled_from(list(PLANTS)))
    spec = PlantSpec(name=name, values=draw(some_values(PLANTS[name])))
    order, states = spec.make().order, spec.make().states
    names = st.from_regex(r'[A-Za-z_][A-Za-z0-9_]*', fullmatch=True)
    changes = draw(
        st.lists(st.tuples(st.floats(0, 1), values_of(declared(ControllerSettings)['levels'])))
    )
    try:
        controllers = {
            name: possible(draw(some_values(ControllerSettings, plant_order=order)), order)
            for name in draw(st.lists(names, min_size=1, max_size=3))
        }
        return Scenario(
            plant=spec,
            initial_state=draw(
                st.just(())
                | st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * states)
            ),
            reference=draw(signals()),
            disturbance=draw(signals()),
            noise=Noise(**draw(some_values(Noise))),
            sensor=draw(some(Sensor)),
            faults=Faults(
                measurement=tuple(draw(st.lists(some(MeasurementFault), max_size=2))),
                command=tuple(draw(st.lists(some(CommandFault), max_size=2))),
            ),
            controllers=controllers,
            retunes=tuple(Retune(time=t, settings={'levels': k}) for t, k in changes),
            rate=draw(st.floats(10, 1000)),
            duration=draw(st.floats(2, 100)),
            error=draw(st.sampled_from(['reference', 'tracking'])),
            input_delay=draw(st.just(0.0) | st.floats(0.0, 100.0)),
        )
    except SettingError:
        assume(False)
        raise


@settings(max_examples=60, suppress_health_check=list(HealthCheck))
@given(scenarios())
def test_what_is_dumped_loads_back_equal(scenario: Scenario) -> None:
    text = dump(scenario)
    again = loads(text)
    assert again == scenario
    assert dump(again) == text
    for name, settings_ in scenario.controllers.items():
        assert attrs.astuple(again.controllers[name]) == attrs.astuple(settings_)


def test_numpy_numbers_are_dumped_as_numbers() -> None:
    scenario = loads('plant: chain\nreference: none\ncontrollers: {it: }')
    settings = attrs.evolve(scenario.controllers['it'], inner_bandwidth=np.float64(12.5))
    tuned = attrs.evolve(scenario, controllers={'it': settings})
    assert loads(dump(tuned)) == tuned
