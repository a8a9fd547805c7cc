"""One law, several machines: what numba compiles of it gives the same bits as plain Python."""

from __future__ import annotations

from ctypes import c_double, POINTER
from importlib import import_module, invalidate_caches
from pathlib import Path
import random
import sys
from typing import Any

from law_helpers import NAN, state_bits, varied_settings
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import blank_state
from nadrc_ros.adrc.status import Mode
from nadrc_ros.adrc.tick import tick
from nadrc_ros.simulation import period
from nadrc_ros.simulation.compiled import _named_by_source
from nadrc_ros.simulation.compiled_law import compiled_law
from nadrc_ros.simulation.flat import sources
from nadrc_ros.simulation.kernel import Running
import pytest

ALL: dict[str, Any] = {
    'b0': -2.0,
    'b0_table': (-1.0, -0.5, 0.5, -2.0, 1.0, -1.0),
    'measurement_period': 0.5,
    'input_delay': 0.0237,
    'plant_order': 1,
    'levels': 1,
    'disturbance_frequencies': (30.0,),
    'error_deadband': 0.2,
    'command_rate_limit': 400.0,
}
# Each is compiled anew; test_specialise goes through all of them in plain Python.
CHOSEN = 'nonlinear-2', 'error-td-fal', 'cascade-ratios'
CASES = {name: varied_settings()[name] for name in CHOSEN} | {'all': ALL}
TICKS = 3000


@pytest.mark.parametrize(
    'case',
    ['table', 'table-td', 'deadband', 'delay', 'angle-td', 'known lags', 'vibration-generalized'],
)
def test_every_feature_can_be_evaluated(case: str) -> None:
    code, _ = sources(make_design(ControllerSettings(**varied_settings()[case])))
    assert {'regular_period', 'period', 'realise', 'estimate_derivatives'} <= set(code)
    for name, source in code.items():
        compile(source, name, 'exec')
        assert 'design.' not in source and 'state.' not in source.replace('state.py', ''), name


@pytest.mark.parametrize('case', CASES)
def test_p18_compiled_and_plain_give_the_same_bits(case: str) -> None:
    """
    Over jittered ticks with bad samples, lost references, gaps and an enable switch at work.

    And now and then with reports of what acts, and feed-forward. Periods that are left to plain
    Python are few.
    """
    settings = ControllerSettings(**CASES[case], reference_timeout=0.05, max_dt=0.1)
    plain, compiled = Controller(settings), Controller(settings)
    law = compiled_law(plain.design)['period']
    modes, commands, done = set[int](), set[float](), 0
    for sample, reference, enabled in stream(plain):
        one, fast = Running(compiled), blank_state(compiled.design)
        design, state, out, told, gives = one.parts
        told[: period.REFERENCED] = sample
        told[period.REFERENCED], told[period.ENABLED] = reference is not None, enabled
        for each in (plain, compiled):
            each.reference[:] = reference or each.reference
        one.reference[:] = reference or one.reference
        vectors = design, state, one.reference, told, out, gives
        law.ctypes(*(each.ctypes.data_as(POINTER(c_double)) for each in vectors))
        done += gives[period.LEFT] == 0.0
        for each in (plain, compiled):
            if each is plain or gives[period.LEFT] > 0.0:
                u, _, each.policy = tick(
                    *(each.design, each.state, each.policy, sample, each.reference),
                    *(reference is not None, enabled, fast),
                )
                each.state, fast, each.command = fast, each.state, u
            else:
                one.give_back(1)
        assert plain.command.hex() == compiled.command.hex()
        assert repr(plain.policy) == repr(compiled.policy)
        assert state_bits(plain.state) == state_bits(compiled.state)
        modes.add(plain.policy.mode)
        commands.add(plain.command)
    assert len(commands) > 5 and modes >= {Mode.OK, Mode.RAMPING, Mode.SAFE}
    assert done > 0.8 * TICKS


def stream(controller: Controller) -> Any:
    """Yield samples, references, and whether it is enabled."""
    n, y = controller.design.order, 0.0
    rng, others = random.Random(1), random.Random(2)
    for k in range(TICKS):
        h = 0.005 * (1 + 0.3 * rng.uniform(-1, 1)) if rng.random() > 0.01 else 0.2
        reference = None
        if rng.random() > 0.2 and k % 500 > 50:
            reference = [rng.gauss(0.0, 1.0) if i < 2 else 0.0 for i in range(n + 1)]
        measured = rng.random() > 0.05 and k % 300 > 60
        y += 0.01 * rng.gauss(0.0, 1.0)
        u = controller.command
        sample = Sample(y if measured else NAN, h, h, h * rng.random(), u)
        if k % 900 > 450:  # somebody says what acts, and what is known of the load
            acting, fed = 0.7 * u + others.random(), others.gauss(0.0, 0.1)
            sample = sample._replace(
                applied=acting,
                applied_age=h * others.random(),
                sent=u,
                feed_forward=fed,
                downstream=acting + 0.1 * others.random(),
                foreign=others.random() > 0.5,
            )
        yield sample, reference, k % 700 > 100


@pytest.mark.parametrize(
    ('old', 'new'),
    [('G = 9.8', 'G = 9.9'), ('x * G', 'x + G'), ('import sin', 'import cos as sin')],
)
def test_what_is_on_disk_is_known_by_its_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old: str, new: str
) -> None:
    source = 'from math import sin\nG = 9.8\ndef f(x):\n    return sin(x * G)\n'
    monkeypatch.syspath_prepend(tmp_path)
    found = []
    for text in (source, source, source.replace(old, new)):
        (tmp_path / 'mine.py').write_text(text)
        monkeypatch.delitem(sys.modules, 'mine', raising=False)
        invalidate_caches()
        function = import_module('mine').f
        assert _named_by_source(function, ())
        found.append(function.__qualname__)
    assert found[0] == found[1] != found[2]


def test_what_has_no_source_file_is_not_kept_on_disk() -> None:
    names: dict[str, Any] = {'__name__': 'typed'}
    exec('def f(x):\n    return x\n', names)
    assert not _named_by_source(names['f'], ())
