"""The trace of a controller in real time: the library gives the published commands again."""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path
import resource
import signal
from typing import Any

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.step_trace import replay
from probe import Probe, Processes

RATE = 200.0
PLANT: dict[str, Any] = {'rate': RATE, 'noise_variance': 1e-4, 'disturbance': 'sine'}


def published(path: Path) -> list[float]:
    """Return what the controller of a trace sends: every tick, unless disabled and at rest."""
    controller = Controller(ControllerSettings(), enabled=True)
    commands = []
    for line in path.read_text().splitlines():
        record = json.loads(line)
        if 'settings' in record:
            settings = ControllerSettings(**record['settings'])
            if sum(controller.counts.values()) == 0:
                controller = Controller(settings)
            else:
                controller.retune(settings)
        elif 'reset' in record:
            controller.reset()
        elif 'disabled' in record:
            controller.enabled = False
        else:
            quiet = controller.quiet
            controller.enabled = record['enabled']
            command = controller.tick(
                record['y'],
                record['dt'],
                elapsed=record['elapsed'],
                age=record['age'],
                reference=record['r'],
            )
            if not quiet or not controller.quiet:
                commands.append(command)
    return commands


def test_p18_a_live_run_replays_to_the_published_commands(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    trace = tmp_path / 'trace.jsonl'
    commands = probe.listen('command')
    start('plant', **PLANT)
    start('reference', rate=RATE)
    controller = start('controller', rate=RATE, trace=str(trace), safe_command=0.5)

    def more(count: int) -> None:
        n = len(set(commands))  # as many in control
        probe.wait_until(lambda: len(set(commands)) > n + count)

    more(100)
    assert probe.set('controller', inner_bandwidth=60.0, b0=1.5, command_max=8.0) == [''] * 3
    more(60)
    assert probe.set('controller', structure='cascade', command_rate_limit=900.0) == ['', '']
    more(60)
    assert probe.trigger('controller/reset').success
    more(60)
    assert probe.enable(False).success
    probe.wait_until(lambda: commands[-1] == 0.5)
    probe.wait_until(lambda: probe.said()[-1][2]['mode'] == 'safe')
    assert probe.enable().success
    more(60)
    assert probe.set('controller', structure='nested', levels=4) == ['', '']
    more(60)
    controller.signal(signal.SIGINT)
    assert probe.end_of(controller) == 0

    pairs = list(replay(trace))
    assert len(pairs) > 400
    assert [recorded for recorded, _ in pairs] == [again for _, again in pairs]
    sent = published(trace)
    # the last is the safe command of the end, which no tick gave
    probe.wait_until(lambda: commands.numbers[-1] == len(sent) + 1)
    assert list(commands) == [([*sent, 0.5])[number - 1] for number in commands.numbers]
    assert len(set(sent)) > 200
    assert all(map(isfinite, sent))


def test_a_trace_that_was_cut_short_replays_up_to_there(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    trace = tmp_path / 'trace.jsonl'
    commands = probe.listen('command')
    start('plant', **PLANT)
    controller = start('controller', rate=RATE, trace=str(trace))
    probe.wait_until(lambda: len(commands) > 300)
    controller.signal(signal.SIGKILL)
    controller.end()
    whole = trace.read_text()
    trace.write_text(whole[: whole.rindex('\n') - 10])
    pairs = list(replay(trace))
    assert len(pairs) > 50
    assert all(recorded == again for recorded, again in pairs)


def test_a_full_disk_ends_the_trace_and_not_the_loop(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    trace = tmp_path / 'trace.jsonl'
    commands = probe.listen('command')
    start('plant', **PLANT)
    controller = start('controller', rate=RATE, trace=str(trace))
    probe.wait_until(lambda: len(commands) > 20)
    size = (trace.stat().st_size or 1) + 20_000
    resource.prlimit(controller.popen.pid, resource.RLIMIT_FSIZE, (size, size))
    probe.wait_until(lambda: 'the trace ends' in controller.said)
    n = len(commands)
    probe.wait_until(lambda: len(commands) > n + 300)
    controller.signal(signal.SIGINT)
    assert probe.end_of(controller) == 0
    assert controller.said.count('the trace ends') == 1
    assert 'File too large' in controller.said
    assert 'Traceback' not in controller.said


def test_an_old_trace_is_not_overwritten(start: Processes, tmp_path: Path) -> None:
    trace = tmp_path / 'trace.jsonl'
    trace.write_text('kept')
    controller = start('controller', trace=str(trace))
    assert controller.end() == 1
    assert str(trace) in controller.said
    assert 'Traceback' not in controller.said
    assert trace.read_text() == 'kept'
