"""What is derived from a scenario, and what other values make of it."""

from __future__ import annotations

from pathlib import Path
import pickle

import attrs
from nadrc_ros.adrc import SettingError
from nadrc_ros.scenario import loads
from nadrc_ros.simulation.noise import Noise
import numpy as np
import pytest

FULL = """
plant: {name: paper, a3: 0.3, initial_state: [1, 0]}
reference: {signal: cosine, frequency: 0.5}
noise: {variance: 1e-4, sample_time: 0.005}
rate: 100
duration: 4
controllers: {nested: }
retune:
- {time: 2, inner_bandwidth: 20, pole_ratios: [1]}
- {time: 1, b0: 2}
settle_time: 0.5
"""
SHORT = 'plant: chain\nreference: {signal: step, amplitude: 1}\ncontrollers: {it: }\n'
# A plant with a memory: each use of it wears it out.
WORN = """
class Worn:
    order = 1
    states = 1
    b0 = 1.0

    def __init__(self):
        self.uses = 0

    def derivative(self, t, x, u, w, dx):
        self.uses += 1
        dx[0] = u + w - 1e-3 * self.uses * x[0]

    def output(self, x):
        return x[0]
"""


@pytest.mark.parametrize('duration', [0.02, 0.9, 30.0])
def test_the_peak_error_is_that_after_the_settle_time_of_the_scenario(duration: float) -> None:
    scenario = loads(SHORT)
    assert scenario.experiment.settled == 0.1 * scenario.duration
    for settle_time in (0.0, 0.4 * duration):
        shorter = attrs.evolve(scenario, duration=duration, settle_time=settle_time)
        if settle_time > shorter.experiment.last:
            continue
        result = shorter.run('it')
        late = result.time >= shorter.experiment.settled
        error = np.abs(result.reference - result.output)
        assert late.any()
        assert result.metrics.peak_error == error[late].max() > 0.0


def test_changed_leaves_retunes_out_that_lie_after_the_end() -> None:
    scenario = loads(FULL).changed(duration=1.5, rate=50, seed=3, noise_variance=0.0)
    assert scenario.noise == Noise(variance=0.0, sample_time=0.005, seed=3)
    assert (scenario.duration, scenario.rate) == (1.5, 50.0)
    assert [retune.time for retune in scenario.retunes] == [1.0]
    assert scenario.settle_time == 0.5
    assert loads(FULL).changed(duration=0.4).experiment.settled == 0.1 * 0.4
    assert loads(FULL).changed() == loads(FULL)


def test_changed_names_a_bad_value() -> None:
    for values, name in (
        ({'duration': -1.0}, 'duration'),
        ({'rate': 0.0}, 'rate'),
        ({'seed': -1}, 'seed'),
        ({'noise_variance': -1.0}, 'noise.variance'),
    ):
        with pytest.raises(SettingError) as caught:
            loads(FULL).changed(**values)
        assert caught.value.name == name


def test_every_run_gets_a_plant_of_its_own(tmp_path: Path) -> None:
    (tmp_path / 'worn.py').write_text(WORN)
    scenario = loads(SHORT.replace('plant: chain', 'plant: {file: worn.py}'), tmp_path)
    first, second = (scenario.run('it') for _ in range(2))
    assert first.output[-1] != 0.0
    assert np.array_equal(first.output, second.output)


def test_a_scenario_is_sent_without_the_code_of_its_plant(tmp_path: Path) -> None:
    (tmp_path / 'worn.py').write_text(WORN)
    scenario = loads(SHORT.replace('plant: chain', 'plant: {file: worn.py}'), tmp_path)
    sent = pickle.dumps(scenario)
    assert type(scenario.experiment.plant).__module__.encode() not in sent
    assert pickle.loads(sent) == scenario
