"""The bench of the start-up: it runs, once, and writes the keys that it documents."""

from __future__ import annotations

import json
from pathlib import Path

from bench import start_up
import numpy as np


def test_start_up_writes_its_times(tmp_path: Path) -> None:
    start_up.main(starts=1, folder=tmp_path)
    figures = json.loads((tmp_path / 'bench.json').read_text(encoding='utf-8'))['start_up']
    with np.load(tmp_path / 'raw' / 'start_up.npz') as samples:
        assert set(samples) == {'first_command_s', 'bare_node_s', 'own_imports_s'}
        assert set(figures) == {
            *samples,
            'fastest_first_command_s',
            'slowest_first_command_s',
        }
    assert 0.0 < figures['own_imports_s'] < figures['first_command_s']
