"""A scenario as real processes, as `nadrc demo` runs it."""

from __future__ import annotations

import os
from pathlib import Path
import re
import signal

from files_helpers import differences, document, files_of
from live_loop import address_in, Page, until
from nadrc_ros.demo.run import run_lockstep, run_realtime
from nadrc_ros.scenario import loads
from nadrc_ros.scenario.user_code import ScenarioError
from probe import NodeProcess, Probe, Processes
import pytest

# What a busy machine delays by less than a period, nobody counts.
ATTEMPTS = 3
# The command comes a little later than at once, and a retune at no whole period.
NEAR = 0.1
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


@pytest.mark.realtime
def test_two_controllers_run_side_by_side_and_are_retuned(tmp_path: Path) -> None:
    scenario = loads(SCENARIO)
    expected = {name: scenario.run(name).metrics.itae for name in ('one', 'two')}
    tried = []
    for attempt in range(ATTEMPTS):
        seen: list[float] = []
        folder = tmp_path / str(attempt)
        runs = run_realtime(scenario, folder, lambda now, _: seen.append(now), None)  # noqa: B023
        assert seen == sorted(seen)
        for run in runs.values():
            # The plant may miss periods, or begin with one that is late.
            assert 100 <= run.summary['rows'] <= run.summary['periods'] <= 252
            assert run.summary['complete']
            assert run.diagnostics['periods'] >= 100
            assert run.diagnostics['latency_median_ms'] < 10.0
        assert children_in(tmp_path) == []
        found = {name: run.summary['metrics']['itae'] for name, run in runs.items()}
        lost = sum(run.summary['samples_lost'] for run in runs.values())
        tried.append((lost, found))
        if not lost and found == pytest.approx(expected, rel=NEAR):
            return
    pytest.fail(f'samples lost and figures of each attempt: {tried}, and not {expected}')


README = (Path(__file__).parents[2] / 'README.md').read_text(encoding='utf-8')


@pytest.mark.parametrize('command', re.findall('^nadrc (demo [^#\n]*)', README, re.MULTILINE))
def test_the_demo_of_the_front_page_runs(command: str, tmp_path: Path, start: Processes) -> None:
    process = start.run('demo', '-m', 'nadrc_ros.cli', *command.split(), '--out', str(tmp_path))
    assert process.end(120.0) == 0, process.said
    found = document(tmp_path / 'summary.json', 'demo')
    assert differences('`summary.json` of a demo', found) == []
    written = {path.name for path in tmp_path.glob('nested/*')} | {'summary.json', 'demo.png'}
    assert written - {'runs'} == files_of('`nadrc demo`')


def demo(start: Processes, *arguments: str) -> tuple[NodeProcess, Path]:
    file = start.directory / 'long.yaml'
    file.write_text(SCENARIO.replace('duration: 2.5', 'duration: 60'))
    out = start.directory / 'out'
    command = ('-m', 'nadrc_ros.cli', 'demo', str(file), '--out', str(out), *arguments)
    return start.run('demo', *command), out


def test_a_cascade_is_refused_before_anything_runs(tmp_path: Path) -> None:
    text = re.sub('retune: .*', '', SCENARIO)
    scenario = loads(re.sub('one: .*', 'first: {}', text).replace('two: {', 'third: {inner: {}, '))
    told: list[str] = []
    with pytest.raises(ScenarioError, match=r'controllers\.third is a cascade'):
        run_lockstep(scenario, tmp_path, told.append)
    with pytest.raises(ScenarioError, match=r'controllers\.third is a cascade'):
        run_realtime(scenario, tmp_path, lambda *_: told.append('a period'), None)
    assert told == [] and not list(tmp_path.iterdir())  # there is no log of a node


@pytest.mark.parametrize('moment', ['starting', 'running'])
def test_interrupted_a_demo_ends_with_130_and_leaves_nobody(
    moment: str, probe: Probe, start: Processes
) -> None:
    process, out = demo(start, '--live')
    if moment == 'starting':
        probe.wait_until(lambda: len(children_in(out)) >= 3)  # with the demo itself
    else:
        probe.wait_until(lambda: list(out.glob('two/runs/*/samples.csv')))
        probe.wait_until(lambda: len(children_in(out)) == 9)  # with the demo itself
        page = Page(address_in(process))
        assert page.hello['node'] == '/one/controller'
        until(lambda: len(page.blocks) > 3)
    process.signal(signal.SIGINT)
    if moment == 'running':  # stopping takes a while then: an impatient user asks again
        probe.spin(0.05)
        process.signal(signal.SIGINT)
    assert process.end() == 130
    assert 'Traceback' not in process.said
    kept = [str(folder) for folder in sorted(out.glob('*/runs/*'))]
    said = 'error: interrupted' + (': the runs are kept in ' if kept else '') + ', '.join(kept)
    assert said in process.said and (kept or moment == 'starting')
    probe.wait_until(lambda: not children_in(out))
    if moment == 'running':
        assert until(lambda: page.closed) and len(re.findall('token=', process.said)) == 2
        with pytest.raises(ConnectionRefusedError):
            page.get('/')


RUNAWAY = """
class Runaway:
    order = states = 1
    b0 = 1.0

    def derivative(self, t, x, u, w, dx):
        dx[0] = 1.0 + u + 1e4 * x[0] * x[0] * x[0]

    def output(self, x):
        return x[0]
"""


def test_figures_of_a_plant_that_diverged_are_said_to_be_of_the_time_before(
    start: Processes,
) -> None:
    (start.directory / 'runaway.py').write_text(RUNAWAY)
    file = start.directory / 'lost.yaml'
    file.write_text(
        'plant: {file: runaway.py}\nreference: constant\nrate: 100\nduration: 0.5\n'
        'limits: {command_min: -0.1, command_max: 0.1}\ncontrollers: {one: {}}\n'
    )
    out = str(start.directory / 'out')
    process = start.run(
        'demo', '-m', 'nadrc_ros.cli', 'demo', str(file), '--lockstep', '--out', out
    )
    assert process.end(120.0) == 0, process.said
    said = 'warning: one: the plant diverged at 0.06 s; the figures are of the time before'
    assert said in process.said
