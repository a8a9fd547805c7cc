"""What recorders leave: several at once, ended properly, killed, and on a full disk."""

from __future__ import annotations

import json
from pathlib import Path
import resource
import signal
from typing import Any

from nadrc_ros.cli.app import app
from nadrc_ros.records.recording import read_samples, SAMPLES, SUMMARY
from probe import NodeProcess, Probe, Processes
from typer.testing import CliRunner

RATE = 20.0  # so low that a file's buffer lasts for longer than a second
PLANT: dict[str, Any] = {
    'rate': RATE,
    'plant': 'chain',
    'order': 1,
    'noise_variance': 1e-4,
    'disturbance': 'sine',
    'disturbance_amplitude': 5.0,
}
LIMITS: dict[str, Any] = {'command_min': -3.0, 'command_max': 3.0}
DERIVED = ('stop', 'samples_lost', 'samples_lost_by_signal', 'commands_before', 'complete')


def recorders(start: Processes, directory: Path, count: int) -> dict[str, NodeProcess]:
    """Start recorders with the same place to write to, all at once."""
    settings: dict[str, Any] = {'rate': RATE, 'directory': str(directory), **LIMITS}
    settings |= {'inputs': 'reference measurement command tracking', 'error': 'tracking'}
    return {
        name: start('recorder', '-r', f'__node:={name}', **settings)
        for name in (f'recorder_{i}' for i in range(count))
    }


def folder_of(process: NodeProcess) -> Path:
    return Path(process.said.partition('recording to ')[2].split()[0])


def rows_in(folder: Path) -> int:
    return (folder / SAMPLES).read_bytes().count(b'\n') - 1


def test_however_its_recorder_ends_a_run_can_be_read_and_summarised(
    probe: Probe, start: Processes
) -> None:
    directory = start.directory / 'runs'
    others = [
        start('plant', **PLANT),
        start('controller', rate=RATE, plant_order=1, **LIMITS),
    ]
    nodes = recorders(start, directory, 3)
    commands, measurements = probe.listen('command'), probe.listen('measurement')
    probe.wait_until(lambda: all('recording to' in node.said for node in nodes.values()))
    ended, killed, full = nodes.values()
    folders = [folder_of(node) for node in nodes.values()]
    assert len(set(folders)) == 3 == len(list(directory.iterdir()))
    probe.wait_until(lambda: all(rows_in(folder) >= 60 for folder in folders))
    probe.wait_until(lambda: len(set(measurements)) > 60)  # the plant has heard a command, too

    size = (folders[2] / SAMPLES).stat().st_size + 1000
    resource.prlimit(full.popen.pid, resource.RLIMIT_FSIZE, (size, size))
    assert probe.end_of(full) == 1
    news = ('recording to', 'nothing comes on', 'samples come on')
    said = [line for line in full.own_lines if not any(words in line for words in news)]
    assert len(said) == 1
    assert f'{folders[2]}: cannot write: File too large' in said[0]

    rows = rows_in(folders[1])
    probe.wait_until(lambda: rows_in(folders[1]) > rows)  # a buffer may have been full just now
    n = len(measurements)
    probe.wait_until(lambda: len(measurements) >= n + 1.5 * RATE)
    killed.signal(signal.SIGKILL)
    assert killed.end() == -signal.SIGKILL
    left = read_samples(folders[1])
    assert measurements[::-1].index(left['measurement'][-1]) <= RATE
    assert left['time'] == sorted(set(left['time']))

    ended.signal(signal.SIGTERM)
    assert probe.end_of(ended) == 0
    m = len(commands)
    probe.wait_until(lambda: len(commands) >= m + 20)  # nobody else minds
    assert all(node.running for node in others)

    recorded = json.loads((folders[0] / SUMMARY).read_text())
    assert recorded['complete'] and recorded['metrics']['saturated_fraction'] > 0.0
    (folders[0] / SUMMARY).unlink()
    assert not any((folder / SUMMARY).exists() for folder in folders)
    for folder in folders:
        done = CliRunner().invoke(app, ['summarise', str(folder)])
        assert done.exit_code == 0, done.output
        summary = json.loads((folder / SUMMARY).read_text())
        assert summary['rows'] == len(read_samples(folder)['time']) >= 60
        assert ('cut short' in done.output) == (summary['complete'] is False)
    rebuilt = json.loads((folders[0] / SUMMARY).read_text())
    assert _without(rebuilt) == _without(recorded)


def _without(summary: dict[str, Any]) -> dict[str, Any]:
    """Leave out what the samples do not tell."""
    return {key: value for key, value in summary.items() if key not in DERIVED}
