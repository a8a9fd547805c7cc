"""The robustness bench: what it measures of this package, and that the rivalry is a fair one."""

from __future__ import annotations

import json
from pathlib import Path

from bench.robustness import (
    CASES,
    FAULT,
    judge,
    measure,
    NO_FAULT,
    OURS,
    Ours,
    PERIOD,
    PyAdrc,
    RECOVERY,
    Row,
    run,
    write,
)
import numpy as np
import pytest

SEED = 5


@pytest.fixture(scope='module')
def rows() -> list[Row]:
    return measure(OURS, SEED)


def test_ours_recovers_from_every_fault_with_good_commands(rows: list[Row]) -> None:
    assert len(rows) == len(CASES) * len(OURS)
    for row in rows:
        assert row.recovered, row
        assert row.recovery_time is not None and row.recovery_time < RECOVERY, row
        assert row.bad_commands == 0, row


def test_the_file_has_the_keys_that_are_documented(rows: list[Row], tmp_path: Path) -> None:
    path = tmp_path / 'bench' / 'robustness.json'
    write(rows, SEED, path)
    document = json.loads(path.read_text(encoding='utf-8'))
    assert set(document) == {'format', 'settings', 'rows'}
    assert document['settings']['seed'] == SEED
    for row in document['rows']:
        assert list(row) == [
            'fault',
            'controller',
            'guarded',
            'recovered',
            'recovery_time',
            'peak_error',
            'worst_step',
            'bad_commands',
        ]


@pytest.mark.parametrize('fault', ('none', 'one spike of 1000', 'sensor stuck for 1 s'))
def test_pyadrc_is_the_same_law_with_the_same_tuning(fault: str) -> None:
    ours, theirs = run(Ours(), CASES[fault], SEED), run(PyAdrc(False), CASES[fault], SEED)
    started = ours.time > FAULT  # pyadrc starts with a bump, whose trace is then gone
    assert np.allclose(ours.command[started], theirs.command[started], rtol=0.0, atol=1e-6)


def test_what_never_recovers_is_told_so() -> None:
    name, case = ('pyadrc', False), CASES['one NaN']
    healthy, faulty = run(PyAdrc(False), NO_FAULT, SEED), run(PyAdrc(False), case, SEED)
    row = judge(name, 'one NaN', case, faulty, healthy)
    assert not row.recovered and row.recovery_time is None
    assert row.bad_commands > RECOVERY / PERIOD
