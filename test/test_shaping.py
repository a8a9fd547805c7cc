"""Values that no neighbour in time allows for, and logs that have them."""

from __future__ import annotations

from json import loads
from pathlib import Path

from bench.other_plants import CASES
from hypothesis import given, settings, strategies
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.cli.app import app
from nadrc_ros.records.shaping import outliers
from nadrc_ros.tuning.identification.log import log_of, seems_swapped
import numpy as np
import pytest
from typer.testing import CliRunner

H, N = 0.01, 3000
TIME = H * np.arange(N)
COMMAND = np.sign(np.sin(0.6 * np.pi * TIME))


def measured(noise: float) -> np.ndarray:
    """Return y of y' = 2 u - y."""
    y = np.zeros(N)
    decay = np.exp(-H)
    for k in range(N - 1):
        y[k + 1] = decay * y[k] + 2.0 * (1.0 - decay) * COMMAND[k]
    return y + noise * np.random.default_rng(0).normal(size=N)


@settings(max_examples=60)
@given(
    steps=strategies.lists(strategies.floats(-1.0, 1.0), min_size=100, max_size=300),
    held=strategies.integers(1, 20),
)
def test_a_signal_has_no_outlier_where_a_step_of_its_own_is_as_large(
    steps: list[float], held: int
) -> None:
    """Any motion of steps within 1, of which one of 1 is with the values that are not suspects."""
    values = np.repeat(np.cumsum([*steps, 1.0, *([0.0] * 400)]), held)
    assert not outliers(values).any()


@pytest.mark.parametrize('noise', [0.0, 1e-3])
@pytest.mark.parametrize('wrong', [1e6, 85.0, -127.0, 65535.0, 10.0])
@pytest.mark.parametrize(
    'rows', [[0], [1500], [N - 1], [7, 507, 1007, 1100, 2001], list(range(1600, 1610))]
)
def test_single_values_and_short_bursts_are_found_and_nothing_else(
    noise: float, wrong: float, rows: list[int]
) -> None:
    values = measured(noise)
    values[rows] = wrong
    assert np.flatnonzero(outliers(values)).tolist() == rows


def identified(folder: Path, y: np.ndarray, u: np.ndarray, *more: str) -> tuple[int, str]:
    path = folder / 'log.csv'
    rows = (f'{a:.2f},{float(b)!r},{float(c)!r}' for a, b, c in zip(TIME, y, u))
    path.write_text('t,y,u\n' + '\n'.join(rows) + '\n')
    columns = ('--time', 't', '--measurement', 'y', '--command', 'u')
    done = CliRunner().invoke(app, ['identify', str(path), *columns, *more])
    return done.exit_code, done.output


@pytest.mark.parametrize('wrong', [1e6, 65535.0])
def test_one_wrong_row_is_named_and_left_out(wrong: float, tmp_path: Path) -> None:
    y = measured(1e-3)
    y[1500:2600:25] = wrong
    json = tmp_path / 'found.json'
    code, said = identified(tmp_path, y, COMMAND, '--order', '1', '--json', str(json))
    assert code == 0, said
    assert f'the measurement {wrong:g} at 15 s, ' in said and ' and 41 more' in said
    ((b0,),) = [line.split()[1:2] for line in said.splitlines() if line.startswith('b0 ')]
    assert float(b0) == pytest.approx(2.0, rel=0.02)
    assert f'the measurement {wrong:g} at 15 s, ' in loads(json.read_text())['doubts'][0]


def test_a_log_of_many_wrong_rows_is_refused(tmp_path: Path) -> None:
    y = measured(1e-3)
    y[::7] = 65535.0
    code, said = identified(tmp_path, y, COMMAND)
    assert code == 1 and '14 % of the periods have no measurement' in said


@pytest.mark.parametrize('noise', [0.0, 1e-3])
def test_columns_that_are_swapped_are_doubted(noise: float, tmp_path: Path) -> None:
    json = tmp_path / 'found.json'
    more = ('--order', '1', '--json', str(json))
    code, said = identified(tmp_path, COMMAND, measured(noise), *more)
    assert 'are command and measurement swapped?' in said
    assert code or any('swapped?' in doubt for doubt in loads(json.read_text())['doubts'])


def test_no_log_of_the_bench_seems_swapped() -> None:
    refused = set()
    for name, case in CASES.items():
        try:
            log = log_of(case.log(seed=0))
        except UserError:
            refused.add(name)
        else:
            assert not seems_swapped(log), name
    assert len(refused) < 0.2 * len(CASES), refused
