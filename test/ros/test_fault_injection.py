"""Faults that the plant node injects, switched on and off while it runs."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.demo.loop_parameters import node_parameters
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.scenario import loads, ScenarioError
from probe import Probe, Processes
import pytest

KIND = 'fault.measurement.kind'
PLANT: dict[str, Any] = {'rate': 100.0, 'plant': 'chain', 'order': 1, 'damping': 0.0}
CONTROL: dict[str, Any] = {
    'rate': 100.0,
    'plant_order': 1,
    'b0': 1.0,
    'controller_bandwidth': 8.0,
    'measurement_timeout': 0.2,
}
TWO_FAULTS = """
plant: chain
reference: constant
faults: {measurement: [{kind: bias}, {kind: silent}]}
controllers: {it: {}}
"""


def set_one(probe: Probe, name: str, value: Any) -> str:
    (reason,) = probe.set('plant', **{name: value})
    return reason


def test_p07_a_fault_is_switched_on_and_off_live(make_probe: Callable[..., Probe]) -> None:
    probe = make_probe(parameters={'controller': CONTROL, 'plant': PLANT})
    controller: Any = probe.add(ControllerNode()).controller
    plant = probe.add(PlantNode())
    measurements, refer = probe.listen('measurement'), probe.publisher('reference')

    def follows() -> bool:  # else it holds where it is after each fault
        refer(0.0)
        return bool(controller.mode == Mode.OK and controller.policy.reference_age < inf)

    probe.wait_until(follows)

    assert set_one(probe, KIND, 'silent') == ''
    probe.wait_until(lambda: controller.cause == Cause.MEASUREMENT_TIMEOUT)
    n, k = len(measurements), plant.process.k
    probe.wait_until(lambda: controller.mode == Mode.SAFE and plant.process.k > k + 10)
    assert len(measurements) == n
    assert set_one(probe, KIND, 'none') == ''
    probe.wait_until(lambda: controller.mode == Mode.OK)

    for kind in ('not_a_number', 'infinite'):
        assert set_one(probe, KIND, kind) == ''
        probe.wait_until(lambda: controller.cause == Cause.MEASUREMENT_TIMEOUT)
        assert set_one(probe, KIND, 'none') == ''
        probe.wait_until(lambda: controller.mode == Mode.OK)

    assert probe.set_together('plant', **{KIND: 'bias', 'fault.measurement.size': 100.0}) == ''
    probe.wait_until(lambda: abs(plant.process.output + 100.0) < 1.0)  # it believes its sensor
    assert set_one(probe, KIND, 'none') == ''
    probe.wait_until(lambda: abs(plant.process.output) < 1.0)

    n = len(measurements)
    assert set_one(probe, KIND, 'duplicated') == ''
    probe.wait_until(lambda: any(a == b for a, b in zip(measurements[n:], measurements[n + 1 :])))
    assert controller.mode == Mode.OK


def test_p15_what_the_actuator_does_is_in_the_truth(make_probe: Callable[..., Probe]) -> None:
    gain = {'fault.command.kind': 'gain', 'fault.command.size': 0.5}
    disturbed = {'disturbance': 'constant', 'disturbance_offset': 3.0}
    probe = make_probe(parameters={'controller': CONTROL, 'plant': PLANT | disturbed | gain})
    controller: Any = probe.add(ControllerNode()).controller
    probe.add(PlantNode())
    truths = probe.listen('plant/total_disturbance')
    # y' = 0.5 u + 3 at rest: u = -6, and L = y' - u
    probe.wait_until(lambda: truths and abs(truths[-1] - 6.0) < 0.01)
    probe.wait_until(lambda: abs(controller.command + 6.0) < 0.01)


def test_what_cannot_be_injected_is_refused_by_name(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    plant = start('plant', **PLANT)
    reason = set_one(probe, KIND, 'clock_jump')
    assert reason.startswith("fault.measurement.kind = 'clock_jump': must be one of none, silent")
    assert 'probability out of range' in set_one(probe, 'fault.measurement.probability', 2.0)
    assert 'not 0' in set_one(probe, 'fault.command.size', 0.0)
    assert probe.get('plant', KIND, 'fault.command.size') == ['none', 1.0]
    assert plant.running
    lockstep: dict[str, Any] = {'pacing': 'lockstep', 'steps': 10, KIND: 'silent'}
    refused = start('plant', **lockstep)
    assert refused.end() == 1
    assert "fault.measurement.kind = 'silent': must be one of none, stuck" in refused.said
    assert 'Traceback' not in refused.said
    with pytest.raises(ScenarioError, match='measurement has 2, and a plant node takes one'):
        node_parameters(loads(TWO_FAULTS), 'it', tmp_path, lockstep=False)
