"""Exports as C: the bits of Python, and its promises, through the compiled code."""

from __future__ import annotations

from collections.abc import Iterator
from ctypes import CDLL
import hashlib
from math import inf, isfinite, nan
from pathlib import Path
import subprocess
from typing import Any

from export_helpers import (
    answered,
    compiled,
    export_of,
    InC,
    measured,
    RATE,
    SHAPES,
    STRICT,
    told,
    twin_of,
    write,
)
from hypothesis import given
from hypothesis import strategies as st
from law_helpers import at_least
from nadrc_ros.adrc.errors import SettingError, UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Cause, Mode, Status
from nadrc_ros.cli.app import app
from nadrc_ros.cli.export import OF_THE_NODE
from nadrc_ros.export.exportable import exact_period, LONGEST_GAP, NOT_EXPORTED
from nadrc_ros.export.files import Export
from nadrc_ros.export.vectors import Call, DISABLE, ENABLE, INIT, life, NO_SAMPLE, STEP
from nadrc_ros.nodes.loop_settings import LoopSettings
from nadrc_ros.ros.pacing import PacingSettings
import numpy as np
import pytest
from typer.testing import CliRunner

_NUMBERS = st.one_of(
    st.floats(-3.0, 3.0),
    st.floats(-3.0, 3.0),
    st.sampled_from((nan, inf, -inf, 1e16, -1e300, 1e14, 1.0, 1.0, 0.0)),
)
_ACTIONS = st.sampled_from((STEP,) * 12 + (NO_SAMPLE,) * 3 + (ENABLE, DISABLE, INIT))
_TIMES = st.sampled_from((0.005, 0.005, 0.005, 0.0031, 0.02, 0.3, 1e-10))


@st.composite
def calls_of(draw: st.DrawFn, shape: str) -> list[Call]:
    """Return a few calls, some of them repeated: a silence, or samples that stand still."""
    references = 1 + export_of(shape).settings.received_derivatives
    calls: list[Call] = []
    for _ in range(draw(st.integers(1, 12))):
        reference = tuple(draw(_NUMBERS) for _ in range(references)) * draw(st.booleans())
        applied = draw(st.sampled_from((nan, nan, nan, 0.5, 25.0, 1e16)))
        dt = draw(_TIMES) if measured(shape) else 0.0
        call = Call(draw(_ACTIONS), draw(_NUMBERS), reference, applied, dt)
        calls += [call] * draw(st.sampled_from((1, 1, 2, 3, 5, 9, 25)))
    return calls


@pytest.fixture(scope='module')
def library(tmp_path_factory: pytest.TempPathFactory) -> CDLL:
    folder = tmp_path_factory.mktemp('export')
    for shape in SHAPES:
        write(export_of(shape), folder)
    sources = [f'{shape}.c' for shape in SHAPES]
    built = compiled(folder, '-O0', *STRICT, '-fPIC', '-shared', *sources, '-o', 'all.so', '-lm')
    assert built.returncode == 0, built.stderr
    return CDLL(str(folder / 'all.so'))


@pytest.fixture(scope='module')
def nested(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp('nested')
    write(Export(settings=ControllerSettings(max_dt=0.1), rate=1000.0, ticks=3000), folder)
    yield folder


@pytest.mark.parametrize('shape', SHAPES)
def test_the_c_has_the_bits_of_python(shape: str, library: CDLL) -> None:
    in_c, twin = InC(library, shape), twin_of(shape)

    def compare(calls: list[Call]) -> None:
        for call in (Call(INIT, nan, (), nan), *calls):
            answered(in_c, call)
            answered(twin, call)
            expected = told(twin)
            assert in_c.outcome() == expected[1:], call
            if call.action in (STEP, NO_SAMPLE):
                assert in_c.command.hex() == expected.command.hex(), call
        controller = twin.controller
        assert in_c.estimates() == (
            controller.output_estimate.hex(),
            controller.total_disturbance.hex(),
        )

    at_least(15)(given(calls_of(shape))(compare))()
    calls, _ = life(export_of(shape).settings, 0.005, measured(shape), 1500)
    compare(calls)


@pytest.mark.parametrize('shape', ('nested', 'five_td', 'measured'))
def test_p01_a_bad_measurement_leaves_the_estimates_in_c(shape: str, library: CDLL) -> None:
    in_c = InC(library, shape)
    calls, _ = life(export_of(shape).settings, 0.005, measured(shape), 300)
    bad = st.sampled_from((nan, inf, -inf, 2e15, -1e300))

    def check(cut: int, y: float) -> None:
        for call in calls[:cut]:
            answered(in_c, call)
        before = in_c.estimates()
        in_c.step(y, None, nan, 0.005)
        assert in_c.estimates() == before
        assert in_c.outcome()[0] == Status.NO_MEASUREMENT

    at_least(15)(given(st.integers(1, 300), bad)(check))()


@pytest.mark.parametrize('shape', SHAPES)
def test_p02_p03_p05_whatever_comes_the_command_of_the_c_is_within_its_limits(
    shape: str, library: CDLL
) -> None:
    in_c, settings = InC(library, shape), export_of(shape).settings
    rate_limit = settings.command_rate_limit

    def check(calls: list[Call]) -> None:
        in_c.init(nan, nan)
        before = settings.safe_command
        for call in calls:
            answered(in_c, call)
            if call.action == INIT:
                before = nan
            if call.action not in (STEP, NO_SAMPLE):
                continue
            u = in_c.command
            assert isfinite(u) and settings.command_min <= u <= settings.command_max
            known = before == before and not isfinite(call.applied)
            if rate_limit > 0.0 and known:  # where another acts, the change may count from that
                change = rate_limit * (call.dt if measured(shape) else 1.0 / RATE)
                assert abs(u - before) <= change + 1e-9
            before = u

    at_least(8)(given(calls_of(shape))(check))()


@pytest.mark.parametrize('shape', ('nested', 'conventional', 'measured'))
def test_p04_after_bad_samples_the_law_in_c_is_back_within_the_good_ones(
    shape: str, library: CDLL
) -> None:
    in_c, good = InC(library, shape), export_of(shape).settings.good_samples

    def check(bad: list[float]) -> None:
        in_c.init(nan, 0.0)
        for y in [0.1] * good + bad * 12:  # some are beyond the timeout of the measurement
            in_c.step(y, (0.0, 0.0, 0.0), nan, 0.005)
        for _ in range(good):
            in_c.step(0.1, (0.0, 0.0, 0.0), nan, 0.005)
        assert in_c.outcome()[1:] == (Mode.OK, Cause.NONE)

    at_least(15)(
        given(st.lists(st.sampled_from((nan, inf, 1e16)), min_size=1, max_size=5))(check)
    )()


@pytest.mark.parametrize('single', (False, True))
def test_warnings_are_errors_and_the_vectors_pass(single: bool, tmp_path: Path) -> None:
    nested = tmp_path
    settings = ControllerSettings(max_dt=0.1, command_rate_limit=200.0, error_based=True)
    write(Export(settings=settings, rate=1000.0, single=single, ticks=2000), nested)
    built = compiled(nested, '-O2', *STRICT, 'nadrc.c', 'self_test.c', '-o', 'self_test')
    assert built.returncode == 0, built.stderr
    done = subprocess.run([nested / 'self_test'], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    size = int(done.stdout.split()[-2])
    assert f'Size: {size} bytes for each controller' in (nested / 'nadrc.h').read_text()


def test_the_vectors_see_the_last_digit_of_a_gain(nested: Path, tmp_path: Path) -> None:
    for file in nested.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    source = (nested / 'nadrc.c').read_text()
    begin = source.index('static const double GAINS')
    gain = source[source.index('0x1.', begin) :].partition('p')[0]
    last = '0' if gain[-1] != '0' else '1'
    (tmp_path / 'nadrc.c').write_text(source.replace(gain, gain[:-1] + last))
    assert compiled(tmp_path, 'nadrc.c', 'self_test.c', '-o', 'self_test').returncode == 0
    done = subprocess.run([tmp_path / 'self_test'], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and 'differs: command' in done.stdout


def test_a_compiler_that_contracts_is_caught(nested: Path) -> None:
    if ' fma ' not in Path('/proc/cpuinfo').read_text():
        pytest.skip('this processor has no fused multiply-add')
    built = compiled(
        nested, '-O2', '-mfma', '-ffp-contract=fast', 'nadrc.c', 'self_test.c', '-o', 'contracted'
    )
    assert built.returncode == 0, built.stderr
    done = subprocess.run([nested / 'contracted'], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and '-ffp-contract=off' in done.stdout


@pytest.mark.parametrize('option', ('-ffast-math', '-Ofast', '-ffinite-math-only'))
def test_fast_mathematics_is_refused(option: str, nested: Path) -> None:
    refused = compiled(nested, option, '-c', 'nadrc.c', '-o', 'fast.o')
    assert refused.returncode != 0 and 'NaN is a bad sample here' in refused.stderr


def test_at_a_fixed_rate_the_c_needs_no_library(nested: Path) -> None:
    assert compiled(nested, '-O2', '-c', 'nadrc.c').returncode == 0
    named = ['nm', '--undefined-only', 'nadrc.o']
    assert subprocess.check_output(named, cwd=nested, text=True) == ''


@pytest.mark.parametrize('rate', (200.0, 1000.0, 1e3 / 3.0, 44100.0))
@pytest.mark.parametrize('single', (False, True))
def test_sums_of_periods_are_exact(rate: float, single: bool) -> None:
    period = exact_period(rate, single)
    assert abs(period * rate - 1.0) < (1e-4 if single else 1e-12)
    kind = np.float32 if single else np.float64
    total = kind(0.0)
    for k in range(1, LONGEST_GAP + 1):
        total = kind(total + kind(period))
        assert float(total) == k * period and int(total / kind(period)) == k


@pytest.mark.parametrize(
    ('settings', 'rate', 'message'),
    [
        ({'plant_poles': (-1.0,)}, 200.0, 'plant_poles'),
        ({'disturbance_frequencies': (3.0,)}, 200.0, 'disturbance_frequencies'),
        ({'b0_table': (0.0, 1.0, 1.0, 2.0)}, None, 'b0_table'),
        ({'input_delay': 0.1}, None, 'input_delay'),
        ({'measurement_period': 360.0}, 200.0, 'measurement_period'),
        ({'error_deadband': 0.1}, 200.0, 'error_deadband'),
        ({'feed_forward_timeout': 0.1}, 200.0, 'feed_forward_timeout'),
        ({'applied_timeout': 0.1}, 200.0, 'applied_timeout'),
        ({'startup_time': 0.1}, 200.0, 'startup_time = 0.1: must be 0 at a fixed rate'),
        ({'max_dt': 10.0}, 200.0, 'max_dt = 10.0: must be at most 1023 periods'),
        ({'max_dt': 0.005}, 200.0, 'max_dt'),
        ({}, 1e6, 'rate = 1000000.0'),
    ],
)
def test_what_is_not_exported_is_refused_by_name(
    settings: dict[str, Any], rate: float | None, message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        Export(settings=ControllerSettings(**settings), rate=rate)


PARAMETERS = """
/**/controller:
  ros__parameters:
    max_dt: 0.1
    wiring.measurement: /x std_msgs/msg/Float64 data
"""


def nadrc(*arguments: object) -> Any:
    return CliRunner().invoke(app, [*map(str, arguments)])


@pytest.mark.parametrize(
    ('settings', 'rate', 'message'),
    [
        ({}, None, 'needs a fixed rate'),
        ({'feedback': 'fal'}, 1000.0, 'feedback'),
        ({'structure': 'nonlinear'}, 1000.0, 'structure'),
        ({'outer_bandwidth': 0.5}, 1000.0, 'outer_bandwidth = 0.5'),
        ({'pole_ratios': (1.0, 0.01)}, 1000.0, 'inner_bandwidth'),
        ({'hold_time': 100.0}, 1000.0, 'hold_time'),
    ],
)
def test_what_float_would_drift_with_is_refused_by_name(
    settings: dict[str, Any], rate: float | None, message: str
) -> None:
    with pytest.raises(UserError, match=message):
        Export(settings=ControllerSettings(max_dt=0.1, **settings), rate=rate, single=True)


def test_the_example_for_linux_compiles_and_controls(tmp_path: Path) -> None:
    example = Path(__file__).parents[1] / 'examples' / 'c'
    done = nadrc('export', 'c', example / 'yaw.yaml', '--out', tmp_path, '--name', 'yaw')
    assert done.exit_code == 0, done.output
    source = str(example / 'linux_loop.c')
    built = compiled(tmp_path, '-O2', *STRICT, '-I.', source, 'yaw.c', '-o', 'loop', '-lm')
    assert built.returncode == 0, built.stderr
    done = subprocess.run([tmp_path / 'loop', '0.6'], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_every_setting_is_exported_or_refused() -> None:
    assert NOT_EXPORTED.keys() <= declared(ControllerSettings).keys()
    assert set(OF_THE_NODE) == {
        *declared(PacingSettings),
        *declared(LoopSettings),
        *('use_sim_time', 'start_type_description_service'),
    }


def test_a_parameter_file_is_exported(tmp_path: Path) -> None:
    file, out = tmp_path / 'robot.yaml', tmp_path / 'out'
    file.write_text(PARAMETERS)
    done = nadrc('export', 'c', file, '--out', out, '--rate', 500, '--name', 'yaw')
    assert done.exit_code == 0, done.output
    assert {'yaw.c', 'yaw.h', 'self_test.c', 'README.md'} <= {each.name for each in out.iterdir()}
    header = (out / 'yaw.h').read_text()
    parameters = (out / 'README.md').read_text().partition('```yaml\n')[2].partition('```')[0]
    assert hashlib.sha256(parameters.encode()).hexdigest() in header
    assert 'double yaw_step(yaw_state *self' in header and '500 Hz' in header


@pytest.mark.parametrize(
    ('more', 'arguments', 'message'),
    [
        ('', (), 'give --rate or --measured-dt'),
        ('', ('--rate', 5000, '--measured-dt'), 'either this or --rate'),
        ('    rate: 500.0\n', ('--rate', 0), '--rate = 0'),
        *(
            ('', ('--rate', 500, '--name', taken), f'{taken}.h is another file')
            for taken in ('self_test', 'test_vectors', 'math')
        ),
        ('    inner_bandwith: 3.0\n', ('--rate', 500), 'did you mean inner_bandwidth?'),
        ('    reference_from: x\n', ('--rate', 500), 'reference_from'),
        ('    enabled_at_start: false\n', ('--rate', 500), 'enabled_at_start'),
        ('    startup_time: 0.2\n', ('--rate', 500), 'startup_time = 0.2'),
        ('', ('--rate', 500, '--node', 'yaw'), 'there is none of that name'),
        ('', ('--rate', 500, '--name', '1x'), 'no digit first'),
    ],
)
def test_a_bad_request_is_refused_in_a_line(
    more: str, arguments: tuple[object, ...], message: str, tmp_path: Path
) -> None:
    file, out = tmp_path / 'robot.yaml', tmp_path / 'out'
    file.write_text(PARAMETERS + more)
    refused = nadrc('export', 'c', file, '--out', out, *arguments)
    assert refused.exit_code in (1, 2) and 'Traceback' not in refused.output
    assert message in ' '.join(refused.output.split()) and not out.exists()


def test_a_controller_of_a_scenario_is_exported(tmp_path: Path) -> None:
    refused = nadrc('export', 'c', 'demo', '--out', tmp_path)
    assert refused.exit_code == 1 and 'conventional, nested' in ' '.join(refused.output.split())
    done = nadrc('export', 'c', 'demo', '--node', 'nested', '--out', tmp_path)
    assert done.exit_code == 0 and '200 Hz' in done.output
