"""A b0 that comes from a topic, and rest, on the graph."""

from __future__ import annotations

from pathlib import Path
import signal

from nadrc_ros.records.step_trace import replay
from probe import Probe, Processes

RATE = 200.0


def test_b0_follows_its_topic_and_the_loop_rests(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    trace = tmp_path / 'trace.jsonl'
    tell = probe.publisher('b0_variable')
    start('plant', rate=RATE, plant='chain')
    reference = start('reference', rate=RATE, signal='step', start_time=0.5)
    controller = start(
        'controller',
        rate=RATE,
        trace=str(trace),
        b0=2.0,
        b0_table=[0.0, 1.0, 10.0, 3.0],
        b0_source='topic',
        error_deadband=0.01,
    )

    def now(name: str) -> str:
        said = probe.said()
        return str(said[-1][2].get(name, '')) if said else ''

    probe.wait_until(lambda: now('resting') == 'True')  # at the reference
    assert now('b0') == '2'  # until the variable is known
    probe.wait_until(lambda: probe.readers('b0_variable'))
    tell(5.0)
    tell(float('nan'))
    probe.wait_until(lambda: now('b0') == '2')
    tell(2.5)
    probe.wait_until(lambda: now('b0') == '1.5')
    assert probe.set('controller', b0_table=[0.0, 1.0, 5.0, 3.0]) == ['']
    probe.wait_until(lambda: now('b0') == '2')
    (refused,) = probe.set('controller', b0_table=[0.0, 1.0, 5.0, -3.0])
    assert 'b0_table' in refused
    assert probe.set('controller', b0_table=[0.0], b0=1.0, error_deadband=0.0) == [''] * 3
    probe.wait_until(lambda: now('mode') == 'ok' and not now('b0') and not now('resting'))
    reference.signal(signal.SIGINT)
    controller.signal(signal.SIGINT)
    assert probe.end_of(controller) == 0
    commands = list(replay(trace))
    assert [recorded for recorded, _ in commands] == [replayed for _, replayed in commands]


def test_in_lockstep_there_is_no_topic_for_it(probe: Probe, start: Processes) -> None:
    process = start('controller', pacing='lockstep', steps=10, b0_source='topic')
    assert probe.end_of(process) == 1
    assert 'b0_source' in process.said and 'Traceback' not in process.said
