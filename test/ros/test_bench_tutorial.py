"""The tutorial of a motor on the bench, followed by its text, with the motor in MuJoCo."""

from __future__ import annotations

from pathlib import Path
import re
import signal

from probe import Probe, Processes, ROOT
import pytest
from tutorial_helpers import follow, part
import yaml

pytest.importorskip('mujoco', reason='the test extra brings it')
PAGE = 'tutorial_motor.md'
DRIVER = str(ROOT / 'examples' / 'bench' / 'driver.py')


def lines_of(begin: str, end: str, start: str) -> list[list[str]]:
    """Return the words of the lines of a part that start so, without what follows that."""
    found = re.findall(rf'^{start}(.*?)(?: &)?$', part(PAGE, begin, end), re.MULTILINE)
    return [line.split() for line in found]


def test_from_the_wires_to_a_loop_that_survives(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    """With the numbers that the page shows: that commissioning finds them is the next test."""
    ((driver,),) = lines_of('## A driver', '## Look', 'python ')
    assert ROOT / driver == Path(DRIVER)
    driving = start.run('driver', DRIVER)
    measured, wanted = probe.listen('/measurement'), probe.listen('/reference')
    probe.wait_until(lambda: measured)
    assert follow(part(PAGE, '## Look', '## Find order'), tmp_path, patience=3) == 2

    file = yaml.safe_load((tmp_path / 'motor.yaml').read_text())
    values = file['/**/controller']['ros__parameters']
    values |= shown() | {'measurement_timeout': 1.0}  # a busy machine is late
    parameters = tmp_path / 'commissioned.yaml'
    parameters.write_text(yaml.safe_dump(file))
    for node, *words in lines_of('## Close', '## Tune', r'python -m nadrc_ros\.nodes\.'):
        words = [str(parameters) if word.endswith('.yaml') else word for word in words]
        more = ['--ros-args', '-p', f'directory:={tmp_path}'] if node == 'recorder' else []
        start.run(node, '-m', f'nadrc_ros.nodes.{node}', *words, *more)
    assert probe.enable(True, '/controller').success

    def arrived(at: float) -> bool:
        return bool(wanted) and wanted[-1] == at and abs(measured[-1] - at) < 0.05

    probe.wait_until(lambda: arrived(0.5))
    probe.wait_until(lambda: arrived(-0.5))
    driving.signal(signal.SIGINT)
    probe.wait_until(lambda: 'no valid measurement' in probe.reports['/controller'][-1][1])
    start.run('driver again', DRIVER)
    probe.wait_until(lambda: arrived(0.5))


@pytest.mark.realtime
def test_commissioning_finds_what_the_page_says(
    probe: Probe, start: Processes, tmp_path: Path
) -> None:
    """Its samples and pulses have to be in time, so no busy machine can pass."""
    start.run('driver', DRIVER)
    measured = probe.listen('/measurement')
    probe.wait_until(lambda: measured)
    limits, out = tmp_path / 'motor.yaml', tmp_path / 'out'
    text = re.search(r'```yaml\n(# motor.yaml.*?)```', part(PAGE, '## Look', '## Find'), re.DOTALL)
    assert text is not None
    limits.write_text(text[1])
    (words,) = lines_of('## Find order', '## Close', 'nadrc ')
    assert words.count('motor.yaml') == 1
    words = [str(limits) if word == 'motor.yaml' else word for word in words]
    process = start.run('commission', '-m', 'nadrc_ros.cli', *words, '--yes', '--out', str(out))
    assert process.end(120.0) == 0, process.said
    file = yaml.safe_load((out / 'commissioned.yaml').read_text())
    found = file['/**/controller']['ros__parameters']
    assert found['plant_order'] == 2
    said = shown()
    # the trial that is faster may succeed too
    assert found['controller_bandwidth'] >= 0.8 * said.pop('controller_bandwidth')
    assert {name: found[name] for name in said} == pytest.approx(said, rel=0.2)


def shown() -> dict[str, float]:
    """Return what the page says that is found."""
    text = part(PAGE, '## Find order', '## Close')
    names = ('b0', 'controller_bandwidth', 'inner_bandwidth')
    return {name: float(re.findall(rf'{name} (?:= )?(\d+\.\d+)', text)[0]) for name in names}


def test_the_driver_switches_the_motor_off_when_commands_stop(
    probe: Probe, start: Processes
) -> None:
    start.run('driver', DRIVER)
    measured, send = probe.listen('/measurement'), probe.publisher('/command')
    probe.wait_until(lambda: send(6.0) or (measured and measured[-1] > 1.0))
    probe.spin(2.0)
    before = measured[-1]
    probe.spin(0.5)
    assert abs(measured[-1] - before) < 0.5  # at 6 V it would turn by 10 rad
