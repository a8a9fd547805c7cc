"""Parameters of the nodes, through the services that any other node would use."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan
from pathlib import Path
from typing import Any

from nadrc_ros.adrc.settings import SLOWEST
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.nodes.reference import ReferenceNode
from nadrc_ros.ros.parameters import _FOREIGN
from probe import Probe, Processes
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

LIVE = {'rate': 50.0}
NUMBERS = (ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_INTEGER)


@pytest.fixture
def nodes(make_probe: Callable[..., Probe], tmp_path: Path) -> tuple[Probe, dict[str, Any]]:
    """Run all four nodes beside the probe."""
    probe = make_probe(
        parameters={
            'controller': LIVE,
            'plant': LIVE | {'plant': 'chain', 'order': 2},
            'reference': LIVE,
            'recorder': LIVE | {'directory': str(tmp_path / 'runs')},
        }
    )
    made = [ControllerNode(), PlantNode(), ReferenceNode(), RecorderNode()]
    return probe, {node.get_name(): probe.add(node) for node in made}


def test_every_parameter_is_described_and_every_number_has_a_range(
    nodes: tuple[Probe, dict[str, Node]],
) -> None:
    probe, all_nodes = nodes
    for name in all_nodes:
        own = [p for p in probe.all_parameters(name) if not p.startswith(_FOREIGN)]
        assert len(own) > 6
        for descriptor in probe.descriptors(name, own):
            assert len(descriptor.description) > 10, descriptor.name
            assert descriptor.type != ParameterType.PARAMETER_NOT_SET, descriptor.name
            if descriptor.type in NUMBERS:
                ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
                assert len(ranges) == 1, descriptor.name
                assert -inf < ranges[0].from_value < ranges[0].to_value < inf, descriptor.name


REFUSED = [
    ('inner_bandwidth', -5.0),
    ('inner_bandwidth', nan),
    ('inner_bandwidth', inf),
    ('inner_bandwidth', -inf),
    ('inner_bandwidth', 60),
    ('inner_bandwidth', '60.0'),
    ('inner_bandwidth', True),
    ('inner_bandwidth', [60.0]),
    ('inner_bandwidth', SLOWEST * (1.0 - 1e-7)),
    ('b0', 0.0),
    ('levels', 2.0),
    ('levels', 0),
    ('levels', 7),
    ('structure', 'nestled'),
    ('feedback_level', ''),
    ('error_based', 1),
    ('pole_ratios', [1.0, nan, 1.0]),
    ('pole_ratios', [1, 1, 1]),
    ('pole_ratios', Parameter('pole_ratios', Parameter.Type.DOUBLE_ARRAY, [])),
    ('command_min', 200.0),
    ('safe_command', 150.0),
    ('measurement_timeout', 0.02),
    ('max_dt', 0.01),
    ('rate', 100.0),
    ('plant_order', 3),
    ('trace', 'elsewhere'),
    ('enabled_at_start', False),
    ('inner_bandwith', 60.0),
    ('inner_bandwidth', Parameter('inner_bandwidth', Parameter.Type.NOT_SET)),
    ('use_sim_time', 'yes'),
    ('use_sim_time', True),
]


def test_p13_a_bad_value_is_refused_by_name_and_what_runs_stays_what_is_shown(
    nodes: tuple[Probe, dict[str, Any]],
) -> None:
    probe, all_nodes = nodes
    controller = all_nodes['controller'].controller
    before = probe.all_parameters('controller')
    settings = controller.settings
    for name, value in REFUSED:
        (reason,) = probe.set('controller', **{name: value})
        assert name in reason, (name, value, reason)
        assert probe.all_parameters('controller') == before
    for name, value, written in (
        ('inner_bandwidth', 60, ': write 60.0'),
        ('pole_ratios', [1, 2], ': write [1.0, 2.0]'),
        ('plant_poles', -20.0, ': write [-20.0]'),
    ):
        assert probe.set('controller', **{name: value})[0].endswith(written)
    ticks = sum(controller.counts.values())
    probe.wait_until(lambda: sum(controller.counts.values()) > ticks + 2)
    assert controller.settings == settings


@pytest.mark.parametrize(
    ('node', 'name', 'value'),
    [
        ('plant', 'noise_variance', -1.0),
        ('plant', 'noise_variance', nan),
        ('plant', 'gain', 0.0),
        ('plant', 'gain', nan),
        ('plant', 'order', 3),
        ('plant', 'initial_state', [1.0]),
        ('plant', 'disturbance', 'sinus'),
        ('plant', 'disturbance_frequency', inf),
        ('plant', 'command_timeout', -1.0),
        ('plant', 'command_timeout', 0.02),
        ('reference', 'signal', 'sinus'),
        ('reference', 'amplitude', nan),
        ('reference', 'frequency', 1),
        ('recorder', 'duration', 5.0),
        ('recorder', 'directory', '/'),
    ],
)
def test_p13_the_other_nodes_refuse_too(
    nodes: tuple[Probe, dict[str, Any]], node: str, name: str, value: Any
) -> None:
    probe, _ = nodes
    before = probe.all_parameters(node)
    (reason,) = probe.set(node, **{name: value})
    assert name in reason
    assert probe.all_parameters(node) == before


def test_p16_no_request_to_the_parameter_services_kills_a_node(
    nodes: tuple[Probe, dict[str, Any]],
) -> None:
    probe, all_nodes = nodes
    odd = [ParameterMessage(name='b0', value=ParameterValue(type=99)), ParameterMessage(name='b0')]
    odd += [ParameterMessage(name=''), ParameterMessage(name='b' * 10_000)]
    ask = 'controller/set_parameters'
    for p in odd:
        results = probe.call(SetParameters, ask, SetParameters.Request(parameters=[p, p])).results
        assert len(results) == 2
        assert not results[0].successful and not results[1].successful
        together = SetParametersAtomically.Request(parameters=[p])
        answer = probe.call(SetParametersAtomically, f'{ask}_atomically', together)
        assert not answer.result.successful
    assert probe.set_together('controller') == ''
    assert probe.set('controller', use_sim_time='yes') != ['']
    assert probe.get('controller', '', 'nothing') == []
    assert probe.descriptors('controller', ['', 'nothing']) == []
    periods = all_nodes['controller'].ticker.periods
    probe.wait_until(lambda: all_nodes['controller'].ticker.periods > periods)


def test_foreign_parameters_pass(nodes: tuple[Probe, dict[str, Any]]) -> None:
    probe, all_nodes = nodes
    for name in all_nodes:
        assert probe.set(name, use_sim_time=False) == ['']
        assert 'fixed at start' in probe.set(name, use_sim_time=True)[0]
        assert probe.get(name, 'use_sim_time') == [False]


@pytest.mark.parametrize('kind', ['events', 'single'])
def test_p12_a_live_change_acts_from_the_next_step_on(
    kind: str, make_probe: Callable[..., Probe]
) -> None:
    parameters = {'controller': LIVE, 'plant': LIVE | {'plant': 'chain', 'order': 2}}
    if kind == 'single':
        probe = make_probe(parameters=parameters, executor=SingleThreadedExecutor)
    else:
        probe = make_probe(parameters=parameters)
    controller = probe.add(ControllerNode()).controller
    probe.add(PlantNode())
    probe.wait_until(lambda: controller.counts[0] > 3)
    steps = controller.counts[0]
    assert probe.set('controller', inner_bandwidth=60.0) == ['']
    probe.wait_until(lambda: controller.counts[0] > steps + 1)
    assert controller.design.bandwidths[0] == 60.0
    assert probe.get('controller', 'inner_bandwidth') == [60.0]


def test_p12_several_parameters_change_together_or_not_at_all(
    nodes: tuple[Probe, dict[str, Any]],
) -> None:
    probe, all_nodes = nodes
    controller = all_nodes['controller'].controller
    # one after the other the first of these would be refused
    change = {'command_min': 200.0, 'command_max': 300.0, 'safe_command': 250.0}
    assert 'command_min' in probe.set_together('controller', **change | {'safe_command': 150.0})
    assert probe.get('controller', *change) == [-100.0, 100.0, 0.0]
    assert probe.set_together('controller', **change) == ''
    probe.wait_until(lambda: controller.settings.command_min == 200.0)
    assert controller.settings.safe_command == 250.0
    assert probe.get('controller', *change) == list(change.values())
    reason = probe.set_together('controller', inner_bandwidth=50.0, structure='nestled')
    assert 'structure' in reason
    assert probe.get('controller', 'inner_bandwidth') == [40.0]


def test_plant_and_reference_change_live(nodes: tuple[Probe, dict[str, Any]]) -> None:
    probe, all_nodes = nodes
    plant, reference = all_nodes['plant'], all_nodes['reference']
    references, measurements = probe.listen('reference'), probe.listen('measurement')
    outputs = probe.listen('plant/output')
    assert probe.set('plant', gain=3.0, damping=0.25) == ['', '']
    assert (plant.process.plant.gain, plant.process.plant.damping) == (3.0, 0.25)
    assert probe.set('plant', disturbance='step', disturbance_amplitude=2.0) == ['', '']
    assert plant.process.disturbance.amplitude == 2.0
    assert probe.set('reference', signal='constant', offset=7.0) == ['', '']
    probe.wait_until(lambda: references and references[-1] == 7.0)
    assert reference.get_parameter('signal').value == 'constant'
    assert probe.set('plant', noise_variance=1.0) == ['']
    probe.wait_until(lambda: measurements and outputs and abs(measurements[-1] - outputs[-1]) > 0)


@pytest.mark.parametrize(
    ('node', 'given', 'named'),
    [
        (
            'controller',
            {'inner_bandwith': 60.0},
            ('inner_bandwith', 'mean inner_bandwidth?'),
        ),
        ('plant', {'noise_varianc': 1.0}, ('noise_varianc', 'did you mean noise_variance?')),
        ('reference', {'amplitud': 1.0}, ('amplitud', 'did you mean amplitude?')),
        ('recorder', {'directry': 'x'}, ('directry', 'did you mean directory?')),
        ('controller', {'inner_bandwidth': -5.0}, ('inner_bandwidth',)),
        ('controller', {'inner_bandwidth': nan}, ('inner_bandwidth',)),
        ('controller', {'inner_bandwidth': 40}, ('inner_bandwidth', ': write 40.0')),
        ('controller', {'b0_table': [1, 2]}, ('b0_table', ': write [1.0, 2.0]')),
        ('controller', {'plant_poles': -20}, ('plant_poles', ': write [-20.0]')),
        ('controller', {'inner_bandwidth': 'fast'}, ('inner_bandwidth',)),
        ('controller', {'command_min': 5.0, 'command_max': 5.0}, ('command_min',)),
        ('controller', {'trace': '/nowhere/trace'}, ('/nowhere/trace',)),
        ('plant', {'plant': 'papr'}, ('papr', 'paper')),
        ('plant', {'plant': '/nowhere/plant.py'}, ('/nowhere/plant.py',)),
        ('plant', {'initial_state': [1.0, 2.0, 3.0]}, ('initial_state',)),
        ('recorder', {'inputs': 'reference command'}, ('inputs', 'measurement')),
        ('recorder', {'directory': '/proc/runs'}, ('/proc/runs',)),
        ('plant', {'pacing': 'lockstep'}, ('steps',)),
        (
            'controller',
            {'rate': 1.0},
            ('measurement_timeout = 0.25: must be 0', '2 s at 1 Hz', 'so must be max_dt = 0.5'),
        ),
        ('controller', {'rate': 3.0, 'measurement_timeout': 1.0}, ('max_dt = 0.5', '0.66')),
        (
            'controller',
            {'qos_overrides./measurment.subscription.reliability': 'reliable'},
            ('qos_overrides./measurment.', '/measurement.subscription.reliability?'),
        ),
        (
            'controller',
            {'qos_overrides./measurement.subscription.durability': 'transient_local'},
            ('qos_overrides./measurement.subscription.durability', 'subscription.reliability'),
        ),
        (
            'recorder',
            {'qos_overrides./command.publisher.depth': 3},
            ('qos_overrides./command.publisher.depth', 'command.subscription.depth?'),
        ),
        (
            'plant',
            {'qos_overrides./command.x': 3, 'pacing': 'lockstep', 'steps': 9},
            ('/command.x', 'left out'),
        ),
    ],
)
def test_p13_a_bad_start_names_the_key_and_ends_with_1(
    node: str, given: dict[str, Any], named: tuple[str, ...], start: Processes
) -> None:
    process = start(node, **given)
    assert process.end() == 1
    for word in named:
        assert word in process.said
    assert 'Traceback' not in process.said
    assert len(process.own_lines) == 1, process.said


@pytest.mark.parametrize(
    ('text', 'named'),
    [
        ('/**: {ros__parameters: {inner_bandwidth: 4', 'broken.yaml'),
        ('/**: {ros__parameters: [1, 2]}', 'broken.yaml'),
    ],
)
def test_p13_a_malformed_parameter_file_is_named(
    text: str, named: str, start: Processes, tmp_path: Path
) -> None:
    file = tmp_path / 'broken.yaml'
    file.write_text(text)
    process = start('controller', file=file)
    assert process.end() == 1
    assert named in process.said
    assert 'Traceback' not in process.said


@pytest.mark.parametrize(
    'arguments', [('-p', 'inner_bandwidth'), ('-r', '__ns:=/a b'), ('--nonsense',)]
)
def test_p13_malformed_arguments_end_with_1(arguments: tuple[str, ...], start: Processes) -> None:
    process = start('controller', *arguments)
    assert process.end() == 1
    assert 'cannot start' in process.said
    assert 'Traceback' not in process.said
