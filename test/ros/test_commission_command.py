"""`nadrc commission` on the graph: whatever becomes of it, the controller is as it was."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
import random
import signal
import time
from typing import Any

from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from probe import NodeProcess, Probe

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
DEATHS = ('interrupt', 'kill', 'freeze', 'exception', 'not_a_number', 'writer')


class Commissioned:
    """A plant and a disabled controller in this process, and the command as another one."""

    def __init__(self, make: Make) -> None:
        self.probe = probe = make(parameters={'plant': PLANT, 'controller': CONTROL})
        self.heard = probe.listen('command')
        probe.add(PlantNode())
        self.node: ControllerNode = probe.add(ControllerNode())
        probe.wait_until(lambda: not self.node._rivals.listening)
        self.before = probe.all_parameters('controller')

    def run(self, start: Any, *code: str) -> NodeProcess:
        python = code or ('-m', 'nadrc_ros.cli')
        name = f'{self.probe.namespace}/controller'
        out = str(start.directory / 'out')
        words = ('commission', '--controller', name, *BOUNDS, '--yes', '--out', out)
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
        self.probe.spin(0.1)
        steps = [abs(b - a) for a, b in pairwise(self.heard)]
        assert max(steps, default=0.0) < CONTROL['command_rate_limit'] * (1.0 / RATE + SLACK)


def test_p23_the_command_may_die_at_any_moment(
    soak: bool, seed: int, make_probe: Make, start: Any
) -> None:
    """In three ways, with --soak forty times in all ways at random instants."""
    chance = random.Random(seed)
    ways = [(how, 0.5) for how in ('interrupt', 'kill', 'freeze')]
    if soak:
        ways = [(DEATHS[i % len(DEATHS)], chance.uniform(0.0, 4.0)) for i in range(40)]
    loop = Commissioned(make_probe)
    for how, delay in ways:
        seconds = loop.die(how, delay, start)
        print(f'{how} {delay:.2f} s into an experiment: safe after {seconds:.3f} s', flush=True)
        assert seconds < IN_TIME + 1.0 / RATE + SLACK
        loop.look()
