"""The inputs `applied` and `feed_forward` of the controller node."""

from __future__ import annotations

from collections.abc import Callable

import attrs
from nadrc_ros.adrc.status import Mode
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.ros.topics import SEND
from nadrc_ros.scenario import loads
from nadrc_ros.simulation.simulate import Result
from nadrc_ros.testing import scenario_loop
import numpy as np
from probe import Probe
from rclpy.timer import Timer
from std_msgs.msg import Float64MultiArray

Make = Callable[..., Probe]
RATE, FOREIGN, NAN = 50.0, 7.3, float('nan')

SCENARIO = """
plant: {name: chain, order: 2}
reference: {signal: step, amplitude: 6.0, start_time: 0.3}
disturbance: {signal: sine, amplitude: 2.0, frequency: 5.0}
feed_forward: {signal: sine, amplitude: -1.5, frequency: 5.0}
noise: {variance: 1.0e-6}
faults:
  command: [{kind: limited, size: 4.0, start: 0.2, duration: 2.0}]
rate: 100
duration: 3
limits: {command_min: -10, command_max: 10, command_rate_limit: 60}
controllers:
  both: {applied_timeout: 0.1, feed_forward_timeout: 0.1, inner_bandwidth: 15}
  neither: {inner_bandwidth: 15}
"""


def test_p18_lockstep_gives_the_bits_of_the_simulation_with_reports_and_feed_forward() -> None:
    scenario = loads(SCENARIO)
    runs = {}
    for name in scenario.controllers:
        with scenario_loop(scenario, name, lockstep=True) as run:
            runs[name] = run.finish()
        expected = scenario.run(name)
        for field in attrs.fields(Result):
            wanted = getattr(expected, field.name)
            if isinstance(wanted, np.ndarray):
                got = getattr(runs[name], field.name)
                assert np.array_equal(got, wanted, equal_nan=True), (name, field.name)
    assert runs['both'].output.max() < runs['neither'].output.max() - 0.2


def test_p11_enabling_begins_with_the_reported_command_and_goes_on_with_our_own(
    make_probe: Make,
) -> None:
    own = {
        'rate': RATE,
        'plant_order': 1,
        'enabled_at_start': False,
        'applied_timeout': 0.5,
        'feed_forward_timeout': 0.5,
        'measurement_timeout': 0.0,
        'command_rate_limit': 20.0,
        'wiring.applied': '/drive std_msgs/msg/Float64MultiArray data[1]',
    }
    probe = make_probe(parameters={'controller': own})
    node: ControllerNode = probe.add(ControllerNode())
    commands = probe.listen('command')
    measure, feed = probe.publisher('measurement'), probe.publisher('feed_forward')
    report = probe.node.create_publisher(Float64MultiArray, '/drive', SEND)
    probe.wait_until(lambda: probe.readers('measurement') and probe.readers('feed_forward'))
    reporting = True

    def tell() -> None:
        measure(0.0)
        if reporting:
            report.publish(Float64MultiArray(data=[NAN, FOREIGN]))
            feed(1.0)

    timer: Timer = probe.node.create_timer(1.0 / RATE, tell)
    probe.wait_until(lambda: node.controller.policy.measurement_age < 1.0)
    assert abs(node.controller.total_disturbance + FOREIGN) < 1e-6
    assert not commands and node.report()[2]['applied'] == 'reported'
    assert probe.enable().message == 'enabled'
    probe.wait_until(lambda: commands)
    assert abs(commands[0] - FOREIGN) < 1e-9 and node.controller.mode == Mode.OK
    assert node.report()[2]['feed_forward'] == 1.0
    reporting = False
    probe.wait_until(lambda: node.report()[2]['applied'] == 'own')
    probe.wait_until(lambda: node.report()[2]['feed_forward'] == 0.0)
    watched = {each.topic.rsplit('/', 1)[-1]: each.regular for each in node.inputs}
    assert watched['drive'] and not watched['feed_forward']  # a cable, and what may rest
    timer.cancel()
