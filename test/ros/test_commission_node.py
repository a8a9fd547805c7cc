"""Commissioning experiments in the controller node: however one ends, nothing is left of it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
import signal
from typing import Any

from nadrc_ros.adrc.status import Mode
from nadrc_ros.nodes.commission import LATER
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.ros.diagnostics import receive_events
from nadrc_ros.ros.experiment_rows import COLUMNS, RowsReader, STAGES
from probe import parameter_file, parameter_messages, Probe, Processes
import pytest
from rcl_interfaces.srv import SetParametersAtomically

Make = Callable[..., Probe]
RATE = 100.0
PLANT: dict[str, Any] = {'rate': RATE, 'plant': 'chain', 'order': 1, 'start': 'at_once'}
CONTROL: dict[str, Any] = {
    'rate': RATE,
    'plant_order': 1,
    'b0': 1.0,
    'safe_command': 0.5,
    'command_min': -5.0,
    'command_max': 5.0,
    'command_rate_limit': 20.0,
    'enabled_at_start': False,
}
EXPERIMENT: dict[str, Any] = {
    'kind': 'doublet',
    'max_command': 2.0,
    'travel': 3.0,
    'speed': 10.0,
    'amplitude': 1.0,
    'segment': 0.2,
}
BROKEN = """
from nadrc_ros.adrc.commission.experiment import Experiment
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.runtime import run

def tick(self, *arguments):
    if self.settings.seed == 7 and self._time > 0.5:
        raise ZeroDivisionError('on purpose')
    return original(self, *arguments)

original, Experiment.tick = Experiment.tick, tick
raise SystemExit(run(ControllerNode))
"""
START, STOP, KEEP = 'controller/commission/start', 'controller/commission/stop', 'controller/keep'


class Bench:
    """A plant and a disabled controller in the process of the test, and somebody who holds it."""

    def __init__(self, make: Make, **more: Any) -> None:
        self.probe = probe = make(parameters={'plant': PLANT, 'controller': CONTROL | more})
        self.commands = probe.listen('command')
        self.events: list[str] = []
        receive_events(probe.node, 'controller', self._note)
        self.rows = RowsReader(probe.node, f'{probe.namespace}/controller')
        self.plant = probe.add(PlantNode())
        self.node: ControllerNode = probe.add(ControllerNode())
        beat = probe.publisher(KEEP)
        self.heart = probe.node.create_timer(0.05, lambda: beat(1.0))
        probe.wait_until(lambda: self.node._lease.left and self.rows_heard())
        probe.wait_until(lambda: self.node.controller.policy.measurement_age < 0.1)
        probe.wait_until(lambda: not self.node._rivals.listening)
        self.before = self.parameters()

    def rows_heard(self) -> Any:
        return self.node.count_subscribers(f'{self.probe.namespace}/controller/commission/rows')

    def _note(self, _: str, kind: str, text: str, __: Any) -> None:
        if kind == 'commission':
            self.events.append(text)

    def parameters(self) -> dict[str, Any]:
        return self.probe.all_parameters('controller')

    def ask(self, **more: Any) -> str:
        """Ask for an experiment, and return why it was refused, if it was."""
        values = {name.replace('controller_', 'controller.'): v for name, v in more.items()}
        request = SetParametersAtomically.Request(
            parameters=parameter_messages(EXPERIMENT | values)
        )
        result = self.probe.call(SetParametersAtomically, START, request).result
        return '' if result.successful else result.reason

    def spoil(self, kind: str) -> None:
        """Let the sensor have a fault from now on."""
        assert self.probe.set('plant', **{'fault.measurement.kind': kind}) == ['']

    def start(self, **more: Any) -> None:
        self.rows.begin()
        assert self.ask(**more) == ''
        self.probe.wait_until(lambda: len(self.rows.rows) > 30 or self.rows.said)

    def ended(self) -> str:
        """Wait for the end, look at what has to hold after it, and return why it ended."""
        self.probe.wait_until(lambda: self.rows.said)
        self.rows.refuse_lost()
        node, safe = self.node, CONTROL['safe_command']
        assert not node._commission.active and not node.controller.enabled
        assert self.commands[-1] == safe
        self.probe.spin(0.1)
        count = len(self.commands)
        self.probe.spin(0.1)
        assert len(self.commands) == count, 'it is not silent'
        steps = [abs(b - a) for a, b in pairwise(self.column('command'))]
        times = [b - a for a, b in pairwise(self.column('time'))]
        limit = CONTROL['command_rate_limit']
        assert all(s <= limit * t * (1.0 + 1e-9) for s, t in zip(steps, times, strict=True))
        assert self.parameters() == self.before
        assert self.rows.said is not None
        return self.rows.said

    def column(self, name: str) -> list[float]:
        return [row[COLUMNS.index(name)] for row in self.rows.rows]


def test_p23_an_experiment_moves_the_machine_inside_its_bounds_and_enabling_is_bumpless(
    make_probe: Make,
) -> None:
    bench = Bench(make_probe)
    bench.start(longest=3.0)
    assert 'commission' in bench.probe.said()[-1][1]
    assert bench.ended().startswith('done: ')
    commands, outputs = bench.column('command'), bench.column('measurement')
    assert max(commands) == 1.5 and min(commands) == -0.5
    first = next(y for y in outputs if y == y)
    assert 0.05 < max(abs(y - first) for y in outputs if y == y) < EXPERIMENT['travel']
    assert bench.events[0] == 'a commissioning experiment begins: doublet'
    assert bench.events[1].startswith('the commissioning experiment is over (done): ')
    # the observers saw what acted: they know what the load is
    assert bench.probe.enable().success
    bench.probe.wait_until(lambda: bench.node.controller.mode == Mode.OK)
    assert abs(bench.commands[-1] - CONTROL['safe_command']) < 0.5


def test_p23_what_would_not_be_safe_is_refused_by_name(make_probe: Make) -> None:
    bench = Bench(make_probe)
    assert bench.ask(travel=-1.0).startswith('travel = -1.0: must be a finite number from')
    assert 'did you mean travel' in bench.ask(travl=1.0)
    assert bench.ask(command_max=6.0) == (
        'command_max = 6.0: must be from -5 to 5, the limits of this controller'
    )
    assert 'at most 20' in bench.ask(command_rate_limit=0.0)
    assert bench.ask(controller_b0=2.0).startswith('controller.b0 = 2.0: must be left out with')
    assert bench.ask(kind='step', controller_b0=0.0).startswith('controller.b0 = 0.0: must be')
    bench.heart.cancel()
    bench.probe.wait_until(lambda: not bench.node._lease.left)
    said = bench.ask()
    assert said.startswith('nobody holds it: publish a lease on ~/keep') and said.endswith(LATER)
    bench.heart.reset()
    bench.probe.wait_until(lambda: bench.node._lease.left)
    bench.spoil('silent')
    bench.probe.wait_until(lambda: bench.node.controller.policy.measurement_age > 0.3)
    said = bench.ask()
    assert said.startswith('no valid measurement for ') and said.endswith(LATER)
    assert bench.probe.enable().success
    assert bench.ask() == 'the loop is enabled: call ~/enable with false first'
    assert bench.parameters() == bench.before


def test_p23_while_it_runs_nothing_else_is_done_and_disabling_ends_it(make_probe: Make) -> None:
    bench = Bench(make_probe)
    late = {'sign': 1, 'delay': 2.0, 'amplitude': 0.3}
    bench.start(**late)
    busy = 'a commissioning experiment runs: call ~/commission/stop first'
    assert bench.ask(**late) == ''  # the same again: the answer was lost
    assert bench.ask() == busy
    answer = bench.probe.enable()
    assert (answer.success, answer.message) == (False, busy)
    assert busy in bench.probe.set('controller', b0=2.0)[0]
    answer = bench.probe.trigger('controller/reset')
    assert (answer.success, answer.message) == (False, busy)
    # for two seconds it could brake what acts so late
    begin = bench.column('time')[-1]
    assert bench.probe.enable(False).message == 'already disabled'
    assert bench.ended() == 'stopped: it was disabled'
    assert bench.column('time')[-1] - begin < 1.0


@pytest.mark.parametrize(
    ('more', 'end', 'least'),
    [({'silence': 0.4}, 'done: ', 0.4), ({'silence': 5.0, 'travel': 1.2}, 'bound: travel', 0.05)],
)
def test_p23_while_it_is_silent_nothing_is_sent_and_a_bound_ends_that(
    more: dict[str, float], end: str, least: float, make_probe: Make
) -> None:
    bench = Bench(make_probe)
    before = [0, *bench.commands.numbers][-1]
    bench.start(kind='silence', segment=0.3, **more)
    assert bench.ended().startswith(end)
    times = bench.column('time')
    silent = [row for row, stage in enumerate(stages(bench)) if stage == 'silent']
    # by its own clock: a machine that is late makes fewer ticks of the same time
    assert times[silent[-1] + 1] - times[silent[0] - 1] > least
    assert bench.commands.numbers[-1] - before == len(bench.rows.rows) - len(silent)


def stages(bench: Bench) -> list[str]:
    return [STAGES[int(stage)] for stage in bench.column('stage')]


@pytest.mark.parametrize('trigger', ['timer', 'measurement'])
@pytest.mark.parametrize('end', ['stop', 'heart', 'silent', 'not_a_number', 'writer', 'bound'])
def test_p23_however_it_ends_the_command_is_safe_at_the_rate_limit(
    end: str, trigger: str, make_probe: Make
) -> None:
    bench = Bench(make_probe, trigger=trigger)
    probe = bench.probe
    bench.start(**({'travel': 0.05, 'segment': 1.0} if end == 'bound' else {}))
    said = {
        'stop': 'stopped: it was stopped',
        'heart': "stopped: the operator's heartbeat (~/keep) stopped",
        'silent': 'lost: no valid measurement for',
        'not_a_number': 'lost: no valid measurement for',
        'writer': f'stopped: {probe.namespace}/probe commands on {probe.namespace}/command',
        'bound': 'bound: travel',
    }
    if end == 'stop':
        assert probe.trigger(STOP).success
    elif end == 'heart':
        bench.heart.cancel()
    elif end in ('silent', 'not_a_number'):
        bench.spoil(end)
    elif end == 'writer':
        rival = probe.publisher('command')
        timer = probe.node.create_timer(0.02, lambda: rival(0.5))
        probe.wait_until(lambda: bench.rows.said)
        timer.cancel()
    assert bench.ended().startswith(said[end])


@pytest.mark.parametrize('how', ['interrupt', 'exception'])
def test_p23_a_controller_that_ends_in_an_experiment_ends_with_the_safe_command(
    how: str, probe: Probe, start: Processes
) -> None:
    commands = probe.listen('command')
    reader = RowsReader(probe.node, f'{probe.namespace}/controller')
    start('plant', **PLANT)
    file = parameter_file(start.directory / 'broken.yaml', {'/**': CONTROL})
    arguments = ('--ros-args', '-r', f'__ns:={probe.namespace}', '--params-file', str(file))
    controller = start.run('controller', '-c', BROKEN, *arguments)
    beat = probe.publisher(KEEP)
    probe.node.create_timer(0.05, lambda: beat(1.0))
    values = EXPERIMENT | ({'seed': 7} if how == 'exception' else {})
    request = SetParametersAtomically.Request(parameters=parameter_messages(values))

    def started() -> bool:
        answer = probe.call(SetParametersAtomically, START, request)
        return bool(answer.result.successful)

    probe.wait_until(started)
    probe.wait_until(lambda: len(reader.rows) > 30 or not controller.running)
    if how == 'interrupt':
        controller.signal(signal.SIGINT)
    assert probe.end_of(controller) == (how == 'exception')
    assert ('ZeroDivisionError: on purpose' in controller.said) == (how == 'exception')
    probe.wait_until(lambda: commands[-1] == CONTROL['safe_command'])
