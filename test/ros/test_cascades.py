"""Axes in a cascade: the inner one takes the command of the outer one in the same tick."""

from __future__ import annotations

from collections.abc import Iterator
import json
from pathlib import Path
import signal
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.nodes.axes import axis_of
from nadrc_ros.nodes.cascades import make_joined
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.records.step_trace import replay
from nadrc_ros.ros.topics import receive
from probe import parameter_file, Probe, Processes
import pytest
from wired import Make

RATE = 100.0
LOOP: dict[str, Any] = {'rate': RATE, 'plant_order': 1, 'b0': 1.0, 'structure': 'conventional'}
LOOPS: dict[str, dict[str, Any]] = {
    'velocity': {
        **LOOP,
        'reference_from': 'position',
        'controller_bandwidth': 12.0,
        'command_min': -30.0,
        'command_max': 30.0,
        'command_rate_limit': 500.0,
        'reference_min': -6.0,
        'reference_max': 6.0,
        'safe_command': 0.25,
    },
    'position': {
        **LOOP,
        'controller_bandwidth': 3.0,
        'inner_bandwidth': 12.0,
        'command_min': -5.0,
        'command_max': 5.0,
    },
}


class Slide:
    """A mass that is pushed, with a sensor for where it is and one for how fast."""

    def __init__(self, probe: Probe) -> None:
        self.x = [0.0, 0.0]
        self.pushes = [0.0]
        topics = ('position/measurement', 'velocity/measurement')
        self.sensors = [probe.publisher(topic) for topic in topics]
        receive(probe.node, 'velocity/command', lambda push, _: self.pushes.append(push))
        probe.node.create_timer(1.0 / RATE, self._advance)

    def _advance(self) -> None:
        h, push = 1.0 / RATE, self.pushes[-1]
        y, v = self.x
        self.x = [y + h * v + 0.5 * h * h * push, v + h * push]
        for send, value in zip(self.sensors, self.x):
            send(value)


def joined(probe: Probe, **changes: dict[str, Any]) -> dict[str, ControllerNode]:
    """Return the nodes by name, the inner one made first."""
    loops = {name: {**values, **changes.get(name, {})} for name, values in LOOPS.items()}
    loops |= {name: {**LOOP, **values} for name, values in changes.items() if name not in loops}

    def make(name: str, first: ControllerNode | None) -> ControllerNode:
        space = f'{probe.namespace}/{name}'
        return axis_of(ControllerNode, first, list(loops))(
            namespace=space,
            parameters={**loops[name], 'share_command': True},
        )

    nodes = dict(zip(loops, make_joined(list(loops), make)))
    for node in nodes.values():
        probe.add(node)
    return nodes


def ticks(path: Path) -> Iterator[dict[str, Any]]:
    for line in path.read_text().splitlines():
        if 'u' in (record := json.loads(line)):
            yield record


def test_p18_both_loops_act_in_one_tick_and_their_traces_replay_to_the_bit(
    make_probe: Make, tmp_path: Path
) -> None:
    probe = make_probe()
    traces = {name: tmp_path / f'{name}.jsonl' for name in LOOPS}
    nodes = joined(probe, **{name: {'trace': str(path)} for name, path in traces.items()})
    outer, inner = nodes['position'].controller, nodes['velocity'].controller
    slide, send = Slide(probe), probe.publisher('position/reference')
    heard = probe.listen('position/command')
    probe.wait_until(lambda: outer.mode == inner.mode == Mode.OK)

    def go(where: float) -> None:
        probe.wait_until(lambda: send(where) or abs(slide.x[0] - where) < 0.01)

    go(1.0)
    assert 'velocity/reference' not in [each.topic for each in nodes['velocity'].inputs]
    assert not probe.readers('velocity/reference')
    # The inner loop is opened on the way to somewhere else, and closed again.
    send(30.0)
    probe.wait_until(lambda: slide.x[1] > 2.0)
    assert nodes['velocity'].enable(False)[0]
    probe.wait_until(lambda: outer.cause == Cause.NOT_FOLLOWED and inner.mode == Mode.SAFE)
    speed = slide.x[1]
    probe.spin(0.3)
    assert outer.mode == Mode.HOLDING
    assert outer.command == pytest.approx(inner.output_estimate, abs=0.1)
    assert slide.x[1] == pytest.approx(speed + 0.075, abs=0.05)  # the safe command pushes
    assert nodes['velocity'].enable()[0]
    probe.wait_until(lambda: outer.mode == inner.mode == Mode.OK)
    go(2.0)
    assert heard and max(heard) <= 5.0
    assert inner.commanding and not outer.commanding  # nobody is missed on its topic
    # Either side refuses what would make commands that the inner loop does not take.
    assert 'reference_max = 6.0' in probe.set('position/controller', command_max=7.0)[0]
    assert 'reference_max = 4.0' in probe.set('velocity/controller', reference_max=4.0)[0]
    assert probe.set('position/controller', command_max=5.5) == ['']
    for node in nodes.values():
        node.begin_stop()
    probe.wait_until(lambda: all(node.stopped for node in nodes.values()))
    for node in nodes.values():
        node.close()
    for name, path in traces.items():
        recorded, again = zip(*replay(path))
        assert recorded == again, name
    asked, taken = (list(ticks(traces[name])) for name in ('position', 'velocity'))
    assert len(asked) == len(taken) > 100
    assert all(each['r'] == [before['u'], 0.0, 0.0] for before, each in zip(asked, taken))
    assert any(each['followed'] for each in asked) and not all(e['followed'] for e in asked)


def test_p14_a_plant_with_a_sensor_of_its_speed_is_controlled_until_a_signal_ends_it_safely(
    probe: Probe, start: Processes
) -> None:
    """As docs/cascade.md has it."""
    space, send = start.namespace, probe.publisher('position/reference')
    output, pushes = probe.listen('plant/output'), probe.listen('velocity/command')
    plant: dict[str, Any] = {'plant': 'chain', 'order': 2, 'rate': RATE, 'measured_derivatives': 1}
    noise: dict[str, Any] = {'noise_variance': 1e-10, 'noise_derivative_variances': [1e-8]}
    start('plant', '-r', 'command:=velocity/command', **plant, **noise)
    file = parameter_file(
        start.directory / 'axes.yaml',
        {f'{space}/{name}/controller': values for name, values in LOOPS.items()},
    )
    process = start.run(
        *('axes', '-m', 'nadrc_ros.nodes.controller', '--axes', *LOOPS, '--ros-args'),
        *('-r', f'__ns:={space}', '--params-file', str(file)),
        *('-r', f'{space}/position/measurement:={space}/measurement'),
        *('-r', f'{space}/velocity/measurement:={space}/measurement/rate'),
    )
    probe.wait_until(lambda: send(1.0) or (output and abs(output[-1] - 1.0) < 0.02))
    process.signal(signal.SIGINT)
    assert probe.end_of(process) == 0, process.said
    probe.wait_until(lambda: pushes[-1] == 0.25)
    assert 'Traceback' not in process.said
    begun = process.said[: process.said.index('going to the safe')].replace('no reference yet', '')
    assert 'in control' in begun and 'not in control' not in begun  # the start is no fault


def test_a_sensor_has_no_derivative_that_the_plant_does_not_have(make_probe: Make) -> None:
    make_probe()
    with pytest.raises(UserError, match='measured_derivatives = 1: must be below 1, the order'):
        PlantNode(parameters={'plant': 'chain', 'order': 1, 'measured_derivatives': 1})


@pytest.mark.parametrize(
    ('changes', 'complaint'),
    [
        ({'velocity': {'reference_from': 'positon'}}, 'axis velocity: .*did you mean position'),
        ({'velocity': {'reference_from': 'velocity'}}, 'axis velocity: .*another axis'),
        (
            {'position': {'reference_from': 'velocity'}},
            'reference_from.* no circle, as velocity <- position <- velocity is',
        ),
        (
            {'other': {'reference_from': 'position'}},
            'axis other: .*velocity takes the command of position',
        ),
        (
            {name: {'trigger': 'measurement'} for name in LOOPS},
            'axis velocity: trigger = .measurement.: must be timer with reference_from',
        ),
        (
            {name: {'pacing': 'lockstep'} for name in LOOPS},
            'axis velocity: pacing = .lockstep.: must be realtime with reference_from',
        ),
        (
            {name: {'pacing': 'lockstep', 'reference_from': ''} for name in LOOPS},
            'axis velocity: steps = 0: must be the length',
        ),
        ({'position': {'rate': 50.0}}, 'axis position: rate is 100.0 for'),
        (
            {'velocity': {'wiring.reference': '/goal std_msgs/Float64 data'}},
            'axis velocity: wiring.reference = .*the command of the axis position',
        ),
        (
            {'velocity': {'reference_max': 4.0}},
            'axis velocity: command_max = 5.0: must be at most reference_max = 4.0',
        ),
    ],
)
def test_a_cascade_that_cannot_be_is_refused_by_name(
    changes: dict[str, Any], complaint: str, make_probe: Make
) -> None:
    with pytest.raises(UserError, match=complaint):
        joined(make_probe(), **changes)


def test_alone_there_is_no_axis_to_take_a_reference_from(make_probe: Make) -> None:
    make_probe()
    with pytest.raises(UserError, match=r'^reference_from = .position.: must be another axis'):
        make_joined([''], lambda *_: ControllerNode(parameters={**LOOPS['velocity']}))


def test_an_outer_loop_without_a_sensor_has_the_inner_one_stop(make_probe: Make) -> None:
    probe = make_probe()
    nodes = joined(probe, position={'hold_time': 0.05, 'measurement_timeout': 0.1})
    slide, send = Slide(probe), probe.publisher('position/reference')
    outer, inner = nodes['position'].controller, nodes['velocity'].controller
    probe.wait_until(lambda: send(50.0) or slide.x[1] > 2.0)
    slide.sensors[0] = probe.publisher('nowhere')
    probe.wait_until(lambda: outer.mode == Mode.SAFE)
    assert (outer.cause, inner.mode) == (Cause.MEASUREMENT_TIMEOUT, Mode.OK)
    probe.wait_until(lambda: abs(slide.x[1]) < 0.02)
