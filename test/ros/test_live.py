"""A scenario as real processes, as `nadrc demo` runs it."""

from __future__ import annotations

import os
from pathlib import Path
import signal

from nadrc_ros.demo.live import run_realtime
from nadrc_ros.scenario import loads
from probe import NodeProcess, Probe, Processes
import pytest

# What a busy machine delays by less than a period, nobody counts.
ATTEMPTS = 3
SCENARIO = """
plant: {name: paper, a3: 0.2}
reference: {signal: cosine, frequency: 0.5}
noise: {variance: 1e-6}
rate: 100
duration: 2.5
controllers:
  one: {structure: conventional, inner_bandwidth: 20}
  two: {inner_bandwidth: 20}
retune: [{time: 1, inner_bandwidth: 25}]
faults: {measurement: [{kind: silent, duration: 0.3}]}  # from the start on
"""


def children_in(folder: Path) -> list[str]:
    """Return the command lines of living processes that name a file in this folder."""
    found = []
    for process in Path('/proc').glob('[0-9]*'):
        try:
            words = (process / 'cmdline').read_bytes().decode(errors='replace')
        except OSError:
            continue
        if str(folder) in words and int(process.name) != os.getpid():
            found.append(words.replace('\0', ' '))
    return found


def test_two_controllers_run_side_by_side_and_are_retuned(tmp_path: Path) -> None:
    scenario = loads(SCENARIO)
    expected = {name: scenario.run(name).metrics.itae for name in ('one', 'two')}
    for attempt in range(ATTEMPTS):
        seen: list[float] = []
        folder = tmp_path / str(attempt)
        runs = run_realtime(scenario, folder, lambda now, _: seen.append(now), None)  # noqa: B023
        assert seen == sorted(seen)
        for run in runs.values():
            # On a busy machine the plant misses periods, or begins with one that is late.
            assert 100 <= run.summary['rows'] <= run.summary['periods'] <= 252
            assert run.summary['complete']
            assert run.diagnostics['periods'] >= 100
            assert run.diagnostics['latency_median_ms'] < 100.0
        assert children_in(tmp_path) == []
        found = {name: run.summary['metrics']['itae'] for name, run in runs.items()}
        print(found, [run.diagnostics for run in runs.values()])
        lost = sum(run.summary['samples_lost'] for run in runs.values())
        if not lost and found == pytest.approx(expected, rel=0.5):
            return
    raise AssertionError(f'{ATTEMPTS} times {lost} lost, or {found} and not {expected}')


def demo(start: Processes, *arguments: str) -> tuple[NodeProcess, Path]:
    file = start.directory / 'long.yaml'
    file.write_text(SCENARIO.replace('duration: 2.5', 'duration: 60'))
    out = start.directory / 'out'
    command = ('-m', 'nadrc_ros.cli', 'demo', str(file), '--out', str(out), *arguments)
    return start.run('demo', *command), out


@pytest.mark.parametrize('moment', ['starting', 'running'])
def test_interrupted_a_demo_ends_with_130_and_leaves_nobody(
    moment: str, probe: Probe, start: Processes
) -> None:
    process, out = demo(start)
    if moment == 'starting':
        probe.wait_until(lambda: len(children_in(out)) >= 3)  # with the demo itself
    else:
        probe.wait_until(lambda: list(out.glob('two/runs/*/samples.csv')))
        probe.wait_until(lambda: len(children_in(out)) == 9)  # with the demo itself
    process.signal(signal.SIGINT)
    if moment == 'running':  # stopping takes a while then: an impatient user asks again
        probe.spin(0.05)
        process.signal(signal.SIGINT)
    assert process.end() == 130
    assert 'Traceback' not in process.said
    probe.wait_until(lambda: not children_in(out))
