"""The plant node before its first command, and with a plant that is too much for its rate."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
import signal
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.nodes.reference import ReferenceNode
from nadrc_ros.ros.diagnostics import WARN
from probe import Probe, Processes
import pytest

Make = Callable[..., Probe]
PLANT: dict[str, Any] = {'rate': 100.0, 'plant': 'chain', 'order': 1, 'damping': 0.0}
SLOW = """
from time import thread_time

class Slow:
    order = states = b0 = 1

    def derivative(self, t, x, u, w, dx):
        end = thread_time() + 0.004
        while thread_time() < end:
            pass
        dx[0] = u

    def output(self, x):
        return x[0]
"""
FAILING = """
class Failing:
    order = states = b0 = 1

    def derivative(self, t, x, u, w, dx):
        dx[0] = u / max(0.0, 5.0 - x[0])

    def output(self, x):
        return x[0]
"""


def test_a_delay_does_not_keep_the_first_command_from_coming(make_probe: Make) -> None:
    late = {'fault.measurement.kind': 'delayed', 'fault.measurement.time': 0.2}
    probe = make_probe(parameters={'plant': PLANT | late | {'initial_state': [2.0]}})
    plant = probe.add(PlantNode())
    measurements, command = probe.listen('measurement'), probe.publisher('command')
    probe.wait_until(lambda: len(measurements) > 30 and probe.readers('command'))
    assert set(measurements) == {2.0}

    def moves() -> bool:
        command(1.0)
        return bool(measurements[-1] > 2.1)

    probe.wait_until(moves)
    assert plant.process.output > measurements[-1] + 0.1


def test_a_node_takes_a_signal_from_a_file_and_names_what_is_wrong_with_it(
    make_probe: Make, tmp_path: Path
) -> None:
    file, log = tmp_path / 'mine.py', tmp_path / 'log.csv'
    file.write_text(
        'class Mine:\n    def __init__(self, level=1.0):\n        self.level = level\n'
        '    def derivatives(self, t, out):\n        out[0] = self.level\n'
    )
    log.write_text('t;r\n0;2,5\n')
    plant = {'noise_signal': str(log), 'noise_signal_column': 'r', 'start': 'at_once'}
    mine = {'disturbance': str(file), 'disturbance_level': 3.0}
    probe = make_probe(parameters={'plant': PLANT | plant | mine})
    measurements = probe.listen('measurement')
    probe.add(PlantNode())
    probe.wait_until(lambda: len(measurements) > 30)
    steps = [b - a for a, b in pairwise(measurements[10:])]
    assert all(step == pytest.approx(0.03 * round(step / 0.03)) for step in steps)
    assert measurements[10] > 2.5 and measurements[-1] > measurements[0]
    (refusal,) = probe.set('plant', noise_signal_start=-1.0)
    assert 'noise_signal_start' in refusal
    for parameters, message in (
        ({'signal': str(file), 'signal_levl': 1.0}, 'signal_level'),
        ({'signal': str(log), 'signal_column': 'q'}, "no column 'q'"),
        ({'signal': str(tmp_path / 'nothing.py')}, 'No such file'),
    ):
        with pytest.raises(UserError, match=message):
            ReferenceNode(parameters=parameters)


def test_a_range_of_the_sensor_with_one_end_is_refused(make_probe: Make) -> None:
    make_probe(parameters={'plant': PLANT | {'wrap_min': -180.0}})
    with pytest.raises(UserError, match=r'wrap_min = -180\.0: must be with wrap_max beside it'):
        PlantNode()


def test_a_plant_of_one_step_in_minutes_takes_each_of_them(make_probe: Make) -> None:
    slow = {'rate': 0.01, 'start': 'at_once', 'command_timeout': 0.0, 'safe_command': 1.0}
    probe = make_probe(parameters={'plant': PLANT | slow})
    plant = probe.add(PlantNode())
    for k in range(3):
        assert plant.process.k == k
        plant.ticker._fire()
    assert plant.process.output == pytest.approx(300.0)
    (refusal,) = probe.set('plant', damping=1e3)
    assert 'rate = 0.01: must be at least 0.4 Hz for this plant' in refusal


def test_p17_a_plant_that_is_too_slow_is_told_and_runs_period_by_period(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    file = tmp_path / 'slow.py'
    file.write_text(SLOW)
    slow: dict[str, Any] = {'rate': 100.0, 'start': 'at_once', 'command_timeout': 0.0}
    plant = start('plant', **slow, plant=str(file))
    probe.wait_until(lambda: any(level == WARN for level, _, _ in probe.said('plant')))
    assert probe.said('plant')[-1][1].startswith('slower than real time: ')

    def counted() -> tuple[float, int]:
        values = probe.said('plant')[-1][2]
        return float(values['time']), int(values['periods'])

    begin, n = counted(), len(probe.said('plant'))
    assert probe.set('plant', safe_command=1.0) == ['']
    probe.wait_until(lambda: len(probe.said('plant')) > n + 2)
    end = counted()
    assert 100.0 * (end[0] - begin[0]) == pytest.approx(end[1] - begin[1])
    assert int(probe.said('plant')[-1][2]['missed_periods']) > 5
    plant.signal(signal.SIGINT)
    assert probe.end_of(plant) == 0


def test_what_the_code_of_a_plant_raises_is_one_line_that_names_it(
    start: Processes, tmp_path: Path
) -> None:
    file = tmp_path / 'failing.py'
    file.write_text(FAILING)
    own: dict[str, Any] = {
        'start': 'at_once',
        'initial_state': [4.9],
        'command_timeout': 0.1,
        'safe_command': 1.0,
    }
    plant = start('plant', rate=100.0, plant=str(file), **own)
    assert plant.end() == 1
    assert f'{file}, line 6: ZeroDivisionError: ' in plant.said
    assert len([line for line in plant.own_lines if 'INFO' not in line]) == 1, plant.said
