"""A plant in a user's file runs like a registered one, and its faults are told by their line."""

from __future__ import annotations

import os
from pathlib import Path
import sys
from textwrap import dedent
from typing import Any

from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.scenario import dump, load, loads, PLANT, ScenarioError
from nadrc_ros.scenario.sweep import load_sweep, run_range
from nadrc_ros.simulation.compiled import compiled_loop
from nadrc_ros.simulation.kernel import _fields, _verdict, _VERDICTS_KEPT
import numpy as np
import pytest

BODY = """
    order = 2
    states = 2
    b0 = 1.0

    def derivative(self, t, x, u, w, dx):
        dx[0] = x[1]
        dx[1] = self.a1 * x[0] + self.a2 * sin(x[1]) + w + (1.0 + 0.2 * sin(t)) * u

    def output(self, x):
        return x[0]
"""
PLAIN = f"""
from math import sin

class Mine:
    def __init__(self, a1, a2=0.1):
        self.a1, self.a2 = a1, a2
{BODY}
"""
DATACLASS = f"""
from __future__ import annotations
from dataclasses import dataclass
from math import sin

@dataclass
class Mine:
    a1: float
    a2: float = 0.1
{BODY}
"""
ATTRS = f"""
from math import sin
import attrs
from nadrc_ros.adrc.fields import number

@attrs.frozen(kw_only=True)
class Mine:
    a1: float = number(0.0, -1.0, 1.0, '1/s^2', 'stiffness')
    a2: float = number(0.1, -1.0, 1.0, '1/s^2', 'gain')
{BODY}
"""
SCENARIO = """
plant: {file: my_plant.py, a1: 0.2}
reference: {signal: cosine, frequency: 0.5}
disturbance: decaying_cosine
duration: 3
controllers: {nested: }
"""


@pytest.fixture
def plant_file(tmp_path: Path) -> Path:
    return tmp_path / 'my_plant.py'


def scenario_with(plant_file: Path, source: str, **changes: str) -> Path:
    plant_file.write_text(source)
    text = SCENARIO
    for old, new in changes.items():
        text = text.replace(old, new)
    path = plant_file.with_name('scenario.yaml')
    path.write_text(text)
    return path


def refused(plant_file: Path, source: str, class_name: str = '', **values: Any) -> str:
    plant_file.write_text(source)
    with pytest.raises((SettingError, ScenarioError)) as caught:
        PLANT.load(plant_file, class_name, values)
    message = str(caught.value)
    assert '\n' not in message
    return message


@pytest.mark.parametrize('source', [PLAIN, DATACLASS, ATTRS], ids=['plain', 'dataclass', 'attrs'])
def test_a_copy_of_a_registered_plant_gives_the_same_bits(plant_file: Path, source: str) -> None:
    mine = load(scenario_with(plant_file, source)).run('nested')
    own = loads(SCENARIO.replace('file: my_plant.py', 'name: paper')).run('nested')
    assert np.array_equal(mine.output, own.output)
    assert np.array_equal(mine.total_disturbance, own.total_disturbance)


def test_the_file_is_sought_beside_the_scenario_and_kept_by_its_full_path(
    plant_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = load(scenario_with(plant_file, PLAIN))
    assert scenario.plant.file == str(plant_file)
    assert scenario.plant.values == {'a1': 0.2}
    monkeypatch.chdir('/')
    assert loads(dump(scenario), '/nowhere') == scenario


@pytest.mark.parametrize(
    'text',
    ["'1e-4'", 'true', "'true'", '3', "'3'", '3.0', '[1, 2.5]', '[a, b]', "'a\\nb: c'"],
)
def test_coefficients_of_every_kind_survive_the_round_trip(plant_file: Path, text: str) -> None:
    source = PLAIN.replace('a1, a2=0.1', 'a1, kind').replace('= a1, a2', '= a1, 0.1')
    path = scenario_with(plant_file, source, **{'a1: 0.2': f'a1: 2, kind: {text}'})
    scenario = load(path)
    again = loads(dump(scenario))
    assert repr(again.plant.values) == repr(scenario.plant.values)


def test_order_states_and_b0_come_from_the_file(plant_file: Path) -> None:
    source = PLAIN.replace('b0 = 1.0', 'b0 = -3')
    scenario = load(scenario_with(plant_file, source))
    assert scenario.controllers['nested'].b0 == -3.0
    assert scenario.initial_state == (0.0, 0.0)


def test_a_changed_file_is_read_again_and_nothing_is_left_beside_it(plant_file: Path) -> None:
    for b0 in (2.0, 3.0, 4.0):  # same size, same second: a byte-code cache would go stale
        plant_file.write_text(PLAIN.replace('b0 = 1.0', f'b0 = {b0}'))
        assert PLANT.load(plant_file, '', {'a1': 0}).b0 == b0
    assert os.listdir(plant_file.parent) == ['my_plant.py']


def test_a_file_named_like_a_module_does_not_hide_it(tmp_path: Path) -> None:
    import math

    (tmp_path / 'math.py').write_text(PLAIN)
    PLANT.load(tmp_path / 'math.py', '', {'a1': 0.0})
    assert sys.modules['math'] is math


def test_one_of_several_plants_is_named(plant_file: Path) -> None:
    source = PLAIN + 'class Other(Mine):\n    b0 = 2.0\n'
    assert '`class:` must name one of Mine, Other' in refused(plant_file, source, a1=0)
    assert PLANT.load(plant_file, 'Other', {'a1': 0}).b0 == 2.0
    assert "plant.class = 'Third'" in refused(plant_file, source, 'Third')


def test_what_is_imported_or_a_protocol_is_no_candidate(plant_file: Path) -> None:
    source = """
        from typing import Protocol
        from nadrc_ros.simulation.plants import PaperPlant
        class Like(Protocol):
            def derivative(self, t, x, u, w, dx): ...
        class Helper:
            pass
    """
    message = refused(plant_file, dedent(source))
    assert 'a file that defines a class with a method derivative' in message
    plant_file.write_text(dedent(source) + PLAIN)
    assert type(PLANT.load(plant_file, '', {'a1': 0})).__name__ == 'Mine'


@pytest.mark.parametrize('source', [PLAIN, DATACLASS, ATTRS], ids=['plain', 'dataclass', 'attrs'])
def test_coefficients_are_checked(plant_file: Path, source: str) -> None:
    assert 'plant.a3: there is no such key; did you mean a2? there are a1, a2' in refused(
        plant_file, source, a1=1, a3=1
    )
    for value in ({'x': 1}, float('inf'), [1, [2]], None, [1, 'a']):
        assert refused(plant_file, source, a1=value).startswith('plant.a1 = ')
    if source is ATTRS:
        assert 'plant.a1 = 5.0: must be a finite number from -1 to 1' in refused(
            plant_file, source, a1=5
        )
    else:
        assert 'plant.a1 is missing: Mine asks for it' in refused(plant_file, source)


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('from math', 'from maths', "line 2: ModuleNotFoundError: No module named 'maths'"),
        ('class Mine:', 'class Mine', "line 4: SyntaxError: expected ':'"),
        ('class Mine:', '1 / 0\nclass Mine:', 'line 4: ZeroDivisionError: division by zero'),
        ('class Mine:', 'raise SystemExit(0)\nclass Mine:', 'line 4: SystemExit: 0'),
        ('= a1, a2', '= a1, b2', "line 6: NameError: name 'b2' is not defined"),
        ('sin(t)) * u', 'sin(t)) * v', "line 14: NameError: name 'v' is not defined"),
        ('return x[0]', 'return x[9]', 'line 17: IndexError: list index out of range'),
        ('return x[0]', 'return x[1]', 'plant.output = '),
        ('order = 2', 'order = 7', 'plant.order = 7: must be an integer from 1 to 5'),
        ('states = 2', '', "plant.states = 'missing'"),
        ('dx[0] = x[1]', 'dx[0] = x[0]', 'plant.derivative: dx[0] = '),
        ('from math', 'from math\0', 'my_plant.py: '),
    ],
)
def test_a_fault_is_told_by_its_line(plant_file: Path, old: str, new: str, message: str) -> None:
    told = refused(plant_file, PLAIN.replace(old, new, 1), a1=0)
    assert message in told
    if message.startswith('line'):
        assert told.startswith(f'{plant_file}, {message}')


def test_a_fault_inside_the_class_named_in_a_scenario_is_told_too(plant_file: Path) -> None:
    path = scenario_with(plant_file, PLAIN.replace('a1, a2=0.1):', 'a1):\n        raise OSError'))
    with pytest.raises(ScenarioError, match=r'my_plant\.py, line 6: OSError$'):
        load(path)


@pytest.mark.parametrize('fault', ['1 / 0', 'raise ValueError("it broke")', '[][0]'])
def test_a_fault_in_the_middle_of_a_run_is_told(plant_file: Path, fault: str) -> None:
    source = PLAIN.replace('dx[0] = x[1]', f'dx[0] = x[1]\n        if t > 2.5: {fault}')
    scenario = load(scenario_with(plant_file, source))
    with pytest.raises(ScenarioError, match=r'my_plant\.py, line 14: '):
        scenario.run('nested')


def test_a_validator_of_the_class_is_heard(plant_file: Path) -> None:
    source = ATTRS.replace("number(0.0, -1.0, 1.0, '1/s^2', 'stiffness')", 'positive()').replace(
        '\n@attrs',
        '\ndef positive():\n    return attrs.field(validator=attrs.validators.gt(0))\n@attrs',
    )
    assert "my_plant.py: ValueError: 'a1' must be > 0: -1" in refused(plant_file, source, a1=-1)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r'plant\.file = .*No such file'):
        PLANT.load(tmp_path / 'nothing.py')
    with pytest.raises(SettingError, match=r'plant\.file = .*directory'):
        PLANT.load(tmp_path)


def test_the_file_runs_once_and_a_sweep_over_it_keeps_nothing(plant_file: Path) -> None:
    ran = plant_file.with_name('ran')
    source = PLAIN.replace('class Mine', f"open({str(ran)!r}, 'a').write('x')\n\nclass Mine")
    path = scenario_with(plant_file, source, **{'duration: 3': 'duration: 0.05'})
    scenario = load(path)
    for name in (*scenario.controllers, *scenario.controllers):
        scenario.run(name)
    PLANT.type_of(str(plant_file))  # as a plant node, which declares its coefficients
    written = plant_file.with_name('sweep.yaml')
    values = [0.01 * i for i in range(_VERDICTS_KEPT + 20)]
    written.write_text(f'scenario: scenario.yaml\nvary: {{plant.a1: {values}}}\n')
    sweep = load_sweep(written)
    sweep.check()
    run_range(sweep, 0, 2, compiled=True)
    kept = compiled_loop.cache_info().misses, _fields.cache_info().currsize
    run_range(sweep, 2, len(values), compiled=True)
    assert (compiled_loop.cache_info().misses, _fields.cache_info().currsize) == kept
    assert _verdict.cache_info().currsize <= _VERDICTS_KEPT
    assert ran.read_text() == 'x'


def test_an_interrupt_is_not_taken_for_a_fault(plant_file: Path) -> None:
    plant_file.write_text('raise KeyboardInterrupt')
    with pytest.raises(KeyboardInterrupt):
        PLANT.load(plant_file)
