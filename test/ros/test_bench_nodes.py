"""The benches of the nodes: each of them runs, in small, and writes the keys that it documents."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from bench import axes, ros_latency, start_up
import numpy as np


def written(part: str, folder: Path) -> tuple[dict[str, Any], set[str]]:
    """Return the figures of a part and the names of its samples."""
    document = json.loads((folder / 'bench.json').read_text(encoding='utf-8'))
    with np.load(folder / 'raw' / f'{part}.npz') as samples:
        return document[part], set(samples)


def test_start_up_writes_its_times(tmp_path: Path) -> None:
    start_up.main(starts=1, folder=tmp_path)
    figures, samples = written('start_up', tmp_path)
    assert samples == {'first_command_s', 'bare_node_s', 'own_imports_s'}
    assert set(figures) == {*samples, 'fastest_first_command_s', 'slowest_first_command_s'}
    assert 0.0 < figures['own_imports_s'] < figures['first_command_s']


def test_ros_latency_compares_with_an_echo_at_the_same_time(tmp_path: Path) -> None:
    ros_latency.main(rates=(100,), turns=1, seconds=0.5, folder=tmp_path)
    figures, samples = written('ros_latency', tmp_path)
    assert set(figures) == {'100'} and set(figures['100']) == {'nadrc', 'echo'}
    for row in figures['100'].values():
        assert set(row) == {'median_ms', 'p99_ms', 'cpu_percent', 'missed'}
        assert 0.0 < row['median_ms'] <= row['p99_ms']
    assert '100.nadrc.ms' in samples


def test_axes_compares_with_as_many_bare_nodes(tmp_path: Path) -> None:
    axes.main(counts=(2,), turns=1, settle=0.1, seconds=0.5, folder=tmp_path)
    figures, samples = written('axes', tmp_path)
    assert set(figures['2']) == {'missed', 'cpu_percent', 'echo'}
    assert set(figures['2']['echo']) == {'missed', 'cpu_percent'}
    assert 0.0 <= figures['2']['missed'] < 100.0
    assert '2.echo.late_ms' in samples
