"""`nadrc commission` on the graph: whatever becomes of it, the controller is as it was."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
import random
import signal
import time
from typing import Any

from live_loop import address_in, Page, spinning, until
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.commission import search
from nadrc_ros.live.search import SILENT
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.ros.experiment_rows import COLUMNS, RowsReader
from probe import NodeProcess, Probe
import pytest
from rcl_interfaces.srv import SetParametersAtomically

Make = Callable[..., Probe]
RATE = 100.0
PLANT: dict[str, Any] = {
    'rate': RATE,
    'plant': 'chain',
    'order': 1,
    'start': 'at_once',
    'noise_variance': 1e-6,
    'noise_sample_time': 1.0 / RATE,
}
CONTROL: dict[str, Any] = {
    'rate': RATE,
    'plant_order': 1,
    'safe_command': 0.0,
    'command_min': -5.0,
    'command_max': 5.0,
    'command_rate_limit': 20.0,
    'enabled_at_start': False,
}
BOUNDS = ('--max-command', '2', '--travel', '1', '--speed', '4')
# As the command line, but that it fails in the middle of an experiment.
FAILING = """
import sys, time
from nadrc_ros.commission.graph_machine import GraphMachine
from nadrc_ros.cli.app import app
ends = []

def pause(self, seconds):
    if self._rows.rows:
        ends.append(time.monotonic() + {})
        if time.monotonic() > ends[0]:
            raise ZeroDivisionError('on purpose')
    original(self, seconds)

original, GraphMachine._pause = GraphMachine._pause, pause
app(sys.argv[1:])
"""
# From the death to the safe command's ramp: a lease, a brake and what a busy machine is late [s].
IN_TIME, SLACK = 0.3, 0.4
# Two processes start in turn, beside all that a busy machine does [s].
STARTED = 90.0
# Frozen, not a thread of it beats, sends or answers; of a cut network is another test.
DEATHS = ('interrupt', 'kill', 'freeze', 'exception', 'not_a_number', 'writer')


class Commissioned:
    """A plant and a disabled controller in this process, and the command as another one."""

    def __init__(self, make: Make) -> None:
        self.probe = probe = make(parameters={'plant': PLANT, 'controller': CONTROL})
        self.heard = probe.listen('command')
        self.rows = RowsReader(probe.node, f'{probe.namespace}/controller')
        probe.add(PlantNode())
        self.node: ControllerNode = probe.add(ControllerNode())
        probe.wait_until(lambda: not self.node._rivals.listening)
        self.before = probe.all_parameters('controller')

    def run(self, start: Any, *code: str, options: tuple[str, ...] = ()) -> NodeProcess:
        python = code or ('-m', 'nadrc_ros.cli')
        name = f'{self.probe.namespace}/controller'
        out = str(start.directory / 'out')
        words = ('commission', '--controller', name, *BOUNDS, '--yes', '--out', out, *options)
        process: NodeProcess = start.run('commission', *python, *words)
        return process

    def die(self, how: str, delay: float, start: Any) -> float:
        """Let it end some time into an experiment, and return how soon that was over [s]."""
        probe, running = self.probe, self.node._commission
        code = ('-c', FAILING.format(delay)) if how == 'exception' else ()
        process = self.run(start, *code)
        probe.wait_until(lambda: running.active or not process.running)
        assert running.active, process.said
        if how != 'exception':
            probe.spin(delay)
        begin, timer = time.monotonic(), None
        if how == 'exception':  # it ends what runs before it dies
            probe.wait_until(lambda: 'on purpose' in process.said)
            begin = time.monotonic()
        elif how == 'not_a_number':
            probe.set('plant', **{'fault.measurement.kind': how})
        elif how == 'writer':
            rival = probe.publisher('command')
            timer = probe.node.create_timer(0.02, lambda: rival(CONTROL['safe_command']))
        else:
            numbers = {'interrupt': signal.SIGINT, 'kill': signal.SIGKILL}
            begin = process.signal(numbers.get(how, signal.SIGSTOP))
        probe.wait_until(lambda: not running.active)
        seconds = time.monotonic() - begin
        if how == 'freeze':
            process.signal(signal.SIGKILL)
        if timer is not None:
            timer.cancel()
        if how == 'not_a_number':
            probe.wait_until(lambda: not process.running)
            probe.set('plant', **{'fault.measurement.kind': 'none'})
        probe.end_of(process)
        assert 'Traceback' not in process.said or how == 'exception'
        return seconds

    def look(self) -> None:
        """Look at what has to hold after the end."""
        controller = self.node.controller
        assert self.probe.all_parameters('controller') == self.before
        assert self.node._commission.command == CONTROL['safe_command']
        assert not controller.enabled and controller.quiet
        self.probe.wait_until(lambda: self.rows.said or not self.rows.rows)
        limit = CONTROL['command_rate_limit'] * (1.0 + 1e-9)
        at, sent = (COLUMNS.index(name) for name in ('time', 'command'))
        for a, b in pairwise(self.rows.rows):  # of the last experiment, until it was safe
            assert abs(b[sent] - a[sent]) <= limit * (b[at] - a[at])


def test_p23_the_command_may_die_at_any_moment(
    soak: bool, seed: int, make_probe: Make, start: Any
) -> None:
    """In three ways, with --soak 34 times in all ways at random instants."""
    chance = random.Random(seed)
    ways = [(how, 0.5) for how in ('interrupt', 'kill', 'freeze')]
    if soak:
        ways = [(DEATHS[i % len(DEATHS)], chance.uniform(0.0, 4.0)) for i in range(34)]
    loop = Commissioned(make_probe)
    for how, delay in ways:
        seconds = loop.die(how, delay, start)
        print(f'{how} {delay:.2f} s into an experiment: safe after {seconds:.3f} s', flush=True)
        assert seconds < IN_TIME + 1.0 / RATE + SLACK
        assert loop.rows.rows, 'nothing is known of the experiment'
        loop.look()


def test_who_is_waited_for_is_told_before_the_search_is_over(
    probe: Probe, monkeypatch: pytest.MonkeyPatch
) -> None:
    typed, meant = f'{probe.namespace}/contoller', f'{probe.namespace}/controller'
    start = probe.node.create_service(
        SetParametersAtomically, f'{meant}/commission/start', lambda request, answer: answer
    )
    monkeypatch.setattr(search, '_LONGEST', 2.0 * SILENT)
    said: list[str] = []
    with pytest.raises(UserError, match=f'{typed} is no running controller'):
        search.find_controller(probe.node, typed, said.append, False)
    assert said[-1].startswith(f'waiting for {typed}, which is not there: did you mean {meant}?')
    assert search.find_controller(probe.node, meant, said.append, True) == meant
    assert said[-1].startswith('waiting for') and probe.node.destroy_service(start)


def test_p23_after_a_stop_no_further_experiment_begins(make_probe: Make, start: Any) -> None:
    loop = Commissioned(make_probe)
    process = loop.run(start)
    loop.probe.wait_until(lambda: 'Step 1' in process.said, STARTED)
    loop.probe.enable(False)
    assert loop.probe.end_of(process) == 1
    assert 'somebody asked for a stop' in process.said
    assert set(loop.heard) <= {CONTROL['safe_command']}
    loop.look()


def test_p23_a_page_may_only_watch_and_stop_an_experiment(make_probe: Make, start: Any) -> None:
    loop = Commissioned(make_probe)
    experiment, process = loop.node._commission, loop.run(start, options=('--live',))
    loop.probe.wait_until(lambda: address_in(process), STARTED)
    with spinning(loop.probe.executor):
        page = Page(address_in(process))
        until(lambda: page.of('state') and page.of('state')[-1]['commissioned'])
        with page.beating():
            assert 'a page may only watch' in page.ask('enable', hold=False)['text']
            until(lambda: page.of('state')[-1]['experiment'] and experiment.active)
            for hold in (False, True):
                assert 'commission' in page.ask('enable', hold=hold)['text']
            assert 'commission' in page.ask('apply', values={'b0': 2.0})['text']
            assert experiment.active, 'it is not disturbed'
        page.tell('stop')  # the program ends with the experiment, perhaps before it answers
        until(lambda: not experiment.active)
        assert process.end() == 1 and 'was stopped: it was disabled' in process.said
        until(lambda: page.closed)
    loop.look()
