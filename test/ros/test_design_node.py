"""A controller node takes the parameter file of a first design as it is."""

from __future__ import annotations

from pathlib import Path

from nadrc_ros.scenario.parameter_files import (
    ANY_CONTROLLER,
    controller_parameters,
    parameter_text,
)
from nadrc_ros.tuning.design.candidates import candidates
from nadrc_ros.tuning.design.requirements import Requirements
from probe import Probe, Processes

NAMES = ('rate', 'inner_bandwidth', 'levels', 'observer_gain_factor')


def test_the_parameter_file_of_a_design_starts_a_controller(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    design = candidates(Requirements(settling_time=1.0, noise_std=1e-4, half_gain=True))[-1]
    text = parameter_text({ANY_CONTROLLER: controller_parameters(design.settings, 200.0)})
    file = tmp_path / 'design.yaml'
    file.write_text(text, encoding='utf-8')
    start('controller', file=file)
    probe.wait_until(lambda: 'controller' in ' '.join(probe.nodes()))
    expected = [200.0, design.settings.inner_bandwidth, 3, 0.5]
    assert probe.get('controller', *NAMES) == expected
